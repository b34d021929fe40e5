#pragma once

#include <algorithm>
#include <cmath>
#include <memory>

#include "common/base/built_for.h"
#include "common/hardware/device.h"
#include "common/page/channel.h"
#include "common/scene/scene.h"

namespace twoport {

/// The pointer of the live page as the intended motion x_h of a hand: it follows the pointer through a critically damped filter of 6 Hz,
/// so that events at 60 Hz neither step nor jerk what the hand holds; translation and rotation alike. A pointer that the page has not
/// confirmed for 250 ms is released.
template <int N>
class PointerHand {
 public:
  using Vector = typename Force<N>::Vector;

  PointerHand() = default;
  PointerHand(const Position<N>& x, double grip_n_per_m) : x_{x}, target_{x}, grip_{grip_n_per_m} {}

  [[nodiscard]] const Position<N>& x() const noexcept { return x_; }
  [[nodiscard]] const Vector& v() const noexcept { return v_; }
  [[nodiscard]] double grip_n_per_m() const noexcept { return grip_; }
  [[nodiscard]] bool held() const noexcept { return held_; }

  void aim(const Vector& at) noexcept { target_ = Position<N>{} + Displacement<N>{at}; }
  /// `x`, `v`: of what it takes.
  void hold(bool held, const Position<N>& x, const Vector& v) noexcept {
    if (held && !held_) {
      x_ = x;
      v_ = v;
    }
    held_ = held;
  }
  void release() noexcept { held_ = false; }

  /// target, release and grip; others change nothing.
  void obey(const PageCommand& c, const Position<N>& x, const Vector& v) noexcept {
    if (c.kind == PageCommand::Kind::target) {
      since_ = 0.0;
      Vector to;
      for (int i = 0; i < N; ++i) to[i] = c.number[static_cast<std::size_t>(i)];
      aim(to);
      hold(true, x, v);
    }
    if (c.kind == PageCommand::Kind::release) release();
    if (c.kind == PageCommand::Kind::grip) grip_ = c.number[0];
  }
  /// A period of the program has passed.
  void pass(double ended_s) noexcept { since_ += ended_s; }
  void watch() noexcept {
    if (since_ > kWatchdog) release();
  }

  /// Filter: v_h' = w² (target - x_h) - 2 w v_h, implicit.
  void advance(double dt) noexcept {
    const double w = kSmoothing;
    v_ = (v_ + dt * w * w * (target_ - x_).vec()) / (1.0 + 2.0 * w * dt + w * w * dt * dt);
    if constexpr (N == 6) {
      limit(v_.template head<3>());
    } else {
      limit(v_);
    }
    x_ = x_ + Displacement<N>{Vector{dt * v_}};
  }

  static constexpr double kWatchdog = 0.25;  ///< without a target of the page what it holds is released [s]

 private:
  static constexpr double kSmoothing = 2.0 * M_PI * 6.0;  // of the pointer's motion [rad/s]
  static constexpr double kFastest = 1.5;                 // the hand's intended motion [m/s]

  template <class Part>
  static void limit(Part&& v) noexcept {
    const double speed = v.norm();
    if (speed > kFastest) v *= kFastest / speed;
  }

  Position<N> x_, target_;
  Vector v_ = Vector::Zero();
  double grip_ = 400.0;
  double since_ = 0.0;  ///< the last target [s]
  bool held_ = false;
};

/// The pointer of the live page as a hand on a handle with mass. Per axis, with f the force at the master port:
///
///     held:      (m_d + m_h) v' = -f - b_d v + k_h (x_h - x) + b_h (v_h - v)
///     released:   m_d        v' = -f - (b_d + b_0) v
///
/// Implicit Euler, stable and dissipative at every stiffness; translation and rotation alike. A gripper is held with the handle; the page
/// says which opening the hand intends.
template <int N>
class PageDevice : public Device<N> {
 public:
  using Vector = typename Force<N>::Vector;

