#include "lab/study/replay.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <memory>
#include <utility>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/contact/environment.h"
#include "common/recording/tick.h"
#include "common/runtime/cycle.h"
#include "common/scene/load.h"
#include "lab/engine/both_nodes.h"
#include "lab/run.h"
#include "master/master_node.h"
#include "master/render_node.h"
#include "master/with_device.h"
#include "slave/slave_node.h"

namespace twoport::lab {
namespace {

/// Delivers the recorded reports and keeps what is sent.
template <int N>
class ReplayTransport {
 public:
  void arrive(const std::vector<Report<N>>& reports) { arrived_ = reports; }
  template <class Use>
  void poll(Duration, Use use) noexcept {
    for (const Report<N>& each : arrived_) use(each);
    arrived_.clear();
  }
  template <class R>
  void send(const R& report, Duration) noexcept {
    sends = true;
    sent = report;
  }

  bool sends = false;
  Report<N> sent;

 private:
  std::vector<Report<N>> arrived_;
};

template <int N>
struct MasterSide {
  static constexpr bool kOfMaster = true;
  using Clock = MasterClock;
  using Sample = DeviceSample<N>;
  explicit MasterSide(const Scene& s)
      : node{s.control, s.schedule}, mail{mailbox_of<N>(Side::master, s, ReplayTransport<N>{})} {}
  static Sample sample(const TickRecord<N>& t) {
    return {
        .x = t.x, .v = t.v, .applied = t.f, .status = t.status, .buttons = t.buttons, .held = t.held, .ratio = t.ratio};
  }
  MasterNode<N> node;
  Mailbox<N, ReplayTransport<N>> mail;
};

template <int N>
struct RenderSide {
  static constexpr bool kOfMaster = true;
  using Clock = MasterClock;
  using Sample = DeviceSample<N>;
  explicit RenderSide(const Scene& s) : node{s.control, Environment<N>{s.environment, s.tool}} {}
  static Sample sample(const TickRecord<N>& t) { return MasterSide<N>::sample(t); }
  RenderNode<N> node;
  NoMail mail;
};

template <int N>
struct SlaveSide {
  static constexpr bool kOfMaster = false;
  using Clock = SlaveClock;
  using Sample = RobotSample<N>;
  explicit SlaveSide(const Scene& s)
      : node{s.control, s.schedule}, mail{mailbox_of<N>(Side::slave, s, ReplayTransport<N>{})} {}
  static Sample sample(const TickRecord<N>& t) {
    return {.x = t.x, .v = t.v, .f_environment = t.f, .ideal = t.ideal, .status = t.status};
  }
  SlaveNode<N> node;
  Mailbox<N, ReplayTransport<N>> mail;
};

/// One side at work.
struct Replay {
  explicit Replay(std::string side) { result.side = std::move(side); }
  virtual ~Replay() = default;
  virtual void step(RecordingReader& recording) = 0;
  ReplayedSide result;
};

template <int N, class Side>
class ReplayOf final : public Replay {
 public:
  ReplayOf(std::string name, const Scene& scene) : Replay{std::move(name)}, side_{scene} {}

  void step(RecordingReader& recording) override {
    if (!result.difference.empty()) return;
    if (!recording.tick(recorded_)) recording.fail("a tick has other lengths than its header says");
    const TickRecord<N>& t = recorded_.tick;
    if (t.number != result.ticks) {
      result.difference = fmt::format("ticks {} to {} are missing; nothing can be replayed from there on", result.ticks,
                                      static_cast<std::int64_t>(t.number) - 1);
      return;
    }
    begin(t);
    TickRecord<N> now;
    if constexpr (requires { side_.node.epoch(); }) now.epoch = side_.node.epoch();
    GivenReading<typename Side::Sample> hardware{Side::sample(t)};
    now.take_output(run_cycle(side_.node, hardware, side_.mail,
                              Tick<typename Side::Clock>{Instant<typename Side::Clock>{t.now}, t.dt, t.ended}));
    if constexpr (requires { side_.mail.transport(); }) {
      now.sends = side_.mail.transport().sends;
      now.sent = side_.mail.transport().sent;
    }
    const std::string found = difference(t, now, Side::kOfMaster);
    if (found.empty()) {
      ++result.ticks;
    } else {
      result.difference = fmt::format("tick {} at {:.6f} s: {}", t.number, to_seconds(t.now).si(), found);
    }
  }

