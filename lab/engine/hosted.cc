#include "lab/engine/hosted.h"

#include <fmt/format.h>

#include <cstdint>
#include <limits>
#include <vector>

#include "common/base/check.h"
#include "common/base/copied.h"
#include "lab/engine/loops.h"

namespace twoport::lab {
namespace {

/// A VirtualRobot as LinkLoop steps it. What its world holds at the start is not known; the kinetic energy is that of the scene's robot.
template <int N>
class HostedPlant {
 public:
  HostedPlant(const Scene&, Seconds dt, const VirtualRobot<N>* prototype)
      : robot_{prototype->copy()}, environment_{std::vector<EnvironmentSpec>{}}, dt_{dt} {
    read();
    robot_->start();
  }
  void advance() noexcept {
    ++tick_;
    read();
  }
  RobotSample<N> sense() const noexcept { return sample_; }
  template <class Clock>
  RobotSample<N> sense(const Tick<Clock>&) const noexcept {
    return sample_;
  }
  void actuate(const RobotCommand<N>& command) noexcept {
    f_ = command.f;
    robot_->actuate(command);
  }
  void release() noexcept {
    f_ = Force<N>{};
    robot_->release();
  }
  void silence() noexcept {}
  bool kick(const Velocity<N>& dv) noexcept {
    robot_->kick(dv);
    sample_.v += dv;
    state_.v += dv;
    return true;
  }
  [[nodiscard]] const sim::BodyState<N>& state() const { return state_; }
  [[nodiscard]] const Position<N>& port() const { return sample_.x; }
  [[nodiscard]] const Position<N>* tool() const { return robot_->tool(); }
  [[nodiscard]] const Force<N>& held() const { return f_; }
  [[nodiscard]] const Force<N>& environment_force() const { return from_environment_; }
  /// Of the scene: nothing.
  [[nodiscard]] const Environment<N>& environment() const { return environment_; }

 private:
  void read() noexcept {
    sample_ = robot_->sense({Instant<SlaveClock>{tick_time(tick_, 1.0 / dt_.si())}, dt_});
    state_ = {robot_->tool() != nullptr ? *robot_->tool() : sample_.x, sample_.v};
    from_environment_ = robot_->truth() ? robot_->truth()->f_environment : -sample_.f_environment;
    // A world that is lost has diverged.
    if (sample_.status == HardwareStatus::fault)
      state_.v = Velocity<N>{Velocity<N>::Vector::Constant(std::numeric_limits<double>::quiet_NaN())};
  }

  Copied<VirtualRobot<N>> robot_;
  Environment<N> environment_;
  Seconds dt_;
  std::int64_t tick_ = 0;
  RobotSample<N> sample_;
  sim::BodyState<N> state_;
  Force<N> f_, from_environment_;
};

}  // namespace

template <int N>
std::unique_ptr<Simulation<N>> make_simulation(const Scene& scene, const HostedRobot& hosted, Taps<N>* taps) {
  const auto* robot = std::get_if<HostedRobot::Of<N>>(&hosted.robot);
  if (robot == nullptr)
    throw ConfigError{fmt::format("--robot {}: was opened for another dof; the scene has {}", hosted.choice, N)};
  if (scene.control.architecture == Architecture::render || scene.control.architecture == Architecture::uncontrolled)
    throw ConfigError{fmt::format("--robot {}: control.architecture has no link to a robot", hosted.choice)};
  if (scene.gripper) throw ConfigError{fmt::format("--robot {}: the scene has a gripper, it has none", hosted.choice)};
  return std::make_unique<LinkLoop<N, AnyMethod, HostedPlant<N>>>(scene, taps, robot->get());
}

template <>
std::unique_ptr<Simulation<kJointPort>> make_simulation(const Scene&, const HostedRobot& robot, Taps<kJointPort>*) {
  throw ConfigError{fmt::format("--robot {}: space of the scene is JOINTS; it must be CARTESIAN", robot.choice)};
}
template std::unique_ptr<Simulation<1>> make_simulation<1>(const Scene&, const HostedRobot&, Taps<1>*);
template std::unique_ptr<Simulation<3>> make_simulation<3>(const Scene&, const HostedRobot&, Taps<3>*);
template std::unique_ptr<Simulation<6>> make_simulation<6>(const Scene&, const HostedRobot&, Taps<6>*);

}  // namespace twoport::lab
