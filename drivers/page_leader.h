#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "drivers/page_device.h"
#include "sim/plant/arm.h"

namespace twoport {

/// The pointer of the live page as a hand that holds the tool of a leader: the arm of the scene, with its weight compensated, and the hand
/// of HandOnTool at the pointer's translation and attitude, damped by 0.7 of critical. A released arm is damped besides its own joints'
/// damping, with s of the metric (JointMetric):
///
///     τ = -d s² q̇        d = 2 / s
template <>
class PageDevice<kJointPort> : public Device<kJointPort> {
 public:
  static constexpr int N = kJointPort;
  static constexpr bool kDrivesJoints = true;

  PageDevice(const Scene& scene, double period_s, PageChannel* channel)
      : channel_{channel},
        dt_{period_s},
        mass_kg_{scene.control.handle_mass_kg},
        hand_{hand_of(scene)},
        tool_{*scene.device->arm, hand_},
        free_damping_{kFreeRate * scene.control.joint_scale.cwiseAbs2()},
        arm_{*scene.device->arm, std::make_shared<const Environment<6>>(std::vector<EnvironmentSpec>{}), period_s,
             Position<6>{}, sim::HandOnTool{held_with(kPageGripMost), {}, {}}},
        pointer_{arm_.body().x, std::clamp(hand_.stiffness_n_per_m, kPageGripLeast, kPageGripMost)} {
    channel_->pointer.grip_n_per_m = pointer_.grip_n_per_m();
    arm_.grip({});
  }

  [[nodiscard]] DeviceInfo info() const override {
    return {.name = "pointer of the page", .mass_kg = mass_kg_, .watchdog = Seconds{PointerHand<6>::kWatchdog}};
  }

  DeviceSample<N> sense(const Tick<MasterClock>& tick) noexcept override {
    PageCommand command;
    while (channel_->hand.try_pop(command)) {
      const auto tool = arm_.body();
      pointer_.obey(command, tool.x, tool.v.vec());
    }
    if (begun_) {
      for (long left = std::min(std::lround(tick.ended.si() / dt_), 100L); left > 0; --left) advance();
      pointer_.pass(tick.ended.si());
    }
    begun_ = true;
    pointer_.watch();
    channel_->pointer.held = pointer_.held();
    const auto joints = arm_.joints();
    return {.x = joints.x, .v = joints.v, .applied = applied_, .held = pointer_.held()};
  }
  void actuate(const Force<N>& f) noexcept override { applied_ = f; }
  void release() noexcept override {
    applied_ = Force<N>{};
    pointer_.release();
  }

 private:
  static constexpr double kFreeRate = 2.0;  // [1/s]

  /// The least mass and inertia that the hand may feel at the tool, its own among them.
  struct FeltTool {
    FeltTool(const ArmSpec& arm, const HandSpec& hand) {
      const ArmModel model{*arm.parameters, {.mass_kg = arm.tool_mass_kg, .center_m = vector<3>(arm.tool_center_m)}};
      const Eigen::Matrix<double, 6, 6> mobility = tool_mobility(model, joint_vector(arm.joint_position_rad));
      mass_kg = hand.mass_kg + 1.0 / largest_eigenvalue(mobility.topLeftCorner<3, 3>());
      inertia_kg_m2 = hand.inertia_kg_m2 + 1.0 / largest_eigenvalue(mobility.bottomRightCorner<3, 3>());
    }
    double mass_kg, inertia_kg_m2;
  };

  /// Of the scene, with what it leaves open.
  static HandSpec hand_of(const Scene& scene) {
    HandSpec hand{.mass_kg = 0.1,
                  .stiffness_n_per_m = 400.0,
                  .damping_n_s_per_m = 0.0,
                  .inertia_kg_m2 = 1e-4,
                  .rotational_stiffness_n_m_per_rad = 5.0,
                  .rotational_damping_n_m_s_per_rad = 0.0};
    if (!scene.operator_model || !scene.operator_model->hand) return hand;
    const HandSpec& h = *scene.operator_model->hand;
    if (h.mass_kg > 0.0) hand.mass_kg = h.mass_kg;
    if (h.inertia_kg_m2 > 0.0) hand.inertia_kg_m2 = h.inertia_kg_m2;
    if (h.stiffness_n_per_m > 0.0) hand.stiffness_n_per_m = h.stiffness_n_per_m;
    if (h.rotational_stiffness_n_m_per_rad > 0.0)
      hand.rotational_stiffness_n_m_per_rad = h.rotational_stiffness_n_m_per_rad;
    return hand;
  }
  [[nodiscard]] HandSpec held_with(double grip_n_per_m) const noexcept {
    return {.mass_kg = hand_.mass_kg,
            .stiffness_n_per_m = grip_n_per_m,
            .damping_n_s_per_m = 1.4 * std::sqrt(grip_n_per_m * tool_.mass_kg),
            .inertia_kg_m2 = hand_.inertia_kg_m2,
            .rotational_stiffness_n_m_per_rad = hand_.rotational_stiffness_n_m_per_rad,
            .rotational_damping_n_m_s_per_rad =
                1.4 * std::sqrt(hand_.rotational_stiffness_n_m_per_rad * tool_.inertia_kg_m2)};
  }

  /// One period under the torques held since the last actuate().
  void advance() noexcept {
    Force<N> torque = -applied_;
    if (pointer_.held()) {
      pointer_.advance(dt_);
      arm_.grip(held_with(pointer_.grip_n_per_m()));
      arm_.lead(pointer_.x());
    } else {
      arm_.grip({});
      arm_.lead(arm_.body().x);
      torque = torque - Force<N>{free_damping_.cwiseProduct(arm_.joints().v.vec())};
    }
    arm_.advance_joints(torque);
  }

  PageChannel* channel_;
  double dt_, mass_kg_;
  HandSpec hand_;
  FeltTool tool_;
  Force<N>::Vector free_damping_;
  sim::ArmPlant arm_;
  PointerHand<6> pointer_;
  Force<N> applied_;
  bool begun_ = false;
};

}  // namespace twoport
