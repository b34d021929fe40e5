// A driver for a haptic device. `Rail` stands in for the vendor's library: here a handle on a rail, which a hand moves
// back and forth between 0 and 40 mm with a period of 1.5 s.

#include <chrono>
#include <cmath>
#include <cstdlib>

#include "common/base/check.h"
#include "common/hardware/registry.h"

namespace {

/// The vendor's library: non-blocking, position grows to the right, a positive push goes to the right.
class Rail {
 public:
  bool open(int port) { return port == 1; }
  struct Reading {
    double x_m = 0.0, v_m_per_s = 0.0, push_n = 0.0;  ///< `push_n` was held until now
    bool fresh = false, broken = false;
  };
  Reading read() {
    const double step_s = 1e-4, mass_kg = 0.12, stiffness_n_per_m = 300.0, damping_n_s_per_m = 4.0;
    const double now_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    reading_.fresh = false;
    for (; time_s_ + step_s <= now_s; time_s_ += step_s) {
      const double target_m = 0.02 * (1.0 - std::cos(2.0 * 3.14159 / 1.5 * time_s_));
      const double hand_n = stiffness_n_per_m * (target_m - reading_.x_m) - damping_n_s_per_m * reading_.v_m_per_s;
      reading_.v_m_per_s += step_s / mass_kg * (hand_n + push_n_);
      reading_.x_m += step_s * reading_.v_m_per_s;
      reading_.fresh = true;
    }
    reading_.push_n = push_n_;
    return reading_;
  }
  void push(double n) { push_n_ = n; }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  Reading reading_;
  double time_s_ = 0.0, push_n_ = 0.0;
};

using namespace twoport;

class OwnDevice final : public Device<1> {
 public:
  /// ARGS of --device own:ARGS is the port that the rail is at.
  explicit OwnDevice(const DriverOptions& options) {
    const std::string port = options.arguments.empty() ? "1" : options.arguments;
    if (!rail_.open(std::atoi(port.c_str())))
      throw ConfigError{"--device own:" + port + ": no rail at this port; connect it or give its port, as in own:1"};
  }

  DeviceInfo info() const override { return {.name = "rail of the example", .max_force_n = 6.0, .mass_kg = 0.12}; }

  DeviceSample<1> sense(const Tick<MasterClock>&) noexcept override {
    const Rail::Reading reading = rail_.read();
    DeviceSample<1> sample;
    sample.x = Position<1>{Position<1>::Vector{reading.x_m}};
    sample.v = Velocity<1>{Velocity<1>::Vector{reading.v_m_per_s}};
    sample.applied = Force<1>{Force<1>::Vector{-reading.push_n}};
    if (!reading.fresh) sample.status = HardwareStatus::stale;
    if (reading.broken) sample.status = HardwareStatus::fault;
    return sample;
  }

  /// The hand is pushed with -f.
  void actuate(const Force<1>& f) noexcept override { rail_.push(-f[0]); }
  void release() noexcept override { rail_.push(0.0); }

 private:
  Rail rail_;
};

}  // namespace

namespace twoport {

void add_own_device(Registry& all) {
  all.devices.add<OwnDevice>("own", "the rail of the example; ARGS is its port");
}

}  // namespace twoport
