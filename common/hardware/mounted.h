#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "common/base/check.h"
#include "common/hardware/admittance.h"
#include "common/hardware/device.h"
#include "common/hardware/modulated_transformer.h"
#include "common/hardware/mount.h"
#include "common/hardware/robot.h"
#include "common/hardware/sensor_zero.h"

namespace twoport {

/// Every haptic device, in the scene's world. With R, s, p the mount's rotation, scale and position:
///
///     x = s R x_d + p       v = s R v_d        f_d = s Rᵀ f + Rᵀ f_carried
///
/// so that f·v = (f_d - Rᵀ f_carried)·v_d: energy in the world is energy at the device. Attitudes: q = R q_d Rᵀ.
/// Clutch, locks and scales of the operator come after that (ModulatedTransformer), from the first use of one on.
/// Continuous force: with f_c the device's, and a heat θ' = (|f_d|²/f_c² - θ)/10 s,
///
///     |f_d| <= f_c + (f_max - f_c) min(1, 5 (1 - θ))
///
/// Watchdog: without a new reading for let_go_after_s, and at once for a reading that is not finite, the device is released, until
/// readings come again. In place of one that is not finite stands the last one, stale and at rest.
/// The sum with f_carried is within the device's peak force. A command that is not finite releases the device.
/// After the watchdog the force returns over engage_s. What is taken from the force is not booked: `applied` is the
/// device's own.
template <int N>
class MountedDevice final : public Device<N> {
 public:
  MountedDevice(std::shared_ptr<Device<N>> device, const DeviceMount& mount)
      : device_{std::move(device)},
        m_{mount},
        maps_{!(mount == DeviceMount{})},
        works_{mount.clutch_button >= 0},
        info_{in_world(device_->info(), mount)},
        peak_n_{device_->info().max_force_n},
        continuous_n_{limit_of(device_->info())} {
    typename Force<N>::Vector carried = Force<N>::Vector::Zero();
    for (int i = 0; i < kWorldAxes; ++i) carried[i] = mount.carried_force_n[i];
    carried_ = Force<N>{turned_back(carried)};
    carries_ = carried_.squared_norm() > 0.0;
    const double most = std::min(peak_n_, continuous_n_), weight = translation(carried_).norm();
    if (weight > most)
      throw ConfigError{fmt::format(
          "device_mount.carried_force_n has {:g} N; it must have <= {:g} N, what the device holds", weight, most)};
    if (mount.clutch_button >= info_.buttons && mount.clutch_button >= 0)
      throw ConfigError{fmt::format(
          "device_mount.clutch_button is {}, but the device ({}) has {} buttons; it must be {}", mount.clutch_button,
          info_.name, info_.buttons,
          info_.buttons == 0 ? "-1, for none" : fmt::format("from 0 to {}, or -1 for none", info_.buttons - 1))};
  }

  [[nodiscard]] DeviceInfo info() const override { return info_; }
  DeviceSample<N> sense(const Tick<MasterClock>& tick) noexcept override {
    DeviceSample<N> s = device_->sense(tick);
    watch(s, tick.ended);
    if (continuous_n_ < peak_n_) [[unlikely]]
      warm(s.applied, tick.ended.si());
    if (maps_ || works_) [[unlikely]]
      map(s, tick.ended.si());
    if (gain_ < 1.0 && !let_go_) [[unlikely]]
      gain_ = std::min(1.0, gain_ + tick.ended.si() / std::max(m_.engage_s, 1e-9));
    return s;
  }
  void actuate(const Force<N>& f) noexcept override {
    if (let_go_) [[unlikely]]
      return;
    if (!f.finite()) [[unlikely]] {
      device_->release();
      let_go_ = true;
      return;
    }
    Force<N> command = f;
    if (works_) [[unlikely]]
      command = transformer_.to_hand(f);
    if (maps_) [[unlikely]]
      command = Force<N>{to_device(command.vec())};
    if (gain_ < 1.0) [[unlikely]]
      command = gain_ * command;
    if (continuous_n_ < peak_n_) [[unlikely]]
      command = cooled(command);
    device_->actuate(carries_ ? within_peak(command + carried_) : command);
  }
  void start() noexcept override { device_->start(); }
  void release() noexcept override { device_->release(); }
  [[nodiscard]] std::string trouble() const override { return device_->trouble(); }
  [[nodiscard]] Device<1>* gripper() noexcept override { return device_->gripper(); }
  /// Has the watchdog released the device?
  [[nodiscard]] bool lets_go() const noexcept { return let_go_; }
  [[nodiscard]] const DeviceTruth<N>* truth() const noexcept override {
    return device_->truth() == nullptr ? nullptr : maps_ || works_ ? &truth_ : device_->truth();
  }

