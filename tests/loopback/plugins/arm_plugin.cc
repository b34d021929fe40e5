// An arm of three joints as leader and follower: that of docs/examples/plugin, which goes by the clock from start() on, and says with which torques it ends.
//
// ARGS: a defect of what it says: joints=N, torque=T, or "range"; "still": it rests at 0.1, 0.2, 0.3 beyond its set point, its velocities are
// the torques on it, and 4, 5, 6 N m act on it; "free": no hand holds it. Or NAME=T, T seconds after start(): nan (the position of the last joint from then on), blink
// (for 50 ms), throws (sense()). The numbers of the joints that it has not are never finite.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>

#include "common/hardware/plugin.h"
#include "docs/examples/own_hardware/vendor.h"

namespace {

using namespace twoport::plugin;

class OddArm : public JointArm {
 public:
  OddArm(const Session& session, bool in_hand) : in_hand_{in_hand}, defect_{session.arguments} {
    if (const auto equals = defect_.find('='); equals != std::string::npos) {
      number_ = std::atof(defect_.c_str() + equals + 1);
      defect_.resize(equals);
    }
    if (session.dof != 3 && session.dof != 0) throw std::runtime_error{"the scene has " + std::to_string(session.dof)};
  }
  ~OddArm() override { std::fprintf(stderr, "arm: torques %g %g %g at the end\n", torque_[0], torque_[1], torque_[2]); }
  ArmInfo info() const override {
    ArmInfo info;
    info.name = "odd arm";
    info.joints = defect_ == "joints" ? static_cast<int>(number_) : 3;
    info.watchdog_s = 0.1;
    info.limits[0].torque = defect_ == "torque" ? number_ : 8.0;
    info.limits[2] = {20.0, 0.5, -0.1, defect_ == "range" ? -0.1 : 0.1};
    return info;
  }
  ArmReading sense(double now_s, double) override {
    if (begins_) since_s_ = now_s;
    begins_ = false;
    const double t_s = started_ ? now_s - since_s_ : -1.0;
    if (defect_ == "throws" && t_s >= number_) throw std::runtime_error{"the bus is out"};
    ArmReading reading;
    for (auto* each : {&reading.position, &reading.velocity, &reading.applied, &reading.external})
      std::fill(*each + 3, *each + kMostJoints, NAN);
    if (defect_ == "still") {
      for (int i = 0; i < 3; ++i) {
        reading.position[i] = set_point_[i] + 0.1 * (i + 1);
        reading.velocity[i] = reading.applied[i] = torque_[i];
        reading.external[i] = 4.0 + i;
      }
      return reading;
    }
    const Scara::Reading from = started_ ? arm_.read() : Scara::Reading{};
    std::copy_n(from.q, 3, reading.position);
    std::copy_n(from.v, 3, reading.velocity);
    std::copy_n(from.motor, 3, reading.applied);
    std::copy_n(from.outside, 3, reading.external);
    if (t_s >= number_ && (defect_ == "nan" || (defect_ == "blink" && t_s < number_ + 0.05))) reading.position[2] = NAN;
    return reading;
  }
  void actuate(const ArmCommand& command) override {
    std::copy_n(command.torque, 3, torque_);
    std::copy_n(command.position, 3, set_point_);
    arm_.drive(torque_);
  }
  void start() override {
    arm_ = Scara{in_hand_};
    started_ = begins_ = true;
  }
  void release() override {
    std::fill_n(torque_, 3, 0.0);
    arm_.drive(torque_);
  }

 private:
  bool in_hand_;
  Scara arm_{in_hand_};
  std::string defect_;
  double number_ = 0.0, since_s_ = 0.0;
  bool started_ = false, begins_ = false;
  double torque_[3]{}, set_point_[3]{};
};
struct Leader : OddArm {
  explicit Leader(const Session& session) : OddArm{session, std::string{session.arguments} != "free"} {}
};
struct Follower : OddArm {
  explicit Follower(const Session& session) : OddArm{session, false} {}
};

}  // namespace

TWOPORT_LEADER_PLUGIN(Leader)
TWOPORT_FOLLOWER_PLUGIN(Follower)
