#pragma once

#include <string>
#include <vector>

#include "common/scene/scene.h"

namespace twoport {

/// What in a valid scene is probably not meant, one sentence each: lengths that look like millimetres, a simulated handle
/// that nobody holds, a delayed link without passivity control, a virtual coupling that the robot cannot hold. Programs print them; they change no exit status.
std::vector<std::string> hints(const Scene& scene, bool device_is_simulated = true);

/// Why the claim of the passivity layer does not hold under the options of the scene; empty: it does, or the layer claims nothing.
std::string what_voids_claim(const Scene& scene);
/// The claim that holds over a link, and why where one is void: "hand", "both", "none", "none: ...". Empty without a link.
std::string claim_that_holds(const Scene& scene);

/// hints() of a live program, with what of the scene it ignores.
std::vector<std::string> live_hints(const Scene& scene, bool device_is_simulated);

}  // namespace twoport
