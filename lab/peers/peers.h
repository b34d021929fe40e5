#pragma once

#include <string>
#include <vector>

#include "common/scene/scene.h"
#include "lab/study/chart.h"

namespace twoport::lab {

/// A scene computed by other engines: a robot alone on one wall and springs, with one degree of freedom, or with six a
/// box with contacts at its corners. Each engine twice: pushed by all forces of the environment at its state, once per
/// step; and with its own contact for the wall. A point mass in three degrees of freedom, or with another shape than a
/// wall: pushed only. Empty for other scenes.
std::vector<Peer> peers_for(const Scene& scene);

/// Engines that were missing at build time, with Debian's package names.
std::vector<std::string> absent_peers();

}  // namespace twoport::lab
