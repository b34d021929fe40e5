#pragma once

#include "common/hardware/registry.h"

namespace twoport {

struct LiveArguments;
struct Scene;

/// twoport-slave: robot and force sensor, live. `hardware` are the drivers that --robot may name. Returns the exit status.
int slave_program(int argc, char** argv, const Registry& hardware);
/// One run with N axes: slave/run.h, compiled in dof_N.cc. Returns the exit status.
template <int N>
int run_slave(const Scene& scene, const LiveArguments& arguments, const Registry& hardware);

}  // namespace twoport
