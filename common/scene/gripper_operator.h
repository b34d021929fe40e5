#pragma once

#include "common/scene/blocks.h"

namespace twoport {

/// read_operator() for a gripper: a recording is read for its gripper.
OperatorSpec read_gripper_operator(const Block<schema::Operator>& of);

}  // namespace twoport