  /// Call between ticks.
  void control(const HandControls& to) noexcept {
    use();
    transformer_.set(to);
  }
  void rehome() noexcept {
    use();
    transformer_.rehome();
  }
  /// Null: none of its controls has been used.
  [[nodiscard]] const ModulatedTransformer<N>* transformer() const noexcept { return works_ ? &transformer_ : nullptr; }
  [[nodiscard]] HandControls controls() const noexcept { return transformer_.controls(); }

 private:
  void use() noexcept {
    if (works_) return;
    works_ = true;
    if (!maps_ && device_->truth()) truth_ = *device_->truth();
  }

  using Vector = typename Force<N>::Vector;
  static constexpr double kHeat = 10.0;  ///< time constant of a motor's winding, at the short end [s]

  /// A device that states none, or no force at all, has no continuous force.
  static double limit_of(const DeviceInfo& info) {
    return info.continuous_force_n > 0.0 ? info.continuous_force_n : info.max_force_n;
  }
  static DeviceInfo in_world(DeviceInfo info, const DeviceMount& m) {
    info.max_force_n /= m.scale;
    info.continuous_force_n /= m.scale;
    info.limits.force_n /= m.scale;
    info.limits.speed_m_per_s *= m.scale;
    info.limits.workspace_m = info.limits.workspace_m * m.scale + m.position_m.norm();
    info.mass_kg /= m.scale * m.scale;
    for (double& extent : info.workspace_m) extent *= m.scale;
    info.resolution_m *= m.scale;
    return info;
  }

  static constexpr int kWorldAxes = N == kJointPort ? 0 : kAxes<N>;  ///< joints are no axes of the world
  /// Of translation and rotation apart, with the translation scaled by s.
  template <class Turn>
  static Vector each(const Vector& v, double s, Turn turn) noexcept {
    Vector out;
    if constexpr (N == 3) {
      out = s * turn(v);
    } else if constexpr (N != 6) {
      out = s * v;
    } else {
      out.template head<3>() = s * turn(v.template head<3>());
      out.template tail<3>() = turn(v.template tail<3>());
    }
    return out;
  }
  [[nodiscard]] Vector to_world(const Vector& v) const noexcept {
    return each(v, m_.scale, [&](const Eigen::Vector3d& a) -> Eigen::Vector3d { return m_.rotation * a; });
  }
  [[nodiscard]] Vector to_device(const Vector& f) const noexcept {
    return each(f, m_.scale, [&](const Eigen::Vector3d& a) -> Eigen::Vector3d { return m_.rotation.conjugate() * a; });
  }
  [[nodiscard]] Vector turned_back(const Vector& f) const noexcept {
    return each(f, 1.0, [&](const Eigen::Vector3d& a) -> Eigen::Vector3d { return m_.rotation.conjugate() * a; });
  }
  [[nodiscard]] Position<N> placed(const Position<N>& x) const noexcept {
    if constexpr (N == 6) {
      const Eigen::Vector3d p = m_.scale * (m_.rotation * x.translation()) + m_.position_m;
      return {p, m_.rotation * x.attitude() * m_.rotation.conjugate()};
    } else {
      Vector p = to_world(x.translation());
      for (int i = 0; i < kWorldAxes; ++i) p[i] += m_.position_m[i];
      return Position<N>{p};
    }
  }

  void watch(DeviceSample<N>& s, Seconds ended) noexcept {
    const bool finite = all_finite(s.x, s.v, s.applied), fresh = finite && s.status == HardwareStatus::ok;
    silent_s_ = fresh ? 0.0 : silent_s_ + ended.si();
    if (finite) [[likely]] {
      last_ = s;
      any_ = true;
    } else if (any_) {
      const HardwareStatus status = std::max(s.status, HardwareStatus::stale);
      s = last_;
      s.v = Velocity<N>{};
      s.status = status;
    }
    if (silent_s_ >= m_.let_go_after_s || !finite) [[unlikely]] {
      if (!let_go_) device_->release();
      let_go_ = true;
    } else if (let_go_ && fresh) {
      let_go_ = false;
    }
    // Nobody knows where the hand is.
    if (let_go_) s.held = false;
    if (let_go_) gain_ = 0.0;
  }

