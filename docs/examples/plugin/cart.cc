// A robot as a plug-in: --robot ./cart.so. `Cart` in vendor.h stands in for the vendor's library.

#include "../own_hardware/vendor.h"
#include "twoport/hardware/plugin.h"

namespace {

using namespace twoport::plugin;

class CartRobot final : public Robot {
 public:
  explicit CartRobot(const Session&) {}
  RobotInfo info() const override {
    RobotInfo info;
    info.name = "cart of the example";
    info.dof = 1;
    info.max_force_n = 60.0;
    return info;
  }
  RobotReading sense(double, double) override {
    const Cart::Reading from = cart_.read();
    RobotReading reading;
    reading.position_m[0] = from.x_m;
    reading.velocity[0] = from.v_m_per_s;
    reading.force[0] = -from.sensor_n;
    return reading;
  }
  void actuate(const RobotCommand& command) override { cart_.drive(command.force[0]); }
  void release() override { cart_.drive(0.0); }

 private:
  Cart cart_;
};

}  // namespace

TWOPORT_ROBOT_PLUGIN(CartRobot)
