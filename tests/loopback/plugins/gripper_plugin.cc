// A device and a robot with grippers. The hand closes the gripper of the handle from 60 to 30 mm, 0.2 s after start(), within 0.6 s;
// an object of 40 mm and 2 kN/m is between the fingers of the robot. The arms rest.
//
// ARGS: a defect when it is opened: no_gripper, wide, negative, itself, throws. Or NAME=T, T seconds after start():
//     arm_stale       for 0.5 s the device has no new readings; it counts as away 0.3 s later, when the program has let go of it
//     arm_nan         for 50 ms the robot's readings are not finite, and it is away
//     arm_throws, gripper_throws   sense() throws
// At its end the gripper says on stderr how it was called while the arm was away, and with which force it ends.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>

#include "common/hardware/plugin.h"

namespace {

using namespace twoport::plugin;

/// What arm and gripper share.
struct Story {
  explicit Story(const std::string& arguments) : name{arguments.substr(0, arguments.find('='))} {
    if (const auto equals = arguments.find('='); equals != std::string::npos)
      at_s = std::atof(arguments.c_str() + equals + 1);
  }
  bool is(const char* which, double after_s, double before_s) const {
    return started && name == which && t_s >= at_s + after_s && t_s < at_s + before_s;
  }
  bool away() const { return is("arm_stale", 0.3, 0.5) || is("arm_nan", 0.0, 0.05); }

  std::string name;
  double at_s = 0.0, t_s = 0.0;  ///< since start()
  bool started = false;
};

constexpr double kForEver = std::numeric_limits<double>::infinity();

/// What both grippers are: a mass on an axis, and the record of the calls.
class Finger {
 public:
  Finger(const char* side, const Story& story) : side_{side}, story_{story} {}
  ~Finger() {
    std::fprintf(stderr, "%s gripper: %d commands and %d releases while the arm was away, force %g at the end\n", side_,
                 commands_, releases_, force_);
  }
  void command(double force) {
    force_ = force;
    if (story_.away()) ++commands_;
  }
  void release() {
    force_ = 0.0;
    if (story_.away()) ++releases_;
  }
  double force() const { return force_; }

  template <class OfSurroundings>
  void pass(double s, double mass_kg, OfSurroundings force) {
    const int steps = std::max(1, static_cast<int>(std::lround(s / 1e-4)));
    for (int i = 0; i < steps; ++i) {
      v += s / steps / mass_kg * force(x, v);
      x += s / steps * v;
    }
  }
  double x = 0.06, v = 0.0;

 private:
  const char* side_;
  const Story& story_;
  double force_ = 0.0;
  int commands_ = 0, releases_ = 0;
};

template <class Info>
Info info_of_gripper(const Story& story) {
  Info info;
  info.name = "gripper of a plug-in";
  info.dof = story.name == "wide" ? 3 : 1;
  info.watchdog_s = story.name == "negative" ? -1.0 : 0.1;
  return info;
}

class DeviceGripper final : public Device {
 public:
  explicit DeviceGripper(const Story& story) : story_{story} {}
  DeviceInfo info() const override { return info_of_gripper<DeviceInfo>(story_); }
  DeviceReading sense(double, double ended_s) override {
    if (story_.is("gripper_throws", 0.0, kForEver)) throw std::runtime_error{"the gripper's cable is out"};
    const double target_m = 0.06 - 0.03 * std::clamp((story_.t_s - 0.2) / 0.6, 0.0, 1.0), force = finger_.force();
    finger_.pass(ended_s, 0.1, [&](double x, double v) { return 400.0 * (target_m - x) - 6.5 * v - force; });
    DeviceReading reading;
    reading.position_m[0] = finger_.x;
    reading.velocity[0] = finger_.v;
    reading.applied[0] = force;
    return reading;
  }
  void actuate(const double* force) override { finger_.command(force[0]); }
  void release() override { finger_.release(); }

 private:
  const Story& story_;
  Finger finger_{"device", story_};
};

class RobotGripper final : public Robot {
 public:
  explicit RobotGripper(const Story& story) : story_{story} {}
  RobotInfo info() const override { return info_of_gripper<RobotInfo>(story_); }
  RobotReading sense(double, double ended_s) override {
    if (story_.is("gripper_throws", 0.0, kForEver)) throw std::runtime_error{"the gripper's cable is out"};
    const double force = finger_.force();
    const auto of_object = [](double x) { return 2000.0 * std::max(0.0, 0.04 - x); };
    finger_.pass(ended_s, 0.2, [&](double x, double v) { return force + of_object(x) - 2.0 * v; });
    RobotReading reading;
    reading.position_m[0] = finger_.x;
    reading.velocity[0] = finger_.v;
    reading.force[0] = -of_object(finger_.x);
    return reading;
  }
  void actuate(const RobotCommand& command) override { finger_.command(command.force[0]); }
  void release() override { finger_.release(); }

 private:
  const Story& story_;
  Finger finger_{"robot", story_};
};

/// An arm that rests, with a gripper.
template <class Interface, class Gripper>
class Arm : public Interface {
 public:
  explicit Arm(const Session& session) : story_{session.arguments} {}
  void start() override { story_.started = true; }
  void release() override {}
  Interface* gripper() override {
    if (story_.name == "throws") throw std::runtime_error{"the gripper does not answer"};
    if (story_.name == "no_gripper") return nullptr;
    if (story_.name == "itself") return this;
    return &gripper_;
  }

 protected:
  template <class Reading>
  Reading read(double ended_s) {
    if (story_.started) story_.t_s += ended_s;
    if (story_.is("arm_throws", 0.0, kForEver)) throw std::runtime_error{"the cable is out"};
    Reading reading;
    if (story_.is("arm_stale", 0.0, 0.5)) reading.status = Status::stale;
    if (story_.is("arm_nan", 0.0, 0.05)) reading.position_m[0] = std::numeric_limits<double>::quiet_NaN();
    return reading;
  }
  Story story_;

 private:
  Gripper gripper_{story_};
};

class ArmDevice final : public Arm<Device, DeviceGripper> {
 public:
  using Arm::Arm;
  DeviceInfo info() const override {
    DeviceInfo info;
    info.name = "device with a gripper";
    info.watchdog_s = 0.1;
    info.gripper = true;
    return info;
  }
  DeviceReading sense(double, double ended_s) override { return read<DeviceReading>(ended_s); }
  void actuate(const double*) override {}
};

class ArmRobot final : public Arm<Robot, RobotGripper> {
 public:
  using Arm::Arm;
  RobotInfo info() const override {
    RobotInfo info;
    info.name = "robot with a gripper";
    info.watchdog_s = 0.1;
    return info;
  }
  RobotReading sense(double, double ended_s) override { return read<RobotReading>(ended_s); }
  void actuate(const RobotCommand&) override {}
};

}  // namespace

TWOPORT_DEVICE_PLUGIN(ArmDevice)
TWOPORT_ROBOT_PLUGIN(ArmRobot)
