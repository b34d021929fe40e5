#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/print_error.h"
#include "common/hardware/status.h"
#include "common/platform/live_recording.h"
#include "common/platform/log.h"
#include "common/platform/plot_stream.h"
#include "common/platform/program.h"
#include "common/platform/realtime.h"
#include "common/platform/recorder.h"
#include "common/platform/udp.h"
#include "common/platform/watchdog.h"
#include "common/runtime/cycle.h"

namespace twoport {

/// Wall time of a node's cycle: read around it, never in it.
class StepClock {
 public:
  template <class F>
  auto time(F&& f) {
    const auto start = std::chrono::steady_clock::now();
    auto out = f();
    spent_ += std::chrono::steady_clock::now() - start;
    ++steps_;
    return out;
  }
  [[nodiscard]] double mean_ns() const { return steps_ > 0 ? spent_.count() / static_cast<double>(steps_) : 0.0; }

 private:
  std::chrono::duration<double, std::nano> spent_{0};
  std::uint64_t steps_ = 0;
};

/// Hardware for run_cycle, with its last reading kept. Once it is stopped, for good, it is released and its readings say so.
template <class Hardware, class Sample>
struct Sensed {
  Hardware& hardware;
  Sample sample;
  std::uint64_t stale = 0;           ///< readings that were the one before
  const char* stopped_by = nullptr;  ///< null: nobody
  bool released = false;

