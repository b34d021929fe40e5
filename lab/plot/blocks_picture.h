#pragma once

#include <string>
#include <vector>

#include "lab/study/trim.h"

namespace twoport::lab {

/// FOLDER/blocks.png and .svg. Returns one sentence: what was drawn, or why nothing was.
std::string draw(const std::vector<BlockCost>& costs, const std::string& title, const std::string& folder);

}  // namespace twoport::lab
