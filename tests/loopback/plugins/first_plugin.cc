// A device and a robot of version 1 of the interface: their functions are those of that version in its order, and end before
// gripper(). Where a program looks for it stands a function of their own.

#include <stdexcept>

#include "common/hardware/plugin.h"

namespace {

namespace plugin = twoport::plugin;

class FirstDevice {
 public:
  virtual ~FirstDevice() = default;
  virtual plugin::DeviceInfo info() const {
    plugin::DeviceInfo info;
    info.name = "device of version 1";
    info.gripper = true;  // said, and nothing came of it
    return info;
  }
  virtual plugin::DeviceReading sense(double, double) {
    plugin::DeviceReading reading;
    reading.applied[0] = force_;
    return reading;
  }
  virtual void actuate(const double* force) { force_ = force[0]; }
  virtual void start() {}
  virtual void release() { force_ = 0.0; }
  virtual void own() { throw std::logic_error{"a function was called that version 1 does not have"}; }

 private:
  double force_ = 0.0;
};

class FirstRobot {
 public:
  virtual ~FirstRobot() = default;
  virtual plugin::RobotInfo info() const {
    plugin::RobotInfo info;
    info.name = "robot of version 1";
    return info;
  }
  virtual plugin::RobotReading sense(double, double) {
    plugin::RobotReading reading;
    reading.position_m[0] = x_m_;
    return reading;
  }
  virtual void actuate(const plugin::RobotCommand& command) { x_m_ = command.position_m[0]; }
  virtual void start() {}
  virtual void release() { x_m_ = 0.0; }
  virtual void own() { throw std::logic_error{"a function was called that version 1 does not have"}; }

 private:
  double x_m_ = 0.0;
};

}  // namespace

extern "C" __attribute__((visibility("default"))) const plugin::Entry<FirstDevice>* twoport_device_plugin() {
  static const plugin::Entry<FirstDevice> entry{1, [](const plugin::Session&) { return new FirstDevice; }};
  return &entry;
}
extern "C" __attribute__((visibility("default"))) const plugin::Entry<FirstRobot>* twoport_robot_plugin() {
  static const plugin::Entry<FirstRobot> entry{1, [](const plugin::Session&) { return new FirstRobot; }};
  return &entry;
}
