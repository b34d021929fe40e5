// A driver for a robot. `Cart` in vendor.h stands in for the vendor's library.

#include "twoport/base/check.h"
#include "twoport/hardware/registry.h"
#include "vendor.h"

namespace {

using namespace twoport;

class OwnRobot final : public Robot<1> {
 public:
  explicit OwnRobot(const DriverOptions& options) {
    if (!options.arguments.empty()) throw ConfigError{"--robot own:" + options.arguments + ": own takes no arguments"};
  }

  RobotInfo info() const override { return {.name = "cart of the example", .has_force_sensor = true}; }

  RobotSample<1> sense(const Tick<SlaveClock>&) noexcept override {
    const Cart::Reading reading = cart_.read();
    RobotSample<1> sample;
    sample.x = Position<1>{Position<1>::Vector{reading.x_m}};
    sample.v = Velocity<1>{Velocity<1>::Vector{reading.v_m_per_s}};
    sample.f_environment = Force<1>{Force<1>::Vector{-reading.sensor_n}};
    return sample;
  }

  void actuate(const RobotCommand<1>& command) noexcept override { cart_.drive(command.f[0]); }
  void release() noexcept override { cart_.drive(0.0); }

 private:
  Cart cart_;
};

}  // namespace

namespace twoport {

void add_own_robot(Registry& all) {
  all.robots.add<OwnRobot>("own", "the cart of the example");
}

}  // namespace twoport
