#include <fmt/format.h>

#include <memory>
#include <optional>
#include <regex>
#include <string>

#include "common/hardware/registry.h"
#include "drivers/dynamixel_arm.h"

namespace twoport {
namespace {

using dynamixel::Axes, dynamixel::Port, dynamixel::Reading, dynamixel::ServoArm;

/// ARGS: PORT[,baud=N][,servos=FILE].
std::unique_ptr<ServoArm> opened(const std::string& flag, const DriverOptions& o, const std::optional<ArmSpec>& arm) {
  const std::string words = flag + " dynamixel:" + o.arguments;
  static const std::regex valid{"([^,]+)(?:,baud=([0-9]{4,7}))?(?:,servos=([^,]+))?(?:,silence_ms=([0-9]{1,3}))?"};
  std::smatch parts;
  if (!std::regex_match(o.arguments, parts, valid))
    throw ConfigError{
        words +
        ": ARGS is PORT[,baud=N][,servos=FILE][,silence_ms=N], as in dynamixel:/dev/ttyUSB0,servos=leader.textproto"};
  const int baud = parts[2].matched ? std::stoi(parts[2]) : 1000000;
  const int silence_ms = parts[4].matched ? std::stoi(parts[4]) : dynamixel::kGoneMs;
  if (Port::rate(baud) == B0)
    throw ConfigError{fmt::format("{}: baud must be 57600, 115200, 1000000, 2000000, 3000000 or 4000000", words)};
  if (silence_ms < 1 || silence_ms > dynamixel::kMostGoneMs)
    throw ConfigError{fmt::format(
        "{}: silence_ms is {}; it must be from 1 to {}: a servo that restarts is silent for longer, and comes back "
        "without torque",
        words, silence_ms, dynamixel::kMostGoneMs)};
  for (std::size_t i = 0; i < arm->parameters->joints.size(); ++i)
    if (arm->parameters->joints[i].type == JointType::prismatic)
      throw ConfigError{fmt::format("{}: joint {} of the scene's arm slides; a servo turns", words, i + 1)};
  return std::make_unique<ServoArm>(words, parts[1], baud, parts[3], *arm, o.period,
                                    std::chrono::milliseconds{silence_ms});
}

class DynamixelLeader final : public Device<kJointPort> {
 public:
  explicit DynamixelLeader(const DriverOptions& o)
      : arm_{opened("--device", o, o.scene.device ? o.scene.device->arm : std::nullopt)} {}

  [[nodiscard]] DeviceInfo info() const override {
    return {.name = arm_->name, .limits = arm_->limits(), .watchdog = to_seconds(dynamixel::kSilence)};
  }
  DeviceSample<kJointPort> sense(const Tick<MasterClock>&) noexcept override {
    const HardwareStatus status = arm_->read(reading_);
    return {.x = Position<kJointPort>{reading_.q},
            .v = Velocity<kJointPort>{reading_.v},
            .applied = Force<kJointPort>{Axes{-reading_.torque}},
            .status = status};
  }
  void actuate(const Force<kJointPort>& f) noexcept override { arm_->drive(-f.vec()); }
  void release() noexcept override { arm_->drive(Axes::Zero()); }
  [[nodiscard]] std::string trouble() const override { return arm_->trouble(); }

 private:
  std::unique_ptr<ServoArm> arm_;
  Reading reading_;
};

class DynamixelFollower final : public Robot<kJointPort> {
 public:
  explicit DynamixelFollower(const DriverOptions& o)
      : arm_{opened("--robot", o, o.scene.robot ? o.scene.robot->arm : std::nullopt)} {}

  [[nodiscard]] RobotInfo info() const override {
    return {.name = arm_->name, .limits = arm_->limits(), .watchdog = to_seconds(dynamixel::kSilence)};
  }
  RobotSample<kJointPort> sense(const Tick<SlaveClock>&) noexcept override {
    const HardwareStatus status = arm_->read(reading_);
    return {.x = Position<kJointPort>{reading_.q},
            .v = Velocity<kJointPort>{reading_.v},
            .f_environment = Force<kJointPort>{Axes{-reading_.outside}},
            .status = status};
  }
  void actuate(const RobotCommand<kJointPort>& c) noexcept override { arm_->drive(c.f.vec()); }
  void release() noexcept override { arm_->drive(Axes::Zero()); }
  [[nodiscard]] std::string trouble() const override { return arm_->trouble(); }

 private:
  std::unique_ptr<ServoArm> arm_;
  Reading reading_;
};

}  // namespace

void add_dynamixel(Registry& all) {
  const std::string is =
      "dynamixel:PORT[,baud=N][,servos=FILE][,silence_ms=N], an arm of Dynamixel servos, joint by joint";
  all.devices.add<DynamixelLeader>("dynamixel", is);
  all.robots.add<DynamixelFollower>("dynamixel", is);
}

}  // namespace twoport