 private:
  /// What happens between two ticks: the master switches its method, a session of the other side begins.
  void begin(const TickRecord<N>& t) {
    switch_to(t.epoch_before);
    if constexpr (requires { side_.mail.transport(); }) {
      if (t.peer_restarted) {
        side_.node.on_peer_restart(Energy{side_.mail.known().energy_in_j});
        side_.mail.reset(t.session_since);
      }
      switch_to(t.epoch);
      side_.mail.transport().arrive(recorded_.received);
      side_.mail.transport().sends = false;
    }
  }
  void switch_to(std::uint32_t epoch) {
    if constexpr (requires { side_.node.switch_to_next(); }) {
      // Without a schedule there is nothing to switch to, and the epoch stays.
      for (std::uint32_t before = epoch + 1; side_.node.epoch() < epoch && side_.node.epoch() != before;) {
        before = side_.node.epoch();
        side_.node.switch_to_next();
      }
    }
  }

  Side side_;
  RecordedTick<N> recorded_;
};

template <int N>
std::unique_ptr<Replay> make_replay(const RecordingHeader& h, const Scene& scene) {
  if (!h.of_master()) return std::make_unique<ReplayOf<N, SlaveSide<N>>>(h.side, scene);
  if constexpr (N != kJointPort)
    if (scene.control.architecture == Architecture::render)
      return std::make_unique<ReplayOf<N, RenderSide<N>>>(h.side, scene);
  return std::make_unique<ReplayOf<N, MasterSide<N>>>(h.side, scene);
}

/// The scene as the recorded program had it; of a gripper the scene within it.
Scene scene_of(const RecordingHeader& h) {
  Scene scene = parse_scene(h.scene_text, h.scene_file, h.overrides, h.live ? SceneFor::live : SceneFor::laboratory);
  if (h.live && h.of_master() && has_plugin(scene))
    throw ConfigError{h.scene_file +
                      ": a plug-in is its transparency layer, which answered at its own times; a live recording does "
                      "not hold the answers, so it cannot be replayed"};
  if (h.of_gripper()) {
    if (!scene.gripper) throw ConfigError{h.scene_file + ": the recording has a gripper, but not its scene"};
    scene = Scene{*scene.gripper};
  }
  if (!h.properties) return scene;
  if (h.of_master()) return with_device(std::move(scene), *h.properties);
  scene.control.own_limits = h.properties->limits;
  return scene;
}

}  // namespace

bool Replayed::identical() const {
  return !sides.empty() && std::ranges::all_of(sides, [](const ReplayedSide& s) { return s.difference.empty(); });
}

Replayed replay(RecordingReader& recording) {
  std::map<std::string, std::unique_ptr<Replay>> sides;  // by topic of their ticks
  for (RecordingReader::Kind kind; (kind = recording.next()) != RecordingReader::Kind::end;) {
    if (kind == RecordingReader::Kind::header) {
      const RecordingHeader& h = recording.header();
      const Scene scene = scene_of(h);
      if (scene.dof != h.dof) recording.fail(fmt::format("dof is {}, but {} in its scene", h.dof, scene.dof));
      sides["/" + h.side + "/tick"] =
          for_dof(scene.dof, [&]<int N>() -> std::unique_ptr<Replay> { return make_replay<N>(h, scene); });
    } else if (kind == RecordingReader::Kind::tick) {
      const auto side = sides.find(recording.topic());
      if (side == sides.end()) recording.fail("a tick comes before the header of its side");
      side->second->step(recording);
    }
  }
  Replayed all;
  for (auto& [topic, side] : sides) all.sides.push_back(std::move(side->result));
  if (all.sides.empty()) recording.fail("it holds neither side of a run");
  all.torn = recording.torn();
  return all;
}

}  // namespace twoport::lab
