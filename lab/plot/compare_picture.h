#pragma once

#include <string>

#include "lab/study/compare.h"

namespace twoport::lab {

/// FOLDER/compare.png and .svg: a panel for each method with the force that the hand feels and the force that the
/// environment takes, over time, from the traces in FOLDER/METHOD. Returns one sentence.
std::string draw(const Comparison& all, const std::string& folder);

}  // namespace twoport::lab
