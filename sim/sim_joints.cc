#include "sim/sim_joints.h"

#include <optional>
#include <vector>

namespace twoport::sim {
namespace {

std::optional<HandOnTool> hand_of(const Scene& scene, const Position<6>& intended) {
  if (!scene.operator_model || !scene.operator_model->hand) return {};
  HandOnTool hand{*scene.operator_model->hand, intended, intended};
  if (const auto& finger = scene.finger) {
    hand.finger_stiffness = finger->stiffness_n_per_m, hand.finger_damping = finger->damping_n_s_per_m;
    hand.opening = hand.next_opening = scene.device->arm->joint_position_rad.back();
  }
  return hand;
}

}  // namespace

SimDevice<kJointPort>::SimDevice(const Scene& scene, Seconds dt)
    : dt_{dt.si()},
      path_{scene.operator_model ? scene.operator_model->path : std::vector<SegmentSpec>{}, Position<6>{},
            scene.operator_model && scene.operator_model->tremor ? Tremor<6>{*scene.operator_model->tremor, scene.seed}
                                                                 : Tremor<6>{}},
      opening_{scene.finger ? scene.finger->path : std::vector<SegmentSpec>{},
               position<1>({scene.device->arm->joint_position_rad.back()})} {
  const std::optional<HandOnTool> hand = hand_of(scene, path_.at(0.0).x);
  led_ = hand.has_value();
  const auto nothing = std::make_shared<const Environment<6>>(std::vector<EnvironmentSpec>{});
  arm_ = std::make_unique<ArmPlant>(*scene.device->arm, nothing, dt_, Position<6>{}, hand);
  state_ = arm_->joints();
  encoder_ = {*scene.device, dt_};
  encoder_.start(x(), v());
}

void SimDevice<kJointPort>::advance() noexcept {
  ++tick_;
  if (led_) {
    arm_->lead(path_.at(static_cast<double>(tick_) * dt_).x);
    arm_->lead_finger(opening_.at(static_cast<double>(tick_) * dt_).x.translation()[0]);
  }
  arm_->advance_joints(-held_);
  applied_ = arm_->applied_part() * held_;
  state_ = arm_->joints();
  if (!encoder_.ideal()) encoder_.sample(x(), v());
}

bool SimDevice<kJointPort>::kick(const Velocity<N>& dv) noexcept {
  arm_->kick_joints(dv);
  state_ = arm_->joints();
  return true;
}

SimRobot<kJointPort>::SimRobot(const Scene& scene, Seconds dt)
    : environment_{std::make_shared<const Environment<6>>(scene.environment, scene.tool)},
      arm_{std::make_unique<ArmPlant>(*scene.robot->arm, environment_, dt.si(), Position<6>{}, std::nullopt,
                                      scene.object)} {
  if (scene.robot->force_sensor) sensor_ = ForceSensor<N>{*scene.robot->force_sensor, dt, scene.seed};
  read();
}

void SimRobot<kJointPort>::advance() noexcept {
  arm_->advance_joints(command_);
  read();
}

bool SimRobot<kJointPort>::kick(const Velocity<N>& dv) noexcept {
  arm_->kick_joints(dv);
  state_ = arm_->joints();
  return true;
}

void SimRobot<kJointPort>::read() noexcept {
  state_ = arm_->joints();
  from_environment_ = arm_->outside_torque();
  sensed_ = sensor_.sample(from_environment_);
}

}  // namespace twoport::sim
