#pragma once

#include <string>
#include <vector>

#include "lab/study/impedance.h"

namespace twoport::lab {

/// Draws FOLDER/impedance.png and .svg: size and phase of force against motion, displayed and true, and coherence. Returns
/// one sentence: what was drawn, or why nothing was.
std::string draw(const std::vector<DisplayedImpedance>& all, const std::string& scene, const std::string& folder);

}  // namespace twoport::lab
