#include "lab/study/replay.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
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

/// Compares results to the bit and keeps the first that differs. Two values that are no numbers count as equal.
class Comparison {
 public:
  void see(const std::string& name, double recorded, double replayed) {
    const auto a = std::bit_cast<std::uint64_t>(recorded), b = std::bit_cast<std::uint64_t>(replayed);
    if (a == b || (std::isnan(recorded) && std::isnan(replayed)) || !difference_.empty()) return;
    difference_ = fmt::format("{} is {:.17g} ({:016x}), recorded {:.17g} ({:016x})", name, replayed, b, recorded, a);
  }
  void see(const std::string& name, std::uint64_t recorded, std::uint64_t replayed) {
    if (recorded == replayed || !difference_.empty()) return;
    difference_ = fmt::format("{} is {}, recorded {}", name, static_cast<std::int64_t>(replayed),
                              static_cast<std::int64_t>(recorded));
  }
  template <class Kind, int N>
  void see(const std::string& name, const Coords<Kind, N>& recorded, const Coords<Kind, N>& replayed) {
    for (int i = 0; i < N; ++i) see(element(name, i), recorded[i], replayed[i]);
  }
  template <int N>
  void see(const std::string& name, const Position<N>& recorded, const Position<N>& replayed) {
    const auto size = static_cast<int>(recorded.translation().size());
    for (int i = 0; i < size; ++i) see(element(name, i), recorded.translation()[i], replayed.translation()[i]);
    if constexpr (N == 6) {
      const Eigen::Quaterniond &a = recorded.attitude(), &b = replayed.attitude();
      see(element(name, 3), a.w(), b.w());
      see(element(name, 4), a.x(), b.x());
      see(element(name, 5), a.y(), b.y());
      see(element(name, 6), a.z(), b.z());
    }
  }
  template <int N>
  void see(const std::string& name, const Report<N>& recorded, const Report<N>& replayed) {
    const auto of = [&](const char* field) { return name + "." + field; };
    const auto bits = [](std::int64_t value) { return static_cast<std::uint64_t>(value); };
    see(of("x"), recorded.x, replayed.x);
    see(of("v"), recorded.v, replayed.v);
    see(of("f"), recorded.f, replayed.f);
    see(of("f_coupling"), recorded.f_coupling, replayed.f_coupling);
    see(of("f_environment"), recorded.f_environment, replayed.f_environment);
    see(of("position_error"), recorded.position_error, replayed.position_error);
    see(of("energy_in_j"), recorded.energy_in_j, replayed.energy_in_j);
    see(of("mode"), static_cast<std::uint64_t>(recorded.mode), static_cast<std::uint64_t>(replayed.mode));
    see(of("epoch"), std::uint64_t{recorded.epoch}, std::uint64_t{replayed.epoch});
    see(of("words"), std::uint64_t{recorded.words.count}, std::uint64_t{replayed.words.count});
    see(of("running_totals"), std::uint64_t{recorded.words.totals}, std::uint64_t{replayed.words.totals});
    for (std::size_t i = 0; i < std::min(recorded.words.count, replayed.words.count); ++i)
      see(element(of("words"), static_cast<int>(i)), recorded.words.at[i], replayed.words.at[i]);
    see(of("sequence"), recorded.sequence, replayed.sequence);
    see(of("sent_ns"), bits(recorded.sent_ns), bits(replayed.sent_ns));
    see(of("echo_ns"), bits(recorded.echo_ns), bits(replayed.echo_ns));
  }
  [[nodiscard]] const std::string& difference() const { return difference_; }

 private:
  static std::string element(const std::string& name, int i) { return fmt::format("{}[{}]", name, i); }
  std::string difference_;
};

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
  using Clock = MasterClock;
  using Sample = DeviceSample<N>;
  explicit MasterSide(const Scene& s)
      : node{s.control, s.schedule}, mail{mailbox_of<N>(Side::master, s, ReplayTransport<N>{})} {}
  static Sample sample(const TickRecord<N>& t) {
    return {.x = t.x, .v = t.v, .applied = t.f, .status = t.status, .buttons = t.buttons, .held = t.held};
  }
  MasterNode<N> node;
  Mailbox<N, ReplayTransport<N>> mail;
};

template <int N>
struct RenderSide {
  using Clock = MasterClock;
  using Sample = DeviceSample<N>;
  explicit RenderSide(const Scene& s) : node{s.control, Environment<N>{s.environment, s.tool}} {}
  static Sample sample(const TickRecord<N>& t) { return MasterSide<N>::sample(t); }
  RenderNode<N> node;
  NoMail mail;
};

template <int N>
struct SlaveSide {
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
    Comparison seen;
    begin(t, seen);
    TickRecord<N> now;
    GivenReading<typename Side::Sample> hardware{Side::sample(t)};
    now.take_output(run_cycle(side_.node, hardware, side_.mail,
                              Tick<typename Side::Clock>{Instant<typename Side::Clock>{t.now}, t.dt, t.ended}));
    seen.see("command", t.command, now.command);
    seen.see("wanted", t.wanted, now.wanted);
    seen.see("x_d", t.x_d, now.x_d);
    seen.see("v_d", t.v_d, now.v_d);
    seen.see("dissipated_j", t.dissipated_j, now.dissipated_j);
    seen.see("undissipated_j", t.undissipated_j, now.undissipated_j);
    seen.see("mode", static_cast<std::uint64_t>(t.mode), static_cast<std::uint64_t>(now.mode));
    if constexpr (requires { side_.mail.transport(); }) {
      const ReplayTransport<N>& transport = side_.mail.transport();
      seen.see("number of reports sent", std::uint64_t{t.sends}, std::uint64_t{transport.sends});
      if (t.sends && transport.sends) seen.see("sent", t.sent, transport.sent);
    }
    if (seen.difference().empty()) {
      ++result.ticks;
    } else {
      result.difference = fmt::format("tick {} at {:.6f} s: {}", t.number, to_seconds(t.now).si(), seen.difference());
    }
  }

 private:
  /// What happens between two ticks: the master switches its method, a session of the other side begins.
  void begin(const TickRecord<N>& t, Comparison& seen) {
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
    if constexpr (requires { side_.node.epoch(); })
      seen.see("epoch", std::uint64_t{t.epoch}, std::uint64_t{side_.node.epoch()});
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
