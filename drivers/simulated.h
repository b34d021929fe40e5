#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "common/base/built_for.h"
#include "common/hardware/adjustable_environment.h"
#include "common/hardware/device.h"
#include "common/hardware/robot.h"
#include "sim/sim_device.h"
#include "sim/sim_robot.h"

namespace twoport {
/// Of simulated hardware.
inline constexpr Seconds kSimulatedWatchdog{0.1};

/// Time of a simulated world: stands still until start(), and follows the clock from the next reading on.
class WorldTime {
 public:
  void start() noexcept { started_ = true; }
  /// Calls `advance()` for every period that has passed since the last reading, skipped ones included; `let_go()` when the last
  /// command is kSimulatedWatchdog old. Returns the share of that time in which the command was held.
  template <class Clock, class Advance, class LetGo>
  double pass(const Tick<Clock>& tick, Advance advance, LetGo let_go) noexcept {
    if (!started_) return 1.0;
    const long periods = begun_ ? std::lround(tick.ended.si() / tick.dt.si()) : 0;
    const long held = std::min(periods, std::lround(std::max(kSimulatedWatchdog.si(), tick.dt.si()) / tick.dt.si()));
    begun_ = true;
    for (long k = 0; k < held; ++k) advance();
    if (held == periods) return 1.0;
    let_go();
    for (long k = held; k < periods; ++k) advance();
    return static_cast<double>(held) / static_cast<double>(periods);
  }

 private:
  bool started_ = false, begun_ = false;
};

/// The scene's operator and device.
template <int N>
class SimulatedDevice : public Device<N> {
 public:
  static constexpr bool kDrivesJoints = true;
  SimulatedDevice(const Scene& scene, Seconds period) : model_{scene, period} {
    info_.name = "simulated device";
    info_.watchdog = kSimulatedWatchdog;
    info_.mass_kg = scene.control.handle_mass_kg;
    info_.inertia_kg_m2 = scene.control.handle_inertia_kg_m2;
    if (scene.device && scene.device->max_force_n) info_.max_force_n = *scene.device->max_force_n;
    truth_.path_ends_s = model_.path().end_s();
    note();
    if constexpr (built_for(1))
      if (scene.gripper) {
        info_.gripper = true;
        gripper_ = std::make_unique<SimulatedDevice<1>>(*scene.gripper, period);
      }
  }

  [[nodiscard]] DeviceInfo info() const override { return info_; }
  DeviceSample<N> sense(const Tick<MasterClock>& tick) noexcept override {
    const Force<N> held = model_.held();
    const double share = time_.pass(
        tick, [this] { model_.advance(); }, [this] { model_.release(); });
    note();
    DeviceSample<N> sample = model_.sense();
    if (share < 1.0) [[unlikely]]
      sample.applied = share * held;
    return sample;
  }
  void actuate(const Force<N>& f) noexcept override { model_.actuate(f); }
  void start() noexcept override { time_.start(); }
  void release() noexcept override { model_.release(); }
  [[nodiscard]] Device<1>* gripper() noexcept override { return gripper_.get(); }
  [[nodiscard]] const DeviceTruth<N>* truth() const noexcept override { return &truth_; }

 private:
  void note() noexcept {
    truth_.x = model_.x();
    truth_.v = model_.v();
    truth_.port_energy = model_.port_energy();
  }

  sim::SimDevice<N> model_;
  WorldTime time_;
  DeviceInfo info_;
  DeviceTruth<N> truth_;
  std::unique_ptr<SimulatedDevice<1>> gripper_;  ///< of the scene; null: none
};

/// The scene's robot, force sensor and environment.
template <int N>
class SimulatedRobot : public Robot<N>, public AdjustableEnvironment {
 public:
  static constexpr bool kDrivesJoints = true;
  SimulatedRobot(const Scene& scene, Seconds period)
      : model_{scene, period},
        surfaces_{std::min(model_.environment().world().surfaces.size(), kAdjustableSurfaces)},
        has_object_{scene.object.has_value()},
        ramp_ticks_{std::max(1L, std::lround(kEnvironmentRamp / period.si()))} {
    for (std::size_t i = 0; i < surfaces_; ++i) to_[i] = surface(i);
    if constexpr (built_for(1))
      if (scene.gripper) gripper_ = std::make_unique<SimulatedRobot<1>>(*scene.gripper, period);
  }

