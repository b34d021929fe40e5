#pragma once

#include <string>

#include "lab/study/boundary.h"

namespace twoport::lab {

/// FOLDER/boundary.png and .svg: at each value of the second axis the part of LO to HI in which the run is stable, and
/// the boundary as a line. Returns one sentence: what was drawn, or why nothing was.
std::string draw(const BoundaryCurve& curve, const std::string& folder);

}  // namespace twoport::lab
