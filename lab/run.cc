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
#include "lab/engine/quiet_tail.h"
#include "lab/engine/recording.h"
#include "lab/engine/simulation.h"
#include "lab/engine/stoppable.h"
#include "lab/engine/summary_parts.h"

namespace twoport::lab {
namespace {

/// States of a run in contact, to be judged beside its last one. A state is the end of a part in whose second half something
/// was touched. Of the parts that end on the same set of surfaces the one with the largest ∫|f| dt is kept, f the
/// environment's force: an integral, as a robot that bounces presses now and then.
template <int N>
class ContactStates {
 public:
  static constexpr std::size_t kMost = 8;  ///< sets of surfaces; those that were pressed most

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

  void begin_part(double from_s, double until_s) { late_from_s_ = 0.5 * (from_s + until_s); }
  /// A tick of the run.
  void add(const Row<N>& row) {
    const double f2 = row.env_f.squared_norm();
    if (f2 == 0.0) return;
    pressed_ += std::sqrt(f2);
    // The set is seen at every eighth tick of contact: a contact lasts longer, or comes again.
    if (row.t_s >= late_from_s_ && late_++ % 8 == 0) see_surfaces(rendered_ ? row.master_x : row.slave_x);
  }
  void end_part(const Simulation<N>& now, double now_s, bool last) {
    const double pressed = std::exchange(pressed_, 0.0);
    const std::uint64_t surfaces = std::exchange(surfaces_, 0);
    late_ = 0;
    if (surfaces == 0) return;
    auto same = std::find_if(states_.begin(), states_.end(), [&](const State& s) { return s.surfaces == surfaces; });
    if (same == states_.end()) {
      if (states_.size() < kMost) {
        same = states_.insert(states_.end(), State{surfaces, 0.0, 0.0, nullptr});
      } else {
        same = std::min_element(states_.begin(), states_.end(),
                                [](const State& a, const State& b) { return a.pressed < b.pressed; });
      }
    }
    if (!(pressed > same->pressed)) return;
    *same = {surfaces, pressed, now_s, last ? nullptr : now.copy()};
  }
  [[nodiscard]] const std::vector<State>& all() const { return states_; }

 private:
  [[gnu::noinline]] void see_surfaces(const Position<N>& x) {
    environment_.for_each_contact(x, Velocity<N>{}, [&](const ContactPort<N>& c) {
      const std::size_t kind = static_cast<std::size_t>(c.index) % kinds_;
      if (kind < environment_.world().surfaces.size()) surfaces_ |= std::uint64_t{1} << (kind % 64);
    });
  }

  Environment<N> environment_;
  bool rendered_;
  std::size_t kinds_;  ///< surfaces and springs
  double late_from_s_ = 0.0, pressed_ = 0.0;
  std::uint64_t surfaces_ = 0, late_ = 0;
  std::vector<State> states_;
};

/// The verdict of the loop as the scene leaves it, and in the other states: the worst.
template <int N>
TailVerdict judge_all(const Simulation<N>& at_end, const ContactStates<N>& states, const Scene& scene,
                      const MotionScale& scale, TwinUse twin) {
  TailVerdict worst = judge_tail(at_end, scene, scale, twin);
  for (const auto& state : states.all()) {
    if (worst.verdict.kind == VerdictKind::unstable) break;
    if (!state.at) continue;
    const TailVerdict held = judge_tail(*state.at, scene, scale, twin);
    worst.ticks += held.ticks;
    keep_worse(worst.verdict, held.verdict, state.at_s);
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
  const bool probes = tails && !alone && !World{scene.environment}.surfaces.empty();
  const double end_s = to_seconds(simulation.end()).si();
  std::uint64_t rows = 0;
  double from_s = 0.0;
  for (const double until_s : probes ? parts(simulation.segment_ends_s(), end_s) : std::vector{end_s}) {
    contact_states.begin_part(from_s, until_s);
    const auto start = ThreadClock::now();
    ticks += simulation.run_until(to_duration(until_s), [&](const Row<N>& row) {
      if (is_kept && rows++ % options.trace_every == 0) [[unlikely]]
        keep(row);
      if (probes) contact_states.add(row);
      return goes_on = metrics.add(row);
    });
    spent += ThreadClock::now() - start;
    if (!goes_on) break;
    if (probes) contact_states.end_part(simulation, until_s, until_s >= end_s);
    from_s = until_s;
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
    if (file == nullptr) {
      std::unique_ptr<Simulation<N>> simulation = make_simulation<N>(scene);
      if (options.stop != nullptr) simulation = std::make_unique<Stoppable<N>>(std::move(simulation), *options.stop);
      return run_as<N>(*simulation, scene, options, nullptr);
    }
    LabRecording<N> recording{*file, scene, *options.record, of_gripper};
    return run_as<N>(*make_simulation<N>(scene, &recording.taps()), scene, options, &recording);
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
