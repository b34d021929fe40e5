#pragma once

#include <pthread.h>
#include <sys/eventfd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/arm/arm_model.h"
#include "common/hardware/status.h"
#include "common/safety/limits.h"
#include "common/scene/scene.h"
#include "common/scene/servos.h"
#include "drivers/dynamixel_port.h"
#include "drivers/joint_velocity.h"
#include "drivers/newest.h"

namespace twoport::dynamixel {

using namespace std::chrono_literals;

inline constexpr Duration kSilence = 100ms;     // without a command of the control its torque is zero
inline constexpr Duration kLongestPause = 2ms;  // between two readings
inline constexpr Duration kAnswer = 2ms;        // beside the time on the wire
inline constexpr int kGoneMs = 6;  // a servo that has not answered for so long is not there, unless ARGS say otherwise
inline constexpr int kMostGoneMs = 200;  // a servo that restarts is silent for longer
inline constexpr Duration kStop = 80ms;  // after which the servos' own watchdog may have released them
inline constexpr std::uint32_t kWatchdogSteps = 5;
inline constexpr Duration kCheckPause = 100ms;   // between two readings of what changes seldom
inline constexpr std::uint32_t kHeatMargin = 5;  // below the limit of the servo [deg C]
inline constexpr Duration kPatience = 50ms;      // for an answer before there is a loop
inline constexpr double kLift_s = 1.0;           // in which the motors take the weight
inline constexpr double kFrictionShare = 0.7;    // that is compensated; the rest brakes
inline constexpr double kFrictionSpeed = 0.1;    // from which on it is [rad/s]
inline constexpr double kObserver = 63.0;        // rate of the observed torque [1/s]
inline constexpr int kPriority = 70;             // below the control loop's
inline constexpr double kRadPerCount = 2.0 * std::numbers::pi / kCountsPerTurn;

using Axes = Force<kJointPort>::Vector;

/// Of the joints; zero from the last one on.
struct Reading {
  Axes q = Axes::Zero(), v = Axes::Zero();
  /// Held since the reading before, of the motors on the arm, beside those of weight and friction.
  Axes torque = Axes::Zero();
  Axes outside = Axes::Zero();  ///< of whatever touches the arm, on it
};

/// A servo in its joint.
struct Servo {
  std::uint8_t id = 0;
  double sign = 1.0, zero_rad = 0.0, torque_per_count_n_m = 0.0;
  std::uint32_t most_counts = 0, hottest = 0;              ///< of the current; [deg C]
  double friction_n_m = 0.0, damping_n_m_s_per_rad = 0.0;  ///< of the joint
  JointVelocity velocity{kRadPerCount};
  std::uint32_t counts = 0, next = 0, heat = 0, torque = 1, watchdog = kWatchdogSteps;
  bool watched = true;                      ///< it held its watchdog when that was read before
  double angle_rad = 0.0, turns_rad = 0.0;  ///< since it was switched on; whole turns of the joint
  bool answered = false;

