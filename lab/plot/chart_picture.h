#pragma once

#include <string>

#include "lab/study/chart.h"

namespace twoport::lab {

/// FOLDER/chart.png and .svg; returns one sentence: what was drawn, or why nothing was.
std::string draw(const Chart& chart, const std::string& title, const std::string& folder);

}  // namespace twoport::lab