  /// `channel` is null for the gripper of a handle, which the handle holds and moves.
  PageDevice(const Scene& scene, double period_s, PageChannel* channel) : channel_{channel}, dt_{period_s} {
    double grip = 400.0;
    take(scene, grip);
    if (channel_) grip = std::clamp(grip, kPageGripLeast, kPageGripMost);
    pointer_ = {x_, grip};
    if (channel_ == nullptr) return;
    channel_->pointer.grip_n_per_m = grip;
    if constexpr (built_for(1))
      if (scene.gripper) gripper_ = std::make_unique<PageDevice<1>>(*scene.gripper, dt_, nullptr);
  }

  void hold(bool held) noexcept { pointer_.hold(held, x_, v_); }
  void aim(const Vector& at) noexcept { pointer_.aim(at); }

  [[nodiscard]] DeviceInfo info() const override {
    return {.name = "pointer of the page",
            .max_force_n = max_force_n_,
            .mass_kg = mass_,
            .inertia_kg_m2 = inertia_,
            .watchdog = Seconds{PointerHand<N>::kWatchdog},
            .gripper = gripper_ != nullptr};
  }

  DeviceSample<N> sense(const Tick<MasterClock>& tick) noexcept override {
    PageCommand command;
    while (channel_ && channel_->hand.try_pop(command)) obey(command);
    if (begun_) {
      for (long left = std::min(std::lround(tick.ended.si() / dt_), 100L); left > 0; --left) advance();
      pointer_.pass(tick.ended.si());
    }
    begun_ = true;
    if (channel_) {
      pointer_.watch();
      channel_->pointer.held = pointer_.held();
      if (gripper_) gripper_->hold(pointer_.held());
    }
    return {.x = x_, .v = Velocity<N>{v_}, .applied = applied_, .held = pointer_.held()};
  }
  void actuate(const Force<N>& f) noexcept override { applied_ = f; }
  void release() noexcept override {
    applied_ = Force<N>{};
    pointer_.release();
  }
  [[nodiscard]] Device<1>* gripper() noexcept override { return gripper_.get(); }

 private:
  static constexpr double kFreeDamping = 4.0;             // a released handle, besides its own [N s/m]
  static constexpr double kFreeRotationalDamping = 0.02;  // [N m s/rad]

  void take(const Scene& scene, double& grip) {
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
      if (h.stiffness_n_per_m > 0.0) grip = h.stiffness_n_per_m;
      if (h.rotational_stiffness_n_m_per_rad > 0.0) rotational_grip_ = h.rotational_stiffness_n_m_per_rad;
    }
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
    pointer_.obey(c, x_, v_);
    if (c.kind == PageCommand::Kind::opening && gripper_) gripper_->aim(Force<1>::Vector{c.number[0]});
  }

  /// One period under the force held since the last actuate().
  void advance() noexcept {
    double mass = mass_, inertia = inertia_, b = damping_ + kFreeDamping,
           b_r = rotational_damping_ + kFreeRotationalDamping;
    Vector pull = Vector::Zero();  // of the hand, at the present position and rest
    double k = 0.0, k_r = 0.0;
    if (pointer_.held()) {
      pointer_.advance(dt_);
      mass += hand_mass_;
      inertia += hand_inertia_;
      k = pointer_.grip_n_per_m();
      k_r = rotational_grip_;
      // Damping ratio 0.7 of hand and handle.
      const double b_h = 1.4 * std::sqrt(k * mass), b_rh = 1.4 * std::sqrt(k_r * inertia);
      const Vector stretch = (pointer_.x() - x_).vec();
      for (int i = 0; i < N; ++i)
        pull[i] = i < 3 ? k * stretch[i] + b_h * pointer_.v()[i] : k_r * stretch[i] + b_rh * pointer_.v()[i];
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

  PageChannel* channel_;  ///< null for a gripper
  double dt_;
  double mass_ = 0.1, damping_ = 0.2, inertia_ = 1e-3, rotational_damping_ = 1e-3;
  double hand_mass_ = 0.1, hand_inertia_ = 1e-4, rotational_grip_ = 5.0;
  double max_force_n_ = 8.0;

  Position<N> x_;
  Vector v_ = Vector::Zero();
  Force<N> applied_;
  PointerHand<N> pointer_;
  bool begun_ = false;
  std::unique_ptr<PageDevice<1>> gripper_;  ///< of the scene; null: none
};

}  // namespace twoport
