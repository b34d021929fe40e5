#include <fmt/format.h>

#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/hardware/registry.h"
#include "common/recording/recording.h"
#include "common/scene/scene.h"

namespace twoport {
namespace {

/// The readings of one side of a recording, from its first contact with the other side on. Empty for a gripper that it has not.
template <int N>
std::vector<TickRecord<N>> readings(const char* flag, const DriverOptions& o, const std::string& side) {
  if (o.arguments.empty())
    throw ConfigError{std::string{flag} + " playback: a recording is missing: playback:FILE.mcap"};
  RecordingReader recording{o.arguments};
  std::vector<TickRecord<N>> all;
  RecordedTick<N> recorded;
  int dof = 0;
  for (RecordingReader::Kind kind; (kind = recording.next()) != RecordingReader::Kind::end;) {
    if (kind == RecordingReader::Kind::header && recording.header().side == side) dof = recording.header().dof;
    if (kind != RecordingReader::Kind::tick || recording.topic() != "/" + side + "/tick") continue;
    if (dof != N) recording.fail(fmt::format("it is of dof {}, but dof of the scene is {}", dof, N));
    if (!recording.tick(recorded)) recording.fail("a tick has numbers of another dof than its header");
    const TickRecord<N>& t = recorded.tick;
    if (t.t_s < 0.0) continue;
    if (!all.empty() && !(t.t_s > all.back().t_s)) recording.fail("its times do not increase");
    all.push_back(t);
  }
  if (all.empty() && dof == 0 && side.ends_with(kOfGripper)) return all;
  if (all.empty()) recording.fail("it has no tick of a " + side + " in contact with the other side");
  return all;
}

/// Null: the scene or the recording has none.
template <template <int> class Hardware>
std::unique_ptr<Hardware<1>> gripper_of(const char* flag, const DriverOptions& o, const std::string& side) {
  if constexpr (built_for(1))
    if (o.scene.gripper)
      if (auto all = readings<1>(flag, o, side + std::string{kOfGripper}); !all.empty())
        return std::make_unique<Hardware<1>>(std::move(all));
  return nullptr;
}

/// Time since start(), and the newest recorded reading by then. The last one remains.
template <int N>
class Playback {
 public:
  explicit Playback(std::vector<TickRecord<N>> readings) : readings_{std::move(readings)} {}
  void start() noexcept { started_ = true; }
  const TickRecord<N>& at(Seconds ended) noexcept {
    if (started_ && begun_) t_s_ += ended.si();
    begun_ = started_;
    // Half a period of slack: both times are sums of periods.
    while (next_ + 1 < readings_.size() && readings_[next_ + 1].t_s <= t_s_ + 0.5 * readings_[next_].dt.si()) ++next_;
    return readings_[next_];
  }
  [[nodiscard]] bool over() const noexcept { return next_ + 1 == readings_.size(); }

 private:
  std::vector<TickRecord<N>> readings_;
  std::size_t next_ = 0;
  double t_s_ = 0.0;
  bool started_ = false, begun_ = false;
};

/// A recorded hand: the handle moves as recorded, whatever the force.
template <int N>
class PlaybackDevice final : public Device<N> {
 public:
  static constexpr bool kDrivesJoints = true;
  explicit PlaybackDevice(const DriverOptions& o) : PlaybackDevice{readings<N>("--device", o, "master")} {
    gripper_ = gripper_of<PlaybackDevice>("--device", o, "master");
  }
  explicit PlaybackDevice(std::vector<TickRecord<N>> readings) : playback_{std::move(readings)} {}
  [[nodiscard]] DeviceInfo info() const override {
    return {.name = "playback of a hand", .watchdog = Seconds{1.0}, .gripper = gripper_ != nullptr};
  }
  DeviceSample<N> sense(const Tick<MasterClock>& tick) noexcept override {
    const TickRecord<N>& t = playback_.at(tick.ended);
    // It rests where the recording ends.
    return {t.x, playback_.over() ? Velocity<N>{} : t.v, applied_, HardwareStatus::ok, t.buttons, t.held};
  }
  void actuate(const Force<N>& f) noexcept override { applied_ = f; }
  void start() noexcept override { playback_.start(); }
  void release() noexcept override { applied_ = Force<N>{}; }
  [[nodiscard]] Device<1>* gripper() noexcept override { return gripper_.get(); }

 private:
  std::unique_ptr<PlaybackDevice<1>> gripper_;  ///< null: the scene or the recording has none
  Playback<N> playback_;
  Force<N> applied_;
};

/// A recorded robot: position and force sensor as recorded, whatever the command.
template <int N>
class PlaybackRobot final : public Robot<N> {
 public:
  static constexpr bool kDrivesJoints = true;
  explicit PlaybackRobot(const DriverOptions& o) : PlaybackRobot{readings<N>("--robot", o, "slave")} {
    gripper_ = gripper_of<PlaybackRobot>("--robot", o, "slave");
  }
  explicit PlaybackRobot(std::vector<TickRecord<N>> readings) : playback_{std::move(readings)} {}
  [[nodiscard]] RobotInfo info() const override { return {.name = "playback of a robot", .watchdog = Seconds{1.0}}; }
  RobotSample<N> sense(const Tick<SlaveClock>& tick) noexcept override {
    const TickRecord<N>& t = playback_.at(tick.ended);
    return {t.x, playback_.over() ? Velocity<N>{} : t.v, t.f, t.ideal, HardwareStatus::ok};
  }
  void actuate(const RobotCommand<N>&) noexcept override {}
  void start() noexcept override { playback_.start(); }
  void release() noexcept override {}
  [[nodiscard]] Robot<1>* gripper() noexcept override { return gripper_.get(); }

 private:
  std::unique_ptr<PlaybackRobot<1>> gripper_;  ///< null: the scene or the recording has none
  Playback<N> playback_;
};

}  // namespace

void add_playback(Registry& all) {
  all.devices.add<PlaybackDevice>("playback", "playback:FILE.mcap, the hand of a recording; feels no force");
  all.robots.add<PlaybackRobot>("playback", "playback:FILE.mcap, the robot of a recording; obeys no command");
}

}  // namespace twoport
