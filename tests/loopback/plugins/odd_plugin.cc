// A device and a robot that misbehave as ARGS say: "refuses", "refuses_oddly", or NAME=K, at the Kth reading: throw_in_sense,
// throw_in_actuate, throw_oddly, negative (a peak force), nan (from then on), blink (one reading that is not finite), every_other (not
// finite from then on), stop (one reading says so), hang_in_sense, exit_in_sense; or "hang_in_open", "hang_in_release".

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <thread>

#include "common/hardware/plugin.h"

namespace {

using namespace twoport::plugin;

struct Defect {
  explicit Defect(const std::string& arguments) : name{arguments.substr(0, arguments.find('='))} {
    if (name == "refuses") throw std::runtime_error{"no power at the socket"};
    if (name == "refuses_oddly") throw 7;
    if (name == "hang_in_open") hang();
    if (const auto equals = arguments.find('='); equals != std::string::npos)
      at = std::atoi(arguments.c_str() + equals + 1);
  }
  [[noreturn]] static void hang() {
    for (;;) std::this_thread::sleep_for(std::chrono::hours{1});
  }
  bool due(const char* which) const { return name == which && readings >= at; }
  std::string name;
  int at = 0, readings = 0;
};

/// A free mass of 0.1 kg that rests at 5 mm on each axis, and says in its first button whether it was released.
class OddDevice final : public Device {
 public:
  explicit OddDevice(const Session& session) : defect_{session.arguments} {}
  DeviceInfo info() const override {
    DeviceInfo info;
    info.name = "odd plug-in";
    info.dof = 3;
    info.peak_force_n = defect_.name == "negative" ? -3.0 : 4.0;
    info.mass_kg = 0.1;
    info.watchdog_s = 0.1;
    info.buttons = 1;
    return info;
  }
  DeviceReading sense(double, double) override {
    ++defect_.readings;
    if (defect_.due("throw_in_sense")) throw std::runtime_error{"the cable is out"};
    if (defect_.due("throw_oddly")) throw 7;
    if (defect_.due("hang_in_sense")) Defect::hang();
    if (defect_.due("exit_in_sense")) std::exit(0);
    DeviceReading reading;
    for (int i = 0; i < 3; ++i) reading.position_m[i] = 0.005;
    for (int i = 0; i < 6; ++i) reading.applied[i] = force_[i];
    if (defect_.due("nan") || (defect_.due("blink") && defect_.readings == defect_.at)) reading.velocity[0] = NAN;
    if (defect_.due("every_other") && defect_.readings % 2 == 0) reading.position_m[0] = NAN;
    if (defect_.name == "stop" && defect_.readings == defect_.at) reading.status = Status::stopped;
    reading.buttons = released_ ? 1u : 0u;
    return reading;
  }
  void actuate(const double* force) override {
    if (defect_.due("throw_in_actuate")) throw std::runtime_error{"the amplifier is out"};
    for (int i = 0; i < 6; ++i) force_[i] = force[i];
  }
  void release() override {
    if (defect_.name == "hang_in_release") Defect::hang();
    released_ = true;
    for (double& f : force_) f = 0.0;
  }

 private:
  Defect defect_;
  double force_[6]{};
  bool released_ = false;
};

/// Follows its set point exactly.
/// Its name is the user's own: no class of the interface is called so.
class Arm final : public Robot {
 public:
  explicit Arm(const Session& session) : defect_{session.arguments} {}
  RobotInfo info() const override {
    RobotInfo info;
    info.name = "odd robot";
    info.dof = 6;
    return info;
  }
  RobotReading sense(double, double) override {
    ++defect_.readings;
    if (defect_.due("throw_in_sense")) throw std::runtime_error{"the cable is out"};
    RobotReading reading;
    reading.ideal = true;
    for (int i = 0; i < 3; ++i) reading.position_m[i] = command_.position_m[i];
    for (int i = 0; i < 4; ++i) reading.attitude[i] = command_.attitude[i];
    for (int i = 0; i < 6; ++i) reading.velocity[i] = command_.velocity[i];
    reading.force[0] = command_.force[0];
    return reading;
  }
  void actuate(const RobotCommand& command) override { command_ = command; }
  void release() override { command_ = {}; }

 private:
  Defect defect_;
  RobotCommand command_;
};

}  // namespace

TWOPORT_DEVICE_PLUGIN(OddDevice)
TWOPORT_ROBOT_PLUGIN(Arm)
