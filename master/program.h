#pragma once

#include "common/hardware/registry.h"

namespace twoport {

struct LiveArguments;
struct Scene;

/// twoport-master: hand and haptic device, live. `hardware` are the drivers that --device may name. Returns the exit
/// status.
int master_program(int argc, char** argv, const Registry& hardware);
/// One run with N axes: master/run.h, compiled in link_N.cc. Returns the exit status.
template <int N>
int run_master(const Scene& scene, const LiveArguments& arguments, const Registry& hardware);

}  // namespace twoport