  /// By less than half a turn, whether or not the servo counts turns.
  void turn(std::uint32_t to) noexcept {
    const auto by = static_cast<int>((to - counts) % kCountsPerTurn);
    angle_rad += kRadPerCount * (2 * by < kCountsPerTurn ? by : by - kCountsPerTurn);
    counts = to;
  }
  [[nodiscard]] double q() const noexcept { return sign * (angle_rad - zero_rad) + turns_rad; }
  /// That brakes the joint at v.
  [[nodiscard]] double friction(double v) const noexcept {
    return friction_n_m * std::clamp(v / kFrictionSpeed, -1.0, 1.0);
  }
};

/// The servos of an arm in current control, and the thread that talks to them: currents go and positions come after every command, and
/// kLongestPause after the last time. Every kCheckPause temperatures, torques or watchdogs are read, in turns. A servo that does not
/// answer, has no torque, is hot or reports an error of its hardware releases all, for good.
///
///     τ_motor = τ + g(q) + 0.7 τ_c σ      σ = clamp(q̇ / 0.1 rad/s, -1, 1)      within the servo's limit, in its steps
///
/// τ_c: Coulomb friction. What touches the arm is observed by its momentum, which changes by that and by what is known
/// (A. De Luca, R. Mattone, IEEE ICRA 2005; centrifugal torques are left out):
///
///     r = 63/s (M q̇ - ∫ (τ - 0.3 τ_c σ - d q̇ + r) dt)
class ServoArm {
 public:
  /// Throws ConfigError, which `words` begins.
  ServoArm(std::string words, const std::string& port, int baud, const std::string& servos, const ArmSpec& arm,
           Seconds period, Duration gone)
      : words_{std::move(words)},
        port_{words_, port, baud},
        byte_{to_duration(10.0 / baud)},
        pause_{std::min(to_duration(1.5 * period.si()), kLongestPause)},
        gone_{gone},
        model_{*arm.parameters, {.mass_kg = arm.tool_mass_kg, .center_m = vector<3>(arm.tool_center_m)}} {
    find(servos, arm, baud);
    name += " at " + port;
    place(arm);
    for (const Servo& s : servos_) {
      set(s.id, kGoalCurrent, 0);
      set(s.id, kTorqueEnable, 1);
    }
    for (const Servo& s : servos_) set(s.id, kBusWatchdog, kWatchdogSteps);
    thread_ = std::thread{[this] { run(); }};
  }
  ~ServoArm() {
    going_ = false;
    eventfd_write(wake_, 1);
    thread_.join();
    close(wake_);
  }
  ServoArm(const ServoArm&) = delete;

  // Of the control step.
  HardwareStatus read(Reading& reading) noexcept {
    const bool fresh = readings_.take(reading);
    if (failed_.load(std::memory_order_acquire)) return HardwareStatus::fault;
    return fresh ? HardwareStatus::ok : HardwareStatus::stale;
  }
  /// The torque of the motors beside those of weight and friction.
  void drive(const Axes& torque) noexcept {
    commands_.put(torque);
    eventfd_write(wake_, 1);
  }

  [[nodiscard]] std::string trouble() const { return failed_.load(std::memory_order_acquire) ? trouble_ : ""; }
  [[nodiscard]] PortLimits limits() const {
    PortLimits all;
    for (std::size_t i = 0; i < servos_.size(); ++i)
      all.joints.effort[static_cast<Eigen::Index>(i)] = servos_[i].torque_per_count_n_m * servos_[i].most_counts;
    return all;
  }
  std::string name;  ///< models, port and where the servos stand

 private:
  using Now = Port::Now;
  using Joints = ArmModel::Joints;

