#include "common/base/check.h"
#include "common/hardware/registry.h"
#include "drivers/simulated.h"

namespace twoport {
namespace {

const Scene& scene_of(const DriverOptions& o, const char* flag) {
  if (!o.arguments.empty())
    throw ConfigError{std::string{flag} + " sim:" + o.arguments +
                      ": sim takes no arguments; the scene describes the model"};
  return o.scene;
}
template <int N>
struct DeviceDriver final : SimulatedDevice<N> {
  explicit DeviceDriver(const DriverOptions& o) : SimulatedDevice<N>{scene_of(o, "--device"), o.period} {}
};
template <int N>
struct RobotDriver final : SimulatedRobot<N> {
  explicit RobotDriver(const DriverOptions& o) : SimulatedRobot<N>{scene_of(o, "--robot"), o.period} {}
};

}  // namespace

void add_sim(Registry& all) {
  all.devices.add<DeviceDriver>("sim", "simulated hand and device of the scene");
  all.robots.add<RobotDriver>("sim", "simulated robot and environment of the scene");
}

}  // namespace twoport
