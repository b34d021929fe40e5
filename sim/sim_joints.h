#pragma once

#include <cstdint>
#include <memory>

#include "common/base/copied.h"
#include "common/hardware/device.h"
#include "common/hardware/robot.h"
#include "common/passivity/observer.h"
#include "common/scene/scene.h"
#include "sim/operator/path.h"
#include "sim/plant/arm.h"
#include "sim/sensor.h"

namespace twoport::sim {

template <int N>
class SimDevice;
template <int N>
class SimRobot;

/// A leader: an arm whose joints are the port, with weight compensated, and a hand that holds its tool. Interface as of any SimDevice.
template <>
class SimDevice<kJointPort> final {
 public:
  static constexpr int N = kJointPort;
  SimDevice(const Scene& scene, Seconds dt);

  void advance() noexcept;
  void hold() noexcept {
    path_.hold(static_cast<double>(tick_) * dt_);
    opening_.hold(static_cast<double>(tick_) * dt_);
  }
  bool kick(const Velocity<N>& dv) noexcept;

  [[nodiscard]] DeviceSample<N> sense() const noexcept {
    return encoder_.ideal() ? DeviceSample<N>{x(), v(), applied_}
                            : DeviceSample<N>{encoder_.x(), encoder_.v(), applied_};
  }
  template <class Clock>
  DeviceSample<N> sense(const Tick<Clock>&) const noexcept {
    return sense();
  }
  void actuate(const Force<N>& f) noexcept { held_ = f; }
  void release() noexcept { held_ = Force<N>{}; }

  [[nodiscard]] const Position<N>& x() const noexcept { return state_.x; }
  [[nodiscard]] const Velocity<N>& v() const noexcept { return state_.v; }
  [[nodiscard]] const Force<N>& held() const noexcept { return held_; }
  [[nodiscard]] Energy port_energy() const noexcept { return -arm_->port_energy(); }
  /// Of the tool.
  [[nodiscard]] const Path<6>& path() const noexcept { return path_; }
  [[nodiscard]] const ArmPlant* arm() const noexcept { return arm_.get(); }

 private:
  double dt_;
  Path<6> path_;
  Path<1> opening_;  ///< that the hand's finger intends
  bool led_;         ///< there is a hand
  Copied<ArmPlant> arm_;
  BodyState<N> state_;
  Encoder<N> encoder_;
  Force<N> applied_, held_;
  std::int64_t tick_ = 0;
};

/// A follower: an arm whose joints are the port, with weight compensated; its tool touches the environment, and it senses the torques of
/// that. Interface as of any SimRobot.
template <>
class SimRobot<kJointPort> final {
 public:
  static constexpr int N = kJointPort;
  SimRobot(const Scene& scene, Seconds dt);

  void advance() noexcept;
  void silence() noexcept { sensor_.silence(); }
  bool kick(const Velocity<N>& dv) noexcept;

  [[nodiscard]] static bool takes_other_surfaces() noexcept { return false; }
  [[nodiscard]] static const Position<N>* tool() noexcept { return nullptr; }
  [[nodiscard]] static bool takes_other_friction() noexcept { return false; }
  static Energy set_surface(std::size_t, double, double) noexcept { return {}; }

  [[nodiscard]] RobotSample<N> sense() const noexcept { return {state_.x, state_.v, sensed_}; }
  template <class Clock>
  RobotSample<N> sense(const Tick<Clock>&) const noexcept {
    return sense();
  }
  void actuate(const RobotCommand<N>& command) noexcept { command_ = command.f; }
  void release() noexcept { command_ = Force<N>{}; }

  [[nodiscard]] const BodyState<N>& state() const noexcept { return state_; }
  [[nodiscard]] const Position<N>& port() const noexcept { return state_.x; }
  [[nodiscard]] const Force<N>& held() const noexcept { return command_; }
  /// Torques of the environment on the robot, Jᵀ f.
  [[nodiscard]] const Force<N>& environment_force() const noexcept { return from_environment_; }
  [[nodiscard]] const Environment<6>& environment() const noexcept { return *environment_; }
  [[nodiscard]] const ArmPlant* arm() const noexcept { return arm_.get(); }
  [[nodiscard]] const Eigen::Vector3d& object() const noexcept { return arm_->object().x; }

 private:
  void read() noexcept;

  std::shared_ptr<const Environment<6>> environment_;
  Copied<ArmPlant> arm_;
  BodyState<N> state_;
  Force<N> command_, from_environment_, sensed_;
  ForceSensor<N> sensor_;
};

}  // namespace twoport::sim