  void map(DeviceSample<N>& s, double ended_s) noexcept {
    s.x = placed(s.x);
    s.v = Velocity<N>{to_world(s.v.vec())};
    const Vector applied = s.applied.vec() - carried_.vec();
    s.applied = Force<N>{
        each(applied, 1.0 / m_.scale, [&](const Eigen::Vector3d& a) -> Eigen::Vector3d { return m_.rotation * a; })};
    if (const DeviceTruth<N>* truth = device_->truth()) {
      truth_ = *truth;
      truth_.x = placed(truth->x);
      truth_.v = Velocity<N>{to_world(truth->v.vec())};
    }
    const bool pressed = m_.clutch_button >= 0 && (s.buttons >> m_.clutch_button & 1u) != 0;
    if (works_) transformer_.step(s, truth_, pressed, ended_s, m_.engage_s);
  }
  void warm(const Force<N>& f, double dt_s) noexcept {
    const double share = translation(f).squaredNorm() / (continuous_n_ * continuous_n_);
    if (std::isfinite(share)) heat_ += std::min(dt_s / kHeat, 1.0) * (share - heat_);
  }
  Force<N> cooled(const Force<N>& f) noexcept {
    const double norm = translation(f).norm(), cold = std::clamp(5.0 * (1.0 - heat_), 0.0, 1.0);
    const double most =
        std::isinf(peak_n_) ? continuous_n_ / (1.0 - cold) : continuous_n_ + cold * (peak_n_ - continuous_n_);
    return norm > most ? (most / norm) * f : f;
  }
  Force<N> within_peak(const Force<N>& f) const noexcept {
    const double norm = translation(f).norm();
    return norm > peak_n_ ? (peak_n_ / norm) * f : f;
  }
  static auto translation(const Force<N>& f) noexcept { return f.vec().template head<kAxes<N>>(); }

  std::shared_ptr<Device<N>> device_;
  DeviceMount m_;
  bool maps_, works_;  ///< works_: the operator has a clutch, or has used a control
  DeviceInfo info_;
  double peak_n_, continuous_n_, heat_ = 0.0;
  Force<N> carried_;  ///< in device axes
  bool carries_ = false;

  DeviceSample<N> last_;  ///< the last one that was finite
  bool any_ = false;
  double silent_s_ = 0.0, gain_ = 1.0;
  bool let_go_ = false;
  ModulatedTransformer<N> transformer_;
  DeviceTruth<N> truth_;
};

/// Every robot. What its force sensor carries is no force on the environment: with R the tool's attitude,
///
///     f = f_s - R b + m g       τ = τ_s - R b_τ + (R c) × m g
///
/// for a reading (f_s, τ_s) of force and torque on tool and environment, b its bias, m and c mass and centre of the tool, g gravity; then
/// what zero_sensor() takes away (SensorZero).
/// In place of a reading that is not finite stands the last one, stale and at rest, and the robot is released until the next one.
/// A robot that obeys positions only is moved by an Admittance, whose body is then what readings show.
template <int N>
class MountedRobot final : public Robot<N> {
 public:
  MountedRobot(std::shared_ptr<Robot<N>> robot, const RobotMount& mount)
      : robot_{std::move(robot)}, m_{mount}, zero_{robot_->info().has_force_sensor} {
    const Eigen::Vector3d weight = m_.tool_mass_kg * m_.gravity_m_per_s2;
    for (int i = 0; i < std::min(N, 3); ++i) fixed_[i] = (N == 1 ? 0.0 : weight[i]) - (N == 6 ? 0.0 : m_.bias[i]);
    corrects_ = m_.tool_mass_kg > 0.0 || m_.bias.squaredNorm() > 0.0;
    const RobotInfo info = robot_->info();
    if (!info.servo) return;
    if (!info.has_force_sensor)
      throw ConfigError{
          fmt::format("the robot ({}) obeys positions only and has no force sensor; it must have one: without it "
                      "nothing tells how far "
                      "it may press",
                      info.name)};
    admittance_.emplace(*info.servo);
  }

