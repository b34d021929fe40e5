#pragma once

#include "common/hardware/registry.h"

namespace twoport {

/// twoport-slave: robot and force sensor, live. `hardware` are the drivers that --robot may name. Returns the exit status.
int slave_program(int argc, char** argv, const Registry& hardware);

}  // namespace twoport
