#pragma once

#include "common/hardware/registry.h"

namespace twoport {

/// twoport-master: hand and haptic device, live. `hardware` are the drivers that --device may name. Returns the exit
/// status.
int master_program(int argc, char** argv, const Registry& hardware);

}  // namespace twoport
