#pragma once

#include <memory>
#include <string>

#include "common/base/check.h"
#include "common/hardware/mounted.h"

namespace twoport {

/// `gripper`, which stays its owner's. Throws ConfigError where it is null: `choice` names the `hardware` that has none.
template <class Hardware>
std::shared_ptr<Hardware> existing_gripper(Hardware* gripper, const char* hardware, const std::string& choice) {
  if (gripper == nullptr)
    throw ConfigError{std::string{"the scene has a gripper, but the "} + hardware + " \"" + choice +
                      "\" has none; leave the block gripper out at both sides, or take a " + hardware +
                      " that has one"};
  return {std::shared_ptr<void>{}, gripper};
}

/// The gripper that a scene has, with the watchdog, the heat and the finite readings of a MountedDevice. `device` must outlive it.
template <int N>
std::unique_ptr<Device<1>> mounted_gripper(Device<N>& device, const std::string& choice) {
  return std::make_unique<MountedDevice<1>>(existing_gripper(device.gripper(), "device", choice), DeviceMount{});
}
/// As for a device.
template <int N>
std::unique_ptr<Robot<1>> mounted_gripper(Robot<N>& robot, const std::string& choice) {
  return std::make_unique<MountedRobot<1>>(existing_gripper(robot.gripper(), "robot", choice), RobotMount{});
}

}  // namespace twoport
