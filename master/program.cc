#include "master/program.h"

#include "common/base/built_for.h"
#include "common/platform/program.h"
#include "common/scene/scene.h"

namespace twoport {

int master_program(int argc, char** argv, const Registry& hardware) {
  return live_program(argc, argv, Side::master, hardware.devices.lines(),
                      [&](const Scene& scene, const LiveArguments& arguments) {
                        return for_dof(scene.dof, [&]<int N>() { return run_master<N>(scene, arguments, hardware); });
                      });
}

}  // namespace twoport
