// A driver for a robot. `Cart` stands in for the vendor's library: here a cart with a force sensor at its front, 20 mm
// before a wall.

#include <algorithm>
#include <chrono>

#include "common/base/check.h"
#include "common/hardware/registry.h"

namespace {

/// The vendor's library: non-blocking, torque control.
class Cart {
 public:
  struct Reading {
    double x_m = 0.0, v_m_per_s = 0.0, sensor_n = 0.0;  ///< `sensor_n`: of the wall on the cart
  };
  Reading read() {
    const double step_s = 1e-4, mass_kg = 0.5, damping_n_s_per_m = 2.0, wall_n_per_m = 3000.0;
    const double now_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    for (; time_s_ + step_s <= now_s; time_s_ += step_s) {
      reading_.sensor_n = -wall_n_per_m * std::max(0.0, reading_.x_m - 0.02);
      reading_.v_m_per_s += step_s / mass_kg * (drive_n_ + reading_.sensor_n - damping_n_s_per_m * reading_.v_m_per_s);
      reading_.x_m += step_s * reading_.v_m_per_s;
    }
    return reading_;
  }
  void drive(double n) { drive_n_ = n; }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  Reading reading_;
  double time_s_ = 0.0, drive_n_ = 0.0;
};

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