  // ---- before there is a thread
  [[noreturn]] void refuse(const std::string& why) {
    let_go();
    throw ConfigError{words_ + ": " + why};
  }
  std::optional<Message> ask(const Message& request) {
    for (int tries = 3; tries > 0; --tries) {
      port_.ask(request);
      const auto until = Now::now() + kPatience;
      while (const auto status = port_.answer(until))
        if (status->id == request.id) return status;
    }
    return {};
  }
  std::uint32_t get(std::uint8_t id, Item item) {
    const auto status =
        ask(Message{.id = id, .instruction = Instruction::read}.add(item.address, 2).add(item.bytes, 2));
    if (!status || status->size != 1u + item.bytes)
      refuse(fmt::format("servo {} does not say what it holds at address {}", id, item.address));
    return status->at(1, item.bytes);
  }
  /// Where it holds another value: its memory wears.
  void set(std::uint8_t id, Item item, std::uint32_t value) {
    if (get(id, item) == value) return;
    ask(Message{.id = id, .instruction = Instruction::write}.add(item.address, 2).add(value, item.bytes));
    if (get(id, item) != value) refuse(fmt::format("servo {} does not take {} at address {}", id, value, item.address));
  }
  void find(const std::string& file, const ArmSpec& arm, int baud) {
    std::vector<ServoMount> mounts;
    for (int id = 1; id <= model_.size(); ++id) mounts.push_back({.id = id});
    if (!file.empty()) mounts = load_servos(file, model_.size());
    for (const ServoMount& m : mounts)
      servos_.push_back(
          {.id = static_cast<std::uint8_t>(m.id), .sign = m.reversed ? -1.0 : 1.0, .zero_rad = m.zero_rad});
    tell_all(kStatusReturn, 2);
    tell_all(kTorqueEnable, 0);
    std::set<std::string> models;
    for (std::size_t i = 0; i < servos_.size(); ++i) {
      Servo& s = servos_[i];
      const auto status = ask({.id = s.id, .instruction = Instruction::ping});
      if (!status)
        refuse(fmt::format("no servo {} answers at {} baud; is it powered, has it this id and rate?", s.id, baud));
      const Model* const model = model_of(status->at(1, 2));
      if (!model)
        refuse(fmt::format("servo {} is of model {}; it must be one with current control: {}", s.id, status->at(1, 2),
                           known()));
      if ((status->parameters[0] & kAlert) != 0)
        refuse(fmt::format("servo {} reports {}; switch its power off and on", s.id,
                           hardware_error_words(get(s.id, kHardwareError))));
      models.insert(model->name);
      set(s.id, kBusWatchdog, 0);
      set(s.id, kOperatingMode, kCurrentMode);
      set(s.id, kReturnDelay, 0);
      s.hottest = get(s.id, kTemperatureLimit);
      s.most_counts = get(s.id, kCurrentLimit);
      s.torque_per_count_n_m =
          model->current_unit_a * mounts[i].torque_per_current_n_m_per_a.value_or(model->torque_per_current_n_m_per_a);
      s.friction_n_m = arm.parameters->joints[i].coulomb_friction.value_or(0.0);
      s.damping_n_m_s_per_rad = arm.parameters->joints[i].damping.value_or(0.0);
    }
    name = fmt::format("{} Dynamixel servos {}", servos_.size(), fmt::join(models, ", "));
  }
  static std::string known() {
    std::string names;
    for (const Model& each : kModels) names += (names.empty() ? "" : ", ") + std::string{each.name};
    return names;
  }
  /// Within their ranges.
  void place(const ArmSpec& arm) {
    std::string angles;
    for (std::size_t i = 0; i < servos_.size(); ++i) {
      Servo& s = servos_[i];
      const ArmJoint& joint = arm.parameters->joints[i];
      s.turn(get(s.id, kPosition));
      const double middle = joint.type == JointType::continuous ? 0.0 : 0.5 * (joint.lower + joint.upper);
      s.turns_rad = -2.0 * std::numbers::pi * std::round((s.q() - middle) / (2.0 * std::numbers::pi));
      angles += fmt::format(" {:.3f}", s.angle_rad);
    }
    name += ", which stand at" + angles + " rad";
    for (std::size_t i = 0; i < servos_.size(); ++i) {
      const ArmJoint& joint = arm.parameters->joints[i];
      const double q = reading_.q[static_cast<Eigen::Index>(i)] = servos_[i].q();
      if (!(q >= joint.lower && q <= joint.upper))
        refuse(
            fmt::format("joint {} is at {:.3f} rad, beyond its range from {:g} to {:g}; is zero_rad right? The servos "
                        "stand at{} rad",
                        i + 1, q, joint.lower, joint.upper, angles));
    }
    pose_ = model_.pose(Joints{reading_.q.head(model_.size())});
    readings_.put(reading_);
  }

