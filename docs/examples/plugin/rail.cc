// A haptic device as a plug-in: --device ./rail.so[:PORT]. `Rail` in vendor.h stands in for the vendor's library.

#include <cstdlib>
#include <stdexcept>
#include <string>

#include "../own_hardware/vendor.h"
#include "twoport/hardware/plugin.h"

namespace {

using namespace twoport::plugin;

class RailDevice final : public Device {
 public:
  explicit RailDevice(const Session& session) {
    const std::string port = *session.arguments != '\0' ? session.arguments : "1";
    if (!rail_.open(std::atoi(port.c_str()))) throw std::runtime_error{"no rail at port " + port + "; connect it"};
  }
  DeviceInfo info() const override {
    DeviceInfo info;
    info.name = "rail of the example";
    info.dof = 1;
    info.workspace_m[0] = 0.1;
    info.peak_force_n = 6.0;
    info.continuous_force_n = 2.5;
    info.mass_kg = 0.12;
    return info;
  }
  DeviceReading sense(double, double) override {
    const Rail::Reading from = rail_.read();
    DeviceReading reading;
    reading.position_m[0] = from.x_m;
    reading.velocity[0] = from.v_m_per_s;
    reading.applied[0] = -from.push_n;
    if (!from.fresh) reading.status = Status::stale;
    if (from.broken) reading.status = Status::fault;
    return reading;
  }
  void actuate(const double* force) override { rail_.push(-force[0]); }
  void release() override { rail_.push(0.0); }

 private:
  Rail rail_;
};

}  // namespace

TWOPORT_DEVICE_PLUGIN(RailDevice)
