#include "lab/run.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/thread.h"
#include "common/contact/environment.h"
#include "common/coupling/registration.h"
#include "common/method/catalogue.h"
#include "common/record/metrics.h"
#include "common/record/trace.h"
#include "lab/both_couplings.h"
#include "lab/engine/hosted.h"
#include "lab/engine/quiet_tail.h"
#include "lab/engine/recording.h"
#include "lab/engine/simulation.h"
#include "lab/engine/stoppable.h"
#include "lab/engine/summary_parts.h"

namespace twoport::lab {
namespace {

/// States of a run in contact, to be judged beside its last one; of those that touch the same set of surfaces the one with the
/// largest ∫|f| dt, f the environment's force: an integral, as a robot that bounces presses now and then.
///
/// - Held: the end of a segment in whose second half something was touched; the integral is over the segment.
/// - Passed: a station of a segment; the integral is from the last quarter of the way to it to that of the way to the next one: the robot
///   comes a delay and a lag later. After the last one it ends in the middle of the next segment.
template <int N>
class ContactStates {
 public:
  static constexpr std::size_t kMost = 8;  ///< sets of surfaces, of each kind; those that were pressed most

  struct State {
    std::uint64_t surfaces;  ///< bit i: surface i, modulo 64
    double pressed;          ///< ∫|f| dt / T
    double at_s;
    std::unique_ptr<Simulation<N>> at;  ///< null: the end of the scene
  };

  explicit ContactStates(const Scene& scene)
      : environment_{scene.environment, scene.tool},
        rendered_{scene.control.architecture == Architecture::render},
        kinds_{environment_.world().surfaces.size() + environment_.world().springs.size()} {}

  void begin(const Part& part) {
    looks_from_s_ = part.looks_from_s();
    quarter_s_ = part.quarter_s();
    ends_at_station_ = part.ends_at_station;
    looks_ = 0;
  }
  /// A tick of the run.
  void add(const Row<N>& row) {
    const double f2 = row.env_f.squared_norm();
    if (f2 == 0.0) return;
    if (row.t_s >= quarter_s_ && !in_quarter_) [[unlikely]]
      begin_quarter();
    pressed_ += std::sqrt(f2);
    if (row.t_s < looks_from_s_ && !station_) return;
    // The set is seen at every eighth tick of contact: a contact lasts longer, or comes again.
    if (looks_++ % 8 == 0) see_surfaces(rendered_ ? row.master_x : row.slave_x);
  }
  void end(const Part& part, const Simulation<N>& now, bool last) {
    if (!in_quarter_) begin_quarter();
    if (station_) {
      station_->surfaces |= of_part_ | of_quarter_;
      if (is_left_) settle();
    }
    if (part.late) of_segment_ |= of_part_ | of_quarter_;
    if (part.ends_segment) {
      if (of_segment_ != 0)
        keep(held_, {of_segment_, pressed_ - before_segment_, part.until_s, nullptr},
             [&] { return last ? nullptr : now.copy(); });
      before_segment_ = pressed_;
      of_segment_ = 0;
      is_left_ = true;
    } else if (part.ends_at_station) {
      station_ = State{of_quarter_, before_quarter_, part.until_s, now.copy()};
      is_left_ = false;
    }
    if (last) settle();
    of_part_ = of_quarter_ = 0;
    in_quarter_ = false;
  }
  /// Those to be judged.
  [[nodiscard]] std::vector<const State*> all() const {
    std::vector<const State*> states;
    for (const auto* kind : {&held_, &passed_})
      for (const State& s : *kind) states.push_back(&s);
    return states;
  }