  [[nodiscard]] RobotInfo info() const override { return robot_->info(); }
  RobotSample<N> sense(const Tick<SlaveClock>& tick) noexcept override {
    RobotSample<N> s = robot_->sense(tick);
    const bool let_go = lets_go_;
    lets_go_ = !all_finite(s.x, s.v, s.f_environment);
    if (lets_go_ && any_) [[unlikely]] {
      release();
      const HardwareStatus status = std::max(s.status, HardwareStatus::stale);
      s = last_;
      s.v = Velocity<N>{};
      s.status = status;
    } else if (!lets_go_) {
      last_ = s;
      if (admittance_ && !any_) admittance_->rest(s.x);
      if (admittance_ && let_go) admittance_->resume(s.x);
      any_ = true;
    }
    const Force<N> reading = s.f_environment;
    if (corrects_) correct(s);
    s.f_environment = zero_.step(s.f_environment, s.x, commanded_, tick.ended, s.status == HardwareStatus::ok);
    taken_ = reading - s.f_environment;
    if (admittance_) [[unlikely]] {
      dt_ = tick.dt;
      felt_ = s.f_environment;
      s.x = admittance_->x();
      s.v = admittance_->v();
      s.ideal = false;
    }
    return s;
  }
  void actuate(const RobotCommand<N>& command) noexcept override {
    if (!all_finite(command.f, command.x_d, command.v_d)) [[unlikely]]
      return release();
    if (lets_go_) return;
    commanded_ = command.f;
    if (!admittance_) {
      RobotCommand<N> mounted = command;
      mounted.not_of_environment = taken_;
      return robot_->actuate(mounted);
    }
    admittance_->step(command.f, felt_, dt_);
    robot_->actuate({.f = command.f, .x_d = admittance_->x(), .v_d = admittance_->v()});
  }
  void start() noexcept override { robot_->start(); }
  void release() noexcept override {
    commanded_ = Force<N>{};
    if (admittance_) admittance_->stop();
    robot_->release();
  }
  [[nodiscard]] std::string trouble() const override { return robot_->trouble(); }
  [[nodiscard]] Robot<1>* gripper() noexcept override { return robot_->gripper(); }
  [[nodiscard]] AdjustableEnvironment* environment() noexcept override { return robot_->environment(); }
  /// Asks to zero the force sensor. Call between ticks.
  void zero_sensor() noexcept { zero_.ask(); }
  [[nodiscard]] const SensorRest& sensor() const noexcept { return zero_.rest(); }
  /// Was the last reading not finite, so that the robot was released?
  [[nodiscard]] bool lets_go() const noexcept { return lets_go_; }
  [[nodiscard]] const RobotTruth<N>* truth() const noexcept override { return robot_->truth(); }
  [[nodiscard]] const Position<N>* tool() const noexcept override { return admittance_ ? &last_.x : robot_->tool(); }

 private:
  void correct(RobotSample<N>& s) const noexcept {
    typename Force<N>::Vector f = s.f_environment.vec() + fixed_;
    if constexpr (N == 6) {
      const Eigen::Quaterniond& q = s.x.attitude();
      const Eigen::Vector3d arm = q * m_.tool_center_m, weight = m_.tool_mass_kg * m_.gravity_m_per_s2;
      f.template head<3>() -= q * Eigen::Vector3d{m_.bias.template head<3>()};
      f.template tail<3>() += arm.cross(weight) - q * Eigen::Vector3d{m_.bias.template tail<3>()};
    }
    s.f_environment = Force<N>{f};
  }

  std::shared_ptr<Robot<N>> robot_;
  RobotMount m_;
  typename Force<N>::Vector fixed_ = Force<N>::Vector::Zero();
  RobotSample<N> last_;  ///< the last one that was finite
  bool corrects_, any_ = false, lets_go_ = false;
  SensorZero<N> zero_;
  Force<N> commanded_;                       ///< by the last command; none while the robot is released
  std::optional<Admittance<N>> admittance_;  ///< of a robot that obeys positions only
  Force<N> felt_;                            ///< by its sensor, at the last reading
  Force<N> taken_;                           ///< from that reading
  Seconds dt_{};
};

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
