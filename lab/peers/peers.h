#pragma once

#include <string>
#include <vector>

#include "common/scene/scene.h"
#include "lab/study/chart.h"

namespace twoport::lab {

/// Other engines' answers to a scene: a robot alone on one wall and springs, with one degree of freedom, or with six a
/// box whose corners touch. Each engine twice: pushed by all forces of the environment at its state, once a step; and
/// with its own contact for the wall. Empty where a scene is not of this kind.
std::vector<Peer> peers_for(const Scene& scene);

/// Engines that were not there when this was built, with Debian's package names.
std::vector<std::string> absent_peers();

}  // namespace twoport::lab