 private:
  void begin_quarter() {
    in_quarter_ = true;
    looks_ = 0;
    if (ends_at_station_ && station_) {
      station_->surfaces |= of_part_;
      settle();
    }
    before_quarter_ = pressed_;
  }
  /// What was touched since the last quarter before the last station is known.
  void settle() {
    if (!station_) return;
    const State& s = *station_;
    if (s.surfaces != 0)
      keep(passed_, {s.surfaces, pressed_ - s.pressed, s.at_s, nullptr}, [&] { return std::move(station_->at); });
    station_.reset();
  }
  template <class Copy>
  static void keep(std::vector<State>& states, State state, Copy copy) {
    auto same =
        std::find_if(states.begin(), states.end(), [&](const State& s) { return s.surfaces == state.surfaces; });
    if (same == states.end()) {
      if (states.size() < kMost) {
        same = states.insert(states.end(), State{state.surfaces, 0.0, 0.0, nullptr});
      } else {
        same = std::min_element(states.begin(), states.end(),
                                [](const State& a, const State& b) { return a.pressed < b.pressed; });
      }
    }
    if (state.pressed > same->pressed) *same = {state.surfaces, state.pressed, state.at_s, copy()};
  }
  [[gnu::noinline]] void see_surfaces(const Position<N>& x) {
    std::uint64_t& seen = in_quarter_ ? of_quarter_ : of_part_;
    environment_.for_each_contact(x, Velocity<N>{}, [&](const ContactPort<N>& c) {
      const std::size_t kind = static_cast<std::size_t>(c.index) % kinds_;
      if (kind < environment_.world().surfaces.size()) seen |= std::uint64_t{1} << (kind % 64);
    });
  }