  [[nodiscard]] RobotInfo info() const override { return {.name = "simulated robot", .watchdog = kSimulatedWatchdog}; }
  RobotSample<N> sense(const Tick<SlaveClock>& tick) noexcept override {
    time_.pass(
        tick, [this] { advance(); }, [this] { model_.release(); });
    truth_.f_environment = model_.environment_force();
    truth_.touches = model_.environment().holds() || truth_.f_environment.squared_norm() > 0.0;
    return model_.sense();
  }
  void actuate(const RobotCommand<N>& command) noexcept override { model_.actuate(command); }
  void start() noexcept override { time_.start(); }
  void release() noexcept override { model_.release(); }
  [[nodiscard]] Robot<1>* gripper() noexcept override { return gripper_.get(); }
  [[nodiscard]] AdjustableEnvironment* environment() noexcept override { return this; }
  [[nodiscard]] const RobotTruth<N>* truth() const noexcept override { return &truth_; }
  [[nodiscard]] const Position<N>* tool() const noexcept override { return model_.tool(); }

  bool adjust(const EnvironmentMessage& request) noexcept override {
    if (!model_.takes_other_surfaces() || request.count > surfaces_) return false;
    for (std::size_t i = 0; i < request.count; ++i) {
      const EnvironmentMessage::Surface &s = request.surface[i], &before = to_[i];
      // A scene may have more than may be asked for; that is left as it is.
      const bool stiffness_allowed = s.stiffness_n_per_m == before.stiffness_n_per_m ||
                                     (s.stiffness_n_per_m > 0.0 && s.stiffness_n_per_m <= kSurfaceStiffnessMost);
      const bool friction_allowed = !model_.takes_other_friction() || s.friction == before.friction ||
                                    (s.friction >= 0.0 && s.friction <= kSurfaceFrictionMost);
      if (!stiffness_allowed || !friction_allowed) return false;
    }
    for (std::size_t i = 0; i < surfaces_; ++i) from_[i] = surface(i);
    std::copy_n(request.surface.begin(), request.count, to_.begin());
    ramp_left_ = ramp_ticks_;
    return true;
  }
  void describe(EnvironmentMessage& state) const noexcept override {
    state.answer = !model_.takes_other_surfaces() ? EnvironmentAnswer::arm
                   : surfaces_ == 0               ? EnvironmentAnswer::no_surface
                                                  : EnvironmentAnswer::adjustable;
    state.energy_j = changes_.si();
    state.count = static_cast<std::uint8_t>(surfaces_);
    for (std::size_t i = 0; i < surfaces_; ++i) {
      state.surface[i] = surface(i);
      if (!model_.takes_other_friction()) state.surface[i].friction = -1.0;
    }
    if constexpr (N == 6 || N == kJointPort) {
      state.joints = 0;
      if (const sim::ArmPlant* arm = model_.arm()) {
        const auto& q = arm->state().q;
        state.joints = static_cast<std::uint8_t>(q.size());
        std::copy(q.begin(), q.end(), state.joint_rad.begin());
      }
    }
    if constexpr (N == kJointPort) {
      state.has_object = has_object_;
      std::ranges::copy(model_.object(), state.object_m.begin());
    }
  }

 private:
  void advance() noexcept {
    if (ramp_left_ > 0) [[unlikely]]
      change_surfaces();
    model_.advance();
  }
  /// One tick of the ramp.
  void change_surfaces() noexcept {
    --ramp_left_;
    const double rest = static_cast<double>(ramp_left_) / static_cast<double>(ramp_ticks_);
    const auto between = [&](double from, double to) { return to + rest * (from - to); };
    for (std::size_t i = 0; i < surfaces_; ++i)
      changes_ += model_.set_surface(i, between(from_[i].stiffness_n_per_m, to_[i].stiffness_n_per_m),
                                     between(from_[i].friction, to_[i].friction));
  }
  [[nodiscard]] EnvironmentMessage::Surface surface(std::size_t i) const noexcept {
    const Material& m = model_.environment().world().surfaces[i].material;
    return {m.stiffness_n_per_m, m.friction};
  }

  sim::SimRobot<N> model_;
  std::size_t surfaces_;                                                        ///< that can be changed
  bool has_object_;                                                             ///< for the fingers of the arm
  std::array<EnvironmentMessage::Surface, kAdjustableSurfaces> from_{}, to_{};  ///< of the ramp
  long ramp_ticks_, ramp_left_ = 0;
  Energy changes_;  ///< work of all changes
  WorldTime time_;
  RobotTruth<N> truth_;
  std::unique_ptr<SimulatedRobot<1>> gripper_;  ///< of the scene; null: none
};

}  // namespace twoport
