#pragma once

#include <algorithm>
#include <cmath>
#include <memory>

#include "common/base/built_for.h"
#include "common/hardware/device.h"
#include "common/page/channel.h"
#include "common/scene/scene.h"

namespace twoport {

/// The pointer of the live page as a hand on a handle with mass. Per axis, with f the force at the master port:
///
///     held:      (m_d + m_h) v' = -f - b_d v + k_h (x_h - x) + b_h (v_h - v)
///     released:   m_d        v' = -f - (b_d + b_0) v
///
/// x_h follows the pointer through a critically damped filter of 6 Hz, so that events at 60 Hz neither step nor jerk the
/// handle. Implicit Euler, stable and dissipative at every stiffness; translation and rotation alike. A pointer that the
/// page has not confirmed for 250 ms is released. A gripper is held with the handle; the page says which opening the hand intends.
template <int N>
class PageDevice : public Device<N> {
 public:
  using Vector = typename Force<N>::Vector;

  /// `channel` is null for the gripper of a handle, which the handle holds and moves.
  PageDevice(const Scene& scene, double period_s, PageChannel* channel) : channel_{channel}, dt_{period_s} {
    take(scene);
    if (channel_ == nullptr) return;
    grip_ = std::clamp(grip_, kPageGripLeast, kPageGripMost);
    channel_->pointer.grip_n_per_m = grip_;
    if constexpr (built_for(1))
      if (scene.gripper) gripper_ = std::make_unique<PageDevice<1>>(*scene.gripper, dt_, nullptr);
  }

  void hold(bool held) noexcept {
    if (held && !held_) {
      hand_ = x_;
      hand_v_ = v_;
    }
    held_ = held;
  }
  void aim(const Vector& at) noexcept { target_ = Position<N>{} + Displacement<N>{at}; }

  [[nodiscard]] DeviceInfo info() const override {
    return {.name = "pointer of the page",
            .max_force_n = max_force_n_,
            .mass_kg = mass_,
            .inertia_kg_m2 = inertia_,
            .watchdog = Seconds{kWatchdog},
            .gripper = gripper_ != nullptr};
  }

  DeviceSample<N> sense(const Tick<MasterClock>& tick) noexcept override {
    PageCommand command;
    while (channel_ && channel_->hand.try_pop(command)) obey(command);
    if (begun_) {
      for (long left = std::min(std::lround(tick.ended.si() / dt_), 100L); left > 0; --left) advance();
      since_ += tick.ended.si();
    }
    begun_ = true;
    if (channel_) {
      if (held_ && since_ > kWatchdog) held_ = false;
      channel_->pointer.held = held_;
      if (gripper_) gripper_->hold(held_);
    }
    return {.x = x_, .v = Velocity<N>{v_}, .applied = applied_, .held = held_};
  }
  void actuate(const Force<N>& f) noexcept override { applied_ = f; }
  void release() noexcept override {
    applied_ = Force<N>{};
    held_ = false;
  }
  [[nodiscard]] Device<1>* gripper() noexcept override { return gripper_.get(); }

 private:
  static constexpr double kWatchdog = 0.25;               // without a target of the page the handle is released [s]
  static constexpr double kSmoothing = 2.0 * M_PI * 6.0;  // of the pointer's motion [rad/s]
  static constexpr double kFastest = 1.5;                 // the hand's intended motion [m/s]
  static constexpr double kFreeDamping = 4.0;             // a released handle, besides its own [N s/m]
  static constexpr double kFreeRotationalDamping = 0.02;  // [N m s/rad]