  void stop(const char* by) noexcept {
    if (stopped_by == nullptr) stopped_by = by;
  }
  template <class Clock>
  Sample sense(const Tick<Clock>& tick) noexcept {
    sample = hardware.sense(tick);
    if (sample.status == HardwareStatus::stale) ++stale;
    if (sample.status == HardwareStatus::stopped) stop("the hardware");
    if (stopped_by != nullptr && sample.status != HardwareStatus::fault) [[unlikely]]
      sample.status = HardwareStatus::stopped;
    return sample;
  }
  template <class Command>
  void actuate(const Command& command) noexcept {
    if (stopped_by == nullptr) [[likely]]
      return hardware.actuate(command);
    if (!std::exchange(released, true)) hardware.release();
  }
};

/// Reads opened hardware once, before anything moves. Releases it and throws IoError when it reports a fault or no finite number.
template <class Clock, class Hardware>
auto first_reading(Hardware& hardware, Seconds period, const std::string& choice) {
  const auto sample = hardware.sense(Tick<Clock>{Instant<Clock>{Duration{0}}, period});
  const bool fault = sample.status == HardwareStatus::fault;
  if (fault || !all_finite(sample.x, sample.v)) {
    hardware.release();
    if (!fault) throw IoError{choice + ": the first reading is not finite; check the hardware and start again"};
    throw IoError{choice + ": hardware fault at the first reading; " +
                  (hardware.trouble().empty() ? "check the hardware and start again" : hardware.trouble())};
  }
  return sample;
}

/// Data for the log and summary of a live run, besides its rows.
struct LiveFigures {
  const PeriodicLoop& loop;
  const StepClock& clock;
  std::uint64_t dropped_rows, overflowed_packets, stale_readings;
};
void say(spdlog::logger& log, const LiveFigures& figures);
/// Where Foxglove and Lichtblick may listen.
void say_where(const FoxgloveServer& server, spdlog::logger& log);
void fill(Summary& summary, const LiveFigures& figures);

/// Of the node's method; 0 for a node that has one only.
template <class Node>
std::uint32_t epoch_of(const Node& node) noexcept {
  if constexpr (requires { node.epoch(); }) {
    return node.epoch();
  } else {
    return 0;
  }
}

/// A node without a link is stopped by its own side only.
template <class Node>
bool is_stopped(const Node& node) noexcept {
  if constexpr (requires { node.mode(); }) {
    return node.mode() == Mode::stopped;
  } else {
    return false;
  }
}

/// Since 1970, of the computer's clock.
inline std::int64_t unix_time_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

/// Does the operator hold the handle? A robot has none.
template <class Sample>
bool is_held(const Sample& sample) noexcept {
  if constexpr (requires { sample.held; }) {
    return sample.held;
  } else {
    return true;
  }
}

/// Why a run has failed, and its exit status; 0: no failure.
struct Failure {
  std::string sentence;
  int status = 0;
};
/// `trouble`: the driver's sentence on the fault, may be empty. `stopped_by`: null where nobody has. `missed`: the sentence of a side
/// that has ended without meeting the other; empty otherwise.
Failure why_failed(std::string_view refusal, HardwareStatus last, std::string_view trouble, const char* stopped_by,
                   double ran_s, std::string_view missed);

/// What a run is switched between, in words: the scene's first control, then the schedule. Empty without a schedule.
std::vector<std::string> configurations(const Scene& scene);

/// A live run of one side from its first tick to its exit status. The sides differ in:
///
///     kSize, kSide, kName       degrees of freedom, Side, and its name
///     Clock, Hardware, Sample   types: of its ticks, of `hardware`, of a reading
///     node, hardware, link      a node, a Device or Robot, a LiveLink or NoLink
///     rate_hz()
///     serves()                  does it continue after the end of the scene? Not beyond LiveArguments::limit_s
///     metrics()                 computes the summary from the rows
///     row(k, t_s, sample, out)  the row of tick k, t_s after the link came up
///     complete(row, sample)     completes that row from the next tick's sample
///     fill(summary, diverged)   the side's own figures of the summary
///     judged()                  is its summary compared with the scene's `expect`?
///     switch_when_due(t_s)      a master over a link: before each tick
///     begin_tick(), end_tick(now, late, sample, out)   optional: around the cycle of every tick
///     tell_end(summary)         optional: when the run is over
///     gripper                   a unique_ptr to a LiveGripper, null where the scene has none
///     lets_go()                 has the hardware let go by itself?
///     sensor()                  optional: SensorRest of the robot's force sensor
template <class LiveSide>
int run_live(LiveSide& side, const Scene& scene, const LiveArguments& arguments, spdlog::logger& log) {
  constexpr int N = LiveSide::kSize;
  using Clock = typename LiveSide::Clock;
  const double rate_hz = side.rate_hz();
  const Seconds dt{1.0 / rate_hz};
  std::optional<StopInput> stop_input;
  if (arguments.stop_port > 0) stop_input.emplace(static_cast<std::uint16_t>(arguments.stop_port));
  std::unique_ptr<LiveRecording<N>> recording;
  std::optional<PlotStream> stream;
  if (!arguments.stream.empty()) stream.emplace(arguments.stream, LiveSide::kSide, arguments.stream_hz);
  if (stream && !stream->stays_on_this_machine())
    log.warn("--stream {}: positions and forces of this side leave this machine unencrypted", arguments.stream);
  const bool has_earlier = has_content(arguments.record);
  const RunFolder folder = begin_folder(arguments, [&] {
    recording = open_recording<N>(arguments, LiveSide::kName, rate_hz, side.hardware.info(), scene.joints);
  });
  WholeFile* const trace = folder.trace.get();
  if (recording) side.link.tap(&recording->feed());
  if (recording && recording->output()->listeners()) say_where(*recording->output()->listeners(), log);
  if (has_earlier) log.info("{} of an earlier run is now {}", arguments.record, earlier_file(arguments.record));
  Recorder<N> recorder{{.metrics = side.metrics(),
                        .size = scene.coordinates(),
                        .trace = trace,
                        .recording = recording.get(),
                        .stream = stream ? &*stream : nullptr,
                        .duration_s = scene.duration_s,
                        .side = LiveSide::kSide,
                        .trace_every = arguments.trace_every,
                        .configurations = configurations(scene),
                        .log = log}};
  const std::atomic<bool>& stop = stop_on_signals();
  PeriodicLoop loop{{.rate_hz = rate_hz, .realtime = arguments.realtime, .spin = arguments.spin}};
  for (const std::string& sentence : loop.not_permitted()) log.warn(sentence);
  const auto info = side.hardware.info();
  log.info("hardware: {}", info.name);
  if (!(info.watchdog > Seconds{}))
    log.warn("{} has no watchdog: if this program is stopped, its last command stands", info.name);
  side.link.say_where(log);
  auto* const gripper = side.gripper.get();
  if (gripper) gripper->begin(arguments, scene.duration_s, log, recording ? recording->output() : nullptr);

  Sensed<typename LiveSide::Hardware, typename LiveSide::Sample> plant{side.hardware, {}};
  StepClock clock;
  std::int64_t met = -1, last = -1, waiting_until = 0;
  Row<N> row;
  TickView view;
  bool has_row = false;
  std::uint64_t let_go = 0;
  const std::int64_t start_unix_ns = unix_time_ns();
  if (recording) recording->start_at(start_unix_ns);
  if (gripper) gripper->start_at(start_unix_ns);
  const auto see = [&](Duration now) {
    TickView seen = side.link.view(now);
    seen.let_go = let_go;
    seen.stopped_by = plant.stopped_by;
    seen.switches = switches_by_hand();
    if constexpr (requires { side.sensor(); }) seen.sensor = side.sensor();
    return seen;
  };
  // Leaves what has been recorded. `hangs`: why the watchdog ends the program; empty where the loop has ended by itself.
  const auto conclude = [&](const std::string& hangs) -> int {
    Summary s = recorder.finish();
    if (gripper) gripper->end();
    int recorded = 0;
    if (recording) {
      side.link.tap(nullptr);
      if (const std::uint64_t missing = recording->missing() + (gripper ? gripper->missing() : 0); missing > 0)
        log.warn("{} ticks are missing from {}: the {} was too slow", missing,
                 arguments.record.empty() ? "--foxglove" : arguments.record,
                 arguments.record.empty() ? "recording thread" : "disk");
      try {
        recording->finish();
      } catch (const IoError& e) {
        print_error("twoport-{}: --record {}\n", LiveSide::kName, e.what());
        recorded = 1;
      }
    }
    const LiveFigures figures{loop, clock, recorder.dropped(), side.link.overflowed(), plant.stale};
    say(log, figures);
    if (met < 0 && stop) log.warn("ended by a signal; the other side had not come, and nothing is recorded");
    side.fill(s, recorder.diverged());
    fill_own_limits<LiveSide::kSide>(side.node.limit_counts(), s);
    fill(s, figures);
    if (stop) s.mutable_verdict()->append("; interrupted");
    bool has_gripper_trace = true;
    if (gripper) has_gripper_trace = gripper->finish(s, LiveSide::kName);
    const bool of_gripper = gripper && gripper->fault() && plant.sample.status != HardwareStatus::fault;
    const Failure failure =
        hangs.empty() ? why_failed(side.link.refusal(), of_gripper ? HardwareStatus::fault : plant.sample.status,
                                   of_gripper ? gripper->trouble() : side.hardware.trouble(), plant.stopped_by,
                                   s.duration_s(), met < 0 && !stop ? side.link.not_met() : std::string{})
                      : Failure{hangs, 1};
    if (failure.status != 0) {
      set_verdict({VerdictKind::undecided, failure.sentence}, s);
    }
    // Neither stable nor unstable: nobody knows.
    if (s.verdict_kind() == to_string(VerdictKind::undecided)) s.clear_stable();
    if constexpr (requires { side.tell_end(s); }) side.tell_end(s);
    if (!has_gripper_trace) recorded = 1;
    const int written = std::max(recorded, leave_files(scene, arguments, LiveSide::kName, trace, s));
    if (failure.status != 0) {
      print_error("twoport-{}: {}\n", LiveSide::kName, failure.sentence);
      return failure.status;
    }
    int status = side.judged() && !stop ? judge(scene, arguments, s) : 0;
    // A scene that expects nothing does not expect this.
    const bool unstable =
        recorder.diverged() || (!side.judged() && s.verdict_kind() == to_string(VerdictKind::unstable));
    if (status == 0 && unstable && scene.expect.stable.value_or(true)) {
      print_error("{}: the {} {} {}\n", arguments.scene, LiveSide::kName,
                  recorder.diverged() ? "has" : "is unstable:", s.verdict());
      status = 3;
    }
    return written != 0 ? written : status;
  };
  const auto release = [&] {
    side.hardware.release();
    if (gripper) gripper->release();
  };
  Watchdog& watchdog = Watchdog::of_program();
  watchdog.begin([&](const std::string& why, bool in_exit) {
    // Beside the call that hangs: it may hang too.
    if (!in_exit) {
      std::thread{release}.detach();
      std::this_thread::sleep_for(std::chrono::milliseconds{200});
    }
    conclude(why);
    if (in_exit) release();
  });
  Duration ended_at{0};
  loop.run(stop, [&](std::int64_t k, Duration now) {
    ended_at = now + to_duration(dt.si());
    if (!side.link.refusal().empty() || to_seconds(now).si() >= arguments.limit_s) return false;
    watchdog.tick();
    if constexpr (requires { side.begin_tick(); }) side.begin_tick();
    if (stop_input && stop_input->is_asked()) [[unlikely]]
      plant.stop("--stop-port");
    const std::uint32_t epoch_before = epoch_of(side.node);
    const bool new_session = side.link.met(side.node);
    if (new_session && met < 0) {
      met = k;
      side.hardware.start();
      if (gripper) gripper->start();
    }
    if (new_session && gripper) gripper->meet(side.link.session_since());
    const double t_s = met < 0 ? 0.0 : static_cast<double>(k - met) / rate_hz;
    const bool over = t_s >= scene.duration_s;
    if (recorder.diverged() || (gripper && gripper->diverged()) || (over && !side.serves())) return false;

    if constexpr (requires { side.switch_when_due(t_s); })
      if (met >= 0) side.switch_when_due(t_s);
    const double passed = last < 0 ? 1.0 : static_cast<double>(k - last);
    last = k;
    const Tick<Clock> tick{Instant<Clock>{now}, dt, passed * dt};
    if (recording)
      recording->feed().begin(met < 0 ? -1.0 : t_s, epoch_before, new_session, epoch_of(side.node),
                              side.link.session_since());
    const auto out = clock.time([&] {
      auto of_main = run_cycle(side.node, plant, side.link.mail(), tick);
      if (is_stopped(side.node)) [[unlikely]]
        plant.stop("the other side");
      if (gripper) [[unlikely]]
        gripper->cycle(tick, met < 0 ? -1.0 : t_s, side.lets_go() || plant.stopped_by != nullptr,
                       is_held(plant.sample));
      return of_main;
    });
    if (recording) recording->feed().end(tick, plant.sample, out);
    side.link.note();
    let_go += side.lets_go() ? 1 : 0;
    if constexpr (requires { side.end_tick(now, loop.late(), plant.sample, out); })
      side.end_tick(now, loop.late(), plant.sample, out);
    if (has_row) {
      side.complete(row, plant.sample);
      recorder.push(row, view);
    }
    has_row = met >= 0 && !over;
    if (gripper) gripper->record(t_s, has_row);
    if (has_row) {
      row = side.row(k, t_s, plant.sample, out);
      view = see(now);
      view.late = loop.late();
      view.epoch = epoch_of(side.node);
      view.limits = side.node.limit_counts() + side.link.limit_counts();
    } else if (met < 0 && k >= waiting_until) {
      view = see(now);
      recorder.push_waiting(to_seconds(now).si(), view);
      waiting_until = k + static_cast<std::int64_t>(0.1 * rate_hz);
    }
    return plant.sample.status != HardwareStatus::fault && !(gripper && gripper->fault());
  });
  release();
  side.link.say_goodbye(ended_at);
  watchdog.end();
  if (has_row) recorder.push(row, view);
  return conclude({});
}

}  // namespace twoport
