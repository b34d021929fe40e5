// A driver for a haptic device. `Rail` in vendor.h stands in for the vendor's library.

#include <cstdlib>

#include "twoport/base/check.h"
#include "twoport/hardware/registry.h"
#include "vendor.h"

namespace {

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
