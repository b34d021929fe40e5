// A handle with six axes and three motors, as most desktop devices have: half a second after the other side has come a hand of 300 N/m presses
// it 30 mm along x. It turns its wrist, which no motor holds.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "common/hardware/plugin.h"

namespace {

namespace plugin = twoport::plugin;

constexpr double kMass = 0.1, kStiffness = 300.0, kDamping = 3.0;  // of handle and hand

class Wrist final : public plugin::Device {
 public:
  explicit Wrist(const plugin::Session&) {}
  [[nodiscard]] plugin::DeviceInfo info() const override {
    plugin::DeviceInfo info;
    info.name = "handle with three motors";
    info.dof = 6;
    info.peak_force_n = 8.5;
    info.peak_torque_n_m = 0.0;
    info.mass_kg = kMass;
    info.inertia_kg_m2 = 1e-4;
    info.watchdog_s = 0.1;
    return info;
  }
  plugin::DeviceReading sense(double now_s, double dt_s) override {
    constexpr int kSteps = 20;
    const double h = std::min(dt_s, 0.02) / kSteps;
    if (begins_s_ < 0.0 && starts_) begins_s_ = now_s + 0.5;
    const double share = begins_s_ < 0.0 ? 0.0 : std::clamp((now_s - begins_s_) / 0.5, 0.0, 1.0);
    const double hand_m = 0.03 * share * share * share * (10.0 + share * (6.0 * share - 15.0));
    for (int k = 0; k < kSteps; ++k)
      for (std::size_t i = 0; i < 3; ++i) {
        const double hand_n = kStiffness * ((i == 0 ? hand_m : 0.0) - x_[i]) - kDamping * v_[i];
        v_[i] += h / kMass * (hand_n - force_[i]);
        x_[i] += h * v_[i];
      }
    const double turn = 0.2 * std::sin(2.0 * now_s);
    plugin::DeviceReading reading;
    reading.attitude[0] = std::cos(0.5 * turn), reading.attitude[3] = std::sin(0.5 * turn);
    reading.velocity[5] = 0.4 * std::cos(2.0 * now_s);
    for (std::size_t i = 0; i < 3; ++i)
      reading.position_m[i] = x_[i], reading.velocity[i] = v_[i], reading.applied[i] = force_[i];
    return reading;
  }
  void actuate(const double* force) override { std::copy_n(force, 3, force_.begin()); }
  void start() override { starts_ = true; }
  void release() override { force_ = {}; }

 private:
  bool starts_ = false;
  double begins_s_ = -1.0;  ///< of the press; negative: the other side has not come
  std::array<double, 3> x_{}, v_{}, force_{};
};

}  // namespace

TWOPORT_DEVICE_PLUGIN(Wrist)
