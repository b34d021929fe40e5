#include "slave/program.h"

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/platform/program.h"
#include "common/scene/scene.h"

namespace twoport {

int slave_program(int argc, char** argv, const Registry& hardware) {
  const auto body = [&](const Scene& scene, const LiveArguments& arguments) {
    if (scene.control.architecture == Architecture::render)
      throw ConfigError(arguments.scene +
                        ": control.architecture is RENDER, which has no slave; run twoport-master alone");
    return for_dof(scene.dof, [&]<int N>() { return run_slave<N>(scene, arguments, hardware); });
  };
  return live_program(argc, argv, Side::slave, hardware.robots.lines(), body);
}

}  // namespace twoport