  Environment<N> environment_;
  bool rendered_, in_quarter_ = false, ends_at_station_ = false;
  std::size_t kinds_;  ///< surfaces and springs
  double looks_from_s_ = 0.0, quarter_s_ = 0.0;
  double pressed_ = 0.0, before_quarter_ = 0.0,
         before_segment_ = 0.0;  ///< so far, before the last quarter of the part, before the segment
  std::uint64_t looks_ = 0;
  std::uint64_t of_part_ = 0, of_quarter_ = 0,
                of_segment_ = 0;  ///< sets: before the last quarter of the part, in it, all that is late
  std::optional<State> station_;  ///< the last one, until it is known what was touched; `pressed` is what was before it
  bool is_left_ = false;          ///< its segment has ended
  std::vector<State> held_, passed_;
};

/// The verdict of the loop as the scene leaves it, and in the other states: the worst.
template <int N>
TailVerdict judge_all(const Simulation<N>& at_end, const ContactStates<N>& states, const Scene& scene,
                      const MotionScale& scale, TwinUse twin) {
  TailVerdict worst = judge_tail(at_end, scene, scale, twin);
  for (const auto* state : states.all()) {
    if (worst.verdict.kind == VerdictKind::unstable) break;
    if (!state->at) continue;
    const TailVerdict held = judge_tail(*state->at, scene, scale, twin);
    worst.ticks += held.ticks;
    keep_worse(worst.verdict, held.verdict, state->at_s);
  }
  return worst;
}

template <int N>
CountedRun run_as(Simulation<N>& simulation, const Scene& scene, const RunOptions& options,
                  LabRecording<N>* recording) {
  const bool alone = scene.control.architecture == Architecture::uncontrolled;
  const bool link = simulation.link().has_value();
  const VerdictFrom from = has_plugin(scene) ? VerdictFrom::plain : options.verdict;
  Metrics<N> metrics = metrics_of<N>(scene, link, simulation.quiet_from_s(), simulation.initial_energy().si(),
                                     from == VerdictFrom::plain);
  std::optional<Trace<N>> trace;
  if (options.trace != nullptr) trace.emplace(*options.trace);

  const bool is_kept = trace || options.table != nullptr || recording != nullptr;
  const auto keep = [&](const Row<N>& row) __attribute__((noinline)) {
    if (trace) trace->add(row);
    if (options.table != nullptr) options.table->add(row);
    if (recording != nullptr) recording->add(row);
  };
  bool goes_on = true;
  ContactStates<N> contact_states{scene};
  std::uint64_t ticks = 0;
  std::chrono::duration<double, std::nano> spent{0};
  // Springs alone answer the same wherever the robot is.
  const bool tails = from != VerdictFrom::plain;
  const bool probes = tails && !alone && options.robot == nullptr && !World{scene.environment}.surfaces.empty();
  const double end_s = to_seconds(simulation.end()).si();
  std::uint64_t rows = 0;
  for (const Part& part : probes ? parts(simulation.segment_times(), end_s) : std::vector{Part{.until_s = end_s}}) {
    contact_states.begin(part);
    const auto start = ThreadClock::now();
    ticks += simulation.run_until(to_duration(part.until_s), [&](const Row<N>& row) {
      if (is_kept && rows++ % options.trace_every == 0) [[unlikely]]
        keep(row);
      if (probes) contact_states.add(row);
      return goes_on = metrics.add(row);
    });
    spent += ThreadClock::now() - start;
    if (!goes_on) break;
    if (probes) contact_states.end(part, simulation, part.until_s >= end_s);
  }

  Summary s;
  metrics.fill(s);
  describe_run(scene, "lab", s);
  s.set_step_ns(spent.count() / static_cast<double>(std::max<std::uint64_t>(ticks, 1)));
  const RunJudge<N>& judge = metrics.judge();
  if (tails && !judge.diverged() && judge.not_judged().empty()) {
    const TailVerdict judged = judge_all(simulation, contact_states, scene, judge.scale(),
                                         from == VerdictFrom::lean ? TwinUse::under_control : TwinUse::always);
    set_verdict(judged.verdict, s);
    ticks += judged.ticks;
  }
  say_if_coupling_feeds(s, scene.control.initial_energy);
  if (const std::optional<LinkUse> use = simulation.link()) {
    fill_link(s, *use, scene);
    if (use->overflowed > 0) s.mutable_verdict()->append("; packets in flight exceeded the line's room");
  }
  return {s, ticks};
}

}  // namespace

bool has_plugin(const Scene& scene) {
  const auto is_plugin = [](const ControlOptions& c) { return c.transparency == "PLUGIN"; };
  return is_plugin(scene.control) || std::any_of(scene.schedule.begin(), scene.schedule.end(),
                                                 [&](const ScheduledControl& s) { return is_plugin(s.control); });
}

Summary run(const Scene& scene, const RunOptions& options) {
  return run_counted(scene, options).summary;
}

namespace {

/// One coupling, that of the gripper where `of_gripper`; recorded into `file`, where that is not null.
CountedRun run_coupling(const Scene& scene, const RunOptions& options, mcap::Writer* file, bool of_gripper) {
  return dispatch_dof(scene, [&]<int N>() {
    const auto make = [&](Taps<N>* taps) {
      return options.robot ? make_simulation<N>(scene, *options.robot, taps) : make_simulation<N>(scene, taps);
    };
    if (file == nullptr) {
      std::unique_ptr<Simulation<N>> simulation = make(nullptr);
      if (options.stop != nullptr) simulation = std::make_unique<Stoppable<N>>(std::move(simulation), *options.stop);
      return run_as<N>(*simulation, scene, options, nullptr);
    }
    LabRecording<N> recording{*file, scene, *options.record, of_gripper};
    return run_as<N>(*make(&recording.taps()), scene, options, &recording);
  });
}

/// The rows of the gripper's trace go into `gripper_table`, where that is not null.
CountedRun run_both(const Scene& scene, const RunOptions& options, TraceTable* gripper_table) {
  std::optional<mcap::Writer> recording;
  if (options.record != nullptr) recording.emplace(recordable(scene, *options.record), kRecordedBy);
  mcap::Writer* const file = recording ? &*recording : nullptr;
  CountedRun done = run_coupling(scene, options, file, false);
  if (scene.gripper) {
    const CountedRun gripper = run_coupling(*scene.gripper,
                                            {.trace = options.gripper_trace,
                                             .trace_every = options.trace_every,
                                             .verdict = options.verdict,
                                             .record = options.record,
                                             .table = gripper_table,
                                             .stop = options.stop},
                                            file, true);
    fill_gripper(gripper.summary, done.summary);
    done.summary.set_step_ns(done.summary.step_ns() + gripper.summary.step_ns());
    done.ticks += gripper.ticks;
  }
  if (!recording) return done;
  try {
    recording->close();
  } catch (const IoError& e) {
    if (options.record->unwritten == nullptr) throw;
    *options.record->unwritten = e.what();
  }
  return done;
}

}  // namespace

CountedRun run_counted(const Scene& scene, const RunOptions& options) {
  return run_both(scene, options, nullptr);
}
Summary run_with_gripper_table(const Scene& scene, const RunOptions& options, TraceTable* gripper) {
  return run_both(scene, options, gripper).summary;
}

}  // namespace twoport::lab
