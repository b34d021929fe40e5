#pragma once

#include <string>

#include "lab/study/map.h"

namespace twoport::lab {

/// FOLDER/map.png and .svg: a panel for each method; round trip to the right, stiffness upwards, the colour is the
/// share of the losses at which the method holds (MapCell::holds). FOLDER/map_best.png and .svg: a panel for each loss, the
/// colour is the method with the least error. Returns one sentence for each: what was drawn, or why nothing was.
std::string draw(const Map& map, const std::string& folder);

}  // namespace twoport::lab