  void take(const Scene& scene) {
    if (scene.device) {
      const DeviceSpec& d = *scene.device;
      if (d.mass_kg > 0.0) mass_ = d.mass_kg;
      if (d.inertia_kg_m2 > 0.0) inertia_ = d.inertia_kg_m2;
      damping_ = d.damping_n_s_per_m;
      rotational_damping_ = d.rotational_damping_n_m_s_per_rad;
      if (d.max_force_n) max_force_n_ = *d.max_force_n;
      x_ = placed(d.position_m);
    }
    if (scene.operator_model && scene.operator_model->hand) {
      const HandSpec& h = *scene.operator_model->hand;
      if (h.mass_kg > 0.0) hand_mass_ = h.mass_kg;
      if (h.inertia_kg_m2 > 0.0) hand_inertia_ = h.inertia_kg_m2;
      if (h.stiffness_n_per_m > 0.0) grip_ = h.stiffness_n_per_m;
      if (h.rotational_stiffness_n_m_per_rad > 0.0) rotational_grip_ = h.rotational_stiffness_n_m_per_rad;
    }
    target_ = hand_ = x_;
  }
  static Position<N> placed(const Numbers& p) {
    if constexpr (N == 6) {
      Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
      if (p.size() >= 7) q = Eigen::Quaterniond{p[3], p[4], p[5], p[6]};
      return p.size() >= 3 ? Position<6>{{p[0], p[1], p[2]}, q} : Position<6>{};
    } else {
      Vector v = Vector::Zero();
      for (std::size_t i = 0; i < std::min<std::size_t>(N, p.size()); ++i) v[static_cast<int>(i)] = p[i];
      return Position<N>{v};
    }
  }

  void obey(const PageCommand& c) noexcept {
    switch (c.kind) {
      case PageCommand::Kind::target: {
        since_ = 0.0;
        Vector to;
        for (int i = 0; i < N; ++i) to[i] = c.number[static_cast<std::size_t>(i)];
        aim(to);
        hold(true);
        break;
      }
      case PageCommand::Kind::release:
        held_ = false;
        break;
      case PageCommand::Kind::grip:
        grip_ = c.number[0];
        break;
      case PageCommand::Kind::opening:
        if (gripper_) gripper_->aim(Force<1>::Vector{c.number[0]});
        break;
      default:
        break;
    }
  }

  /// One period under the force held since the last actuate().
  void advance() noexcept {
    double mass = mass_, inertia = inertia_, b = damping_ + kFreeDamping,
           b_r = rotational_damping_ + kFreeRotationalDamping;
    Vector pull = Vector::Zero();  // of the hand, at the present position and rest
    double k = 0.0, k_r = 0.0;
    if (held_) {
      // Filter: v_h' = w² (target - x_h) - 2 w v_h, implicit.
      const double w = kSmoothing;
      hand_v_ = (hand_v_ + dt_ * w * w * (target_ - hand_).vec()) / (1.0 + 2.0 * w * dt_ + w * w * dt_ * dt_);
      if constexpr (N == 6) {
        limit(hand_v_.template head<3>());
      } else {
        limit(hand_v_);
      }
      hand_ = hand_ + Displacement<N>{Vector{dt_ * hand_v_}};
      mass += hand_mass_;
      inertia += hand_inertia_;
      k = grip_;
      k_r = rotational_grip_;
      // Damping ratio 0.7 of hand and handle.
      const double b_h = 1.4 * std::sqrt(k * mass), b_rh = 1.4 * std::sqrt(k_r * inertia);
      const Vector stretch = (hand_ - x_).vec();
      for (int i = 0; i < N; ++i)
        pull[i] = i < 3 ? k * stretch[i] + b_h * hand_v_[i] : k_r * stretch[i] + b_rh * hand_v_[i];
      b = damping_ + b_h;
      b_r = rotational_damping_ + b_rh;
    }
    const Vector load = pull - applied_.vec();
    for (int i = 0; i < N; ++i) {
      const double m = i < 3 ? mass : inertia, d = i < 3 ? b : b_r, s = i < 3 ? k : k_r;
      v_[i] = (m * v_[i] + dt_ * load[i]) / (m + dt_ * d + dt_ * dt_ * s);
    }
    x_ = x_ + Displacement<N>{Vector{dt_ * v_}};
  }
  template <class Part>
  static void limit(Part&& v) noexcept {
    const double speed = v.norm();
    if (speed > kFastest) v *= kFastest / speed;
  }

  PageChannel* channel_;  ///< null for a gripper
  double dt_;
  double mass_ = 0.1, damping_ = 0.2, inertia_ = 1e-3, rotational_damping_ = 1e-3;
  double hand_mass_ = 0.1, hand_inertia_ = 1e-4, grip_ = 400.0, rotational_grip_ = 5.0;
  double max_force_n_ = 8.0;

  Position<N> x_, hand_, target_;
  Vector v_ = Vector::Zero(), hand_v_ = Vector::Zero();
  Force<N> applied_;
  double since_ = 0.0;  ///< the last target [s]
  bool held_ = false, begun_ = false;
  std::unique_ptr<PageDevice<1>> gripper_;  ///< of the scene; null: none
};

}  // namespace twoport
