#pragma once

#include <string>

#include "lab/study/zwidth.h"

namespace twoport::lab {

/// FOLDER/z_width.png and .svg: for each method a dot at every damping and stiffness that was run, and theory's border.
/// Returns one sentence: what was drawn, or why nothing was.
std::string draw(const ZWidth& z, const std::string& folder);

}  // namespace twoport::lab
