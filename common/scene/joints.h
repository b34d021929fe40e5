#pragma once

#include "common/scene/blocks.h"

namespace twoport {

/// A scene whose ports are the joints of two arms: their number, the metric (JointMetric), gains of single joints, and what the nodes must
/// know of the arms. After device, robot and controllers are read.
void read_joints(const Block<schema::Scene>& of, Scene& scene);

}  // namespace twoport
