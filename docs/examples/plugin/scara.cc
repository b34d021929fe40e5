// An arm as a plug-in, coupled joint by joint: as leader --device ./scara.so, as follower --robot ./scara.so. `Scara` in vendor.h stands
// in for the vendor's library.

#include <algorithm>

#include "../own_hardware/vendor.h"
#include "twoport/hardware/plugin.h"

namespace {

using namespace twoport::plugin;

class ScaraArm : public JointArm {
 public:
  explicit ScaraArm(bool in_hand) : arm_{in_hand} {}
  ArmInfo info() const override {
    ArmInfo info;
    info.name = "arm of the example";
    info.joints = 3;
    info.limits[0].torque = 8.0;
    info.limits[2] = {20.0, 0.5, -0.1, 0.1};
    return info;
  }
  ArmReading sense(double, double) override {
    const Scara::Reading from = arm_.read();
    ArmReading reading;
    std::copy_n(from.q, 3, reading.position);
    std::copy_n(from.v, 3, reading.velocity);
    std::copy_n(from.motor, 3, reading.applied);
    std::copy_n(from.outside, 3, reading.external);
    return reading;
  }
  void actuate(const ArmCommand& command) override { arm_.drive(command.torque); }
  void release() override { arm_.drive(ArmCommand{}.torque); }

 private:
  Scara arm_;
};
struct Leader : ScaraArm {
  explicit Leader(const Session&) : ScaraArm{true} {}
};
struct Follower : ScaraArm {
  explicit Follower(const Session&) : ScaraArm{false} {}
};

}  // namespace

TWOPORT_LEADER_PLUGIN(Leader)
TWOPORT_FOLLOWER_PLUGIN(Follower)
