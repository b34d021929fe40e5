#include "master/run_render.h"

namespace twoport {

template int run_render(const Scene&, MountedDevice<3>&, const LiveArguments&, LivePage*, spdlog::logger&);

}  // namespace twoport
