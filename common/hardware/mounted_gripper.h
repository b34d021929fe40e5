#pragma once

#include <memory>
#include <string>

#include "common/base/check.h"
#include "common/hardware/mounted.h"

namespace twoport {

/// The gripper of a device, which stays the device's.
class GripperOfDevice final : public Device<1> {
 public:
  explicit GripperOfDevice(Device<1>& gripper) : gripper_{gripper} {}
  [[nodiscard]] DeviceInfo info() const override { return gripper_.info(); }
  DeviceSample<1> sense(const Tick<MasterClock>& tick) noexcept override { return gripper_.sense(tick); }
  void actuate(const Force<1>& f) noexcept override { gripper_.actuate(f); }
  void start() noexcept override { gripper_.start(); }
  void release() noexcept override { gripper_.release(); }
  [[nodiscard]] std::string trouble() const override { return gripper_.trouble(); }
  [[nodiscard]] const DeviceTruth<1>* truth() const noexcept override { return gripper_.truth(); }

 private:
  Device<1>& gripper_;
};

/// The gripper of a robot, which stays the robot's.
class GripperOfRobot final : public Robot<1> {
 public:
  explicit GripperOfRobot(Robot<1>& gripper) : gripper_{gripper} {}
  [[nodiscard]] RobotInfo info() const override { return gripper_.info(); }
  RobotSample<1> sense(const Tick<SlaveClock>& tick) noexcept override { return gripper_.sense(tick); }
  void actuate(const RobotCommand<1>& command) noexcept override { gripper_.actuate(command); }
  void start() noexcept override { gripper_.start(); }
  void release() noexcept override { gripper_.release(); }
  [[nodiscard]] std::string trouble() const override { return gripper_.trouble(); }
  [[nodiscard]] const RobotTruth<1>* truth() const noexcept override { return gripper_.truth(); }

 private:
  Robot<1>& gripper_;
};

/// The gripper that a scene has, with the watchdog, the heat and the finite readings of a MountedDevice. `device` must outlive it.
/// Throws ConfigError where `device`, named by `choice`, has none.
template <int N>
std::unique_ptr<Device<1>> mounted_gripper(Device<N>& device, const std::string& choice) {
  Device<1>* const gripper = device.gripper();
  if (gripper == nullptr)
    throw ConfigError{"the scene has a gripper, but the device \"" + choice +
                      "\" has none; leave the block gripper out at both sides, or take a device that has one"};
  return std::make_unique<MountedDevice<1>>(std::make_unique<GripperOfDevice>(*gripper), DeviceMount{});
}
/// As for a device.
template <int N>
std::unique_ptr<Robot<1>> mounted_gripper(Robot<N>& robot, const std::string& choice) {
  Robot<1>* const gripper = robot.gripper();
  if (gripper == nullptr)
    throw ConfigError{"the scene has a gripper, but the robot \"" + choice +
                      "\" has none; leave the block gripper out at both sides, or take a robot that has one"};
  return std::make_unique<MountedRobot<1>>(std::make_unique<GripperOfRobot>(*gripper), RobotMount{});
}

}  // namespace twoport