  // ---- in the thread
  void tell_all(Item item, std::uint32_t value) noexcept {
    Message m = to_all(Instruction::sync_write, item);
    for (const Servo& s : servos_) m.add(s.id, 1).add(value, item.bytes);
    port_.tell(m);
  }
  static Message to_all(Instruction instruction, Item item) noexcept {
    return Message{.id = kEveryServo, .instruction = instruction}.add(item.address, 2).add(item.bytes, 2);
  }
  void watch() noexcept {
    tell_all(kBusWatchdog, 0);
    tell_all(kBusWatchdog, kWatchdogSteps);
  }
  void let_go() noexcept {
    tell_all(kGoalCurrent, 0);
    tell_all(kTorqueEnable, 0);
  }
  void fail(const Servo& s, const std::string& why) {
    let_go();
    trouble_ = fmt::format("servo {} {}; all are released", s.id, why);
    failed_.store(true, std::memory_order_release);
  }
  Axes wanted(Now::time_point now) noexcept {
    if (commands_.take(command_)) commanded_at_ = now;
    const bool stands = now - commanded_at_ <= kSilence && command_.allFinite();
    return stands ? command_ : Axes{Axes::Zero()};
  }
  void push(const Axes& torque, Now::time_point now) noexcept {
    if (now - pushed_at_ > kStop) watch();
    const double span = to_seconds(now - pushed_at_).si();
    impulse_ += span * held_;
    impulse_s_ += span;
    pushed_at_ = now;
    const double lift = std::min(1.0, to_seconds(now - began_).si() / kLift_s);
    const Joints weight = lift * model_.gravity_torque(pose_, {0.0, 0.0, -9.81});
    Message m = to_all(Instruction::sync_write, kGoalCurrent);
    for (std::size_t i = 0; i < servos_.size(); ++i) {
      const Servo& s = servos_[i];
      const auto axis = static_cast<Eigen::Index>(i);
      const double inner = weight[axis] + kFrictionShare * s.friction(reading_.v[axis]);
      const double one = s.sign * s.torque_per_count_n_m, most = s.most_counts;
      const double counts = std::clamp(std::round((torque[axis] + inner) / one), -most, most);
      m.add(s.id, 1).add(static_cast<std::uint32_t>(static_cast<int>(counts)), kGoalCurrent.bytes);
      held_[axis] = one * counts - inner;
    }
    port_.tell(m);
  }
  /// Null: all have answered. Else one that has not.
  const Servo* sense(Item item, Now::time_point until) noexcept {
    Message m = to_all(Instruction::sync_read, item);
    for (Servo& s : servos_) {
      m.add(s.id, 1);
      s.answered = false;
    }
    const auto asked = Now::now();
    port_.ask(m);
    const auto silent = [this] {
      return std::find_if(servos_.begin(), servos_.end(), [](const Servo& s) { return !s.answered; });
    };
    while (silent() != servos_.end()) {
      const auto status = port_.answer(until);
      if (!status) return &*silent();
      const auto s =
          std::find_if(servos_.begin(), servos_.end(), [&](const Servo& each) { return each.id == status->id; });
      if (s == servos_.end() || status->size != 1u + item.bytes) continue;
      s->answered = true;
      if (item.address == kTorqueEnable.address)
        s->torque = status->at(1, 1);
      else if (item.address == kBusWatchdog.address)
        s->watchdog = status->at(1, 1);
      else
        s->next = status->at(1 + kPositionInMotion, 4);
      if (item.bytes > kTemperatureInMotion) s->heat = status->at(1 + kTemperatureInMotion, 1);
      if ((status->parameters[0] & kAlert) != 0) alert_ = &*s;
    }
    if (item.address != kMotion.address) return nullptr;
    take(to_seconds(asked - asked_at_).si());
    asked_at_ = asked;
    return nullptr;
  }
  /// The positions that have come, `dt` after those before.
  void take(double dt) noexcept {
    for (std::size_t i = 0; i < servos_.size(); ++i) {
      Servo& s = servos_[i];
      const auto axis = static_cast<Eigen::Index>(i);
      s.turn(s.next);
      reading_.q[axis] = s.q();
      reading_.v[axis] = s.velocity.add(s.q(), dt);
    }
    reading_.torque = impulse_ / std::max(impulse_s_, 1e-9);
    impulse_.setZero();
    impulse_s_ = 0.0;
    pose_ = model_.pose(Joints{reading_.q.head(model_.size())});
    const Joints momentum = model_.inertia(pose_) * Joints{reading_.v.head(model_.size())};
    for (std::size_t i = 0; i < servos_.size(); ++i) {
      const Servo& s = servos_[i];
      const auto axis = static_cast<Eigen::Index>(i);
      const double v = reading_.v[axis];
      const double brakes = (1.0 - kFrictionShare) * s.friction(v) + s.damping_n_m_s_per_rad * v;
      expected_[axis] += std::min(dt, 0.01) * (reading_.torque[axis] - brakes + reading_.outside[axis]);
      reading_.outside[axis] = kObserver * (momentum[axis] - expected_[axis]);
    }
    readings_.put(reading_);
  }
  void exchange() {
    const auto now = Now::now();
    push(wanted(now), now);
    const bool check = now - checked_at_ > kCheckPause;
    const Item item = check ? kChecked[checks_ % kChecked.size()] : kMotion;
    const auto n = static_cast<int>(servos_.size());
    const auto bytes = 2 * (16 + 4 * n) + n * (12 + item.bytes);
    // What this thread itself is late by does not count.
    const Duration wait = std::min(bytes * byte_ + kAnswer, gone_ - silence_);
    if (const Servo* const silent = sense(item, now + wait)) {
      silence_ += wait;
      if (silence_ >= gone_) fail(*silent, "does not answer");
      return;
    }
    silence_ = {};
    if (check) {
      checked_at_ = now;
      ++checks_;
    }
    if (const Servo* const s = std::exchange(alert_, nullptr)) {
      let_go();
      port_.ask(Message{.id = s->id, .instruction = Instruction::read}
                    .add(kHardwareError.address, 2)
                    .add(kHardwareError.bytes, 2));
      const auto status = port_.answer(Now::now() + kPatience);
      return fail(*s, "reports " + hardware_error_words(status ? status->at(1, 1) : 0));
    }
    for (Servo& s : servos_) {
      if (s.heat + kHeatMargin > s.hottest)
        return fail(s, fmt::format("is at {} deg C, and it stops by itself at {}", s.heat, s.hottest));
      if (s.torque == 0) return fail(s, "has switched its torque off: it has restarted, or its supply is too weak");
      if (item.address != kBusWatchdog.address) continue;
      // The servos' own one may just have released them, or a packet was lost.
      const bool before = std::exchange(s.watched, s.watchdog == kWatchdogSteps);
      if (!s.watched && !before) return fail(s, "does not keep its watchdog");
      if (!s.watched) watch();
    }
  }
  void run() {
    // Refused to a user who may not: then at ordinary priority.
    const sched_param priority{kPriority};
    pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority);
    began_ = pushed_at_ = asked_at_ = Now::now();
    while (going_) {
      failed_ ? let_go() : exchange();
      pollfd woken{wake_, POLLIN, 0};
      const timespec t{0, pause_.count()};
      ppoll(&woken, 1, silence_ == Duration{} || failed_ ? &t : &kAtOnce, nullptr);
      eventfd_t times;
      eventfd_read(wake_, &times);
    }
    let_go();
  }
  static constexpr timespec kAtOnce{0, 0};
  static constexpr std::array kChecked{kMotionAndHeat, kTorqueEnable, kBusWatchdog};

  std::string words_;
  Port port_;
  Duration byte_, pause_, gone_;  ///< on the wire; for a command; for an answer
  ArmModel model_;
  std::vector<Servo> servos_;
  Reading reading_;
  ArmModel::Pose pose_;  ///< of the last reading
  Axes command_ = Axes::Zero(), held_ = Axes::Zero();
  Axes impulse_ = Axes::Zero(),
       expected_ = Axes::Zero();  ///< of held since the last reading; momentum as far as it is known
  double impulse_s_ = 0.0;
  Now::time_point began_, pushed_at_, asked_at_, checked_at_, commanded_at_;
  std::size_t checks_ = 0;
  Duration silence_{};  ///< that has been waited for an answer since the last reading
  const Servo* alert_ = nullptr;
  Newest<Reading> readings_;
  Newest<Axes> commands_;
  std::string trouble_;
  std::atomic<bool> failed_{false}, going_{true};
  const int wake_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  std::thread thread_;
};

}  // namespace twoport::dynamixel
