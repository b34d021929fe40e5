#include "lab/run.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/base/thread.h"
#include "common/contact/environment.h"
#include "common/record/metrics.h"
#include "common/record/trace.h"
#include "lab/engine/hosted.h"
#include "lab/engine/quiet_tail.h"
#include "lab/engine/recording.h"
#include "lab/engine/simulation.h"
#include "lab/engine/summary_parts.h"

namespace twoport::lab {
namespace {

/// What the rows of a run touch, and its states in contact.
template <int N>
class Contacts {
 public:
  using States = ContactStates<std::unique_ptr<Simulation<N>>>;

  explicit Contacts(const Scene& scene)
      : environment_{scene.environment, scene.tool},
        rendered_{scene.control.architecture == Architecture::render},
        kinds_{environment_.world().surfaces.size() + environment_.world().springs.size()} {}

  void begin(const Part& part) {
    part_ = part;
    looks_ = 0;
    in_quarter_ = false;
  }
  /// A tick of the run.
  void add(const Row<N>& row) {
    const double f2 = row.env_f.squared_norm();
    if (f2 == 0.0) return;
    if (row.t_s >= part_.quarter_s() && !in_quarter_) [[unlikely]]
      begin_quarter();
    pressed_ += std::sqrt(f2);
    if (row.t_s < part_.looks_from_s() && !states_.waits()) return;
    // The set is seen at every eighth tick of contact: a contact lasts longer, or comes again.
    if (looks_++ % 8 == 0) see_surfaces(rendered_ ? row.master_x : row.slave_x);
  }
  /// The part ends.
  void end(const Simulation<N>& now, bool last) {
    if (!in_quarter_) begin_quarter();
    states_.end(part_, std::exchange(seen_, 0), pressed_, last, [&] { return now.copy(); });
  }
  [[nodiscard]] const States& states() const { return states_; }

 private:
  void begin_quarter() {
    in_quarter_ = true;
    looks_ = 0;
    states_.begin_quarter(part_, std::exchange(seen_, 0), pressed_);
  }
  void see_surfaces(const Position<N>& x) {
    environment_.for_each_contact(x, Velocity<N>{}, [&](const ContactPort<N>& c) {
      const std::size_t kind = static_cast<std::size_t>(c.index) % kinds_;
      if (kind < environment_.world().surfaces.size()) seen_ |= std::uint64_t{1} << (kind % 64);
    });
  }

  Environment<N> environment_;
  bool rendered_, in_quarter_ = false;
  std::size_t kinds_;  ///< surfaces and springs
  Part part_;
  double pressed_ = 0.0;  ///< ∫|f| dt / T so far
  std::uint64_t looks_ = 0, seen_ = 0;
  States states_;
};

/// What becomes of the scene's object.
class ObjectWatch {
 public:
  void add(const Row<kJointPort>& row, double period_s) {
    const Eigen::Vector3d& x = row.object.x;
    if (!first_) first_ = before_ = x;
    highest_m_ = std::max(highest_m_, x.z() - first_->z());
    fall_m_per_s_ = std::max(fall_m_per_s_, (before_->z() - x.z()) / period_s);
    before_ = x;
  }
  void fill(const ObjectSpec& object, Summary& s) const {
    if (!before_) return;
    schema::ObjectFigures& figures = *s.mutable_object();
    figures.set_off_target_m((*before_ - object.target_m).norm());
    figures.set_lifted_m(highest_m_);
    figures.set_fall_m_per_s(fall_m_per_s_);
  }

 private:
  std::optional<Eigen::Vector3d> first_, before_;
  double highest_m_ = 0.0, fall_m_per_s_ = 0.0;
};

/// The verdict of the loop as the scene leaves it, and in the other states: the worst.
template <int N>
TailVerdict judge_all(const Simulation<N>& at_end, const Contacts<N>& contacts, const Scene& scene,
                      const MotionScale& scale, TwinUse twin) {
  TailVerdict worst = judge_tail(at_end, scene, scale, twin);
  for (const auto* state : contacts.states().all()) {
    if (worst.verdict.kind == VerdictKind::unstable) break;
    const TailVerdict held = judge_tail(**state->at, scene, scale, twin);
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
  if (options.trace != nullptr) trace.emplace(*options.trace, scene.coordinates());

  const bool is_kept = trace || options.table != nullptr || recording != nullptr;
  const auto keep = [&](const Row<N>& row) {
    if (trace) trace->add(row);
    if (options.table != nullptr) options.table->add(row);
    if (recording != nullptr) recording->add(row);
  };
  bool goes_on = true;
  Contacts<N> contacts{scene};
  std::uint64_t ticks = 0;
  std::chrono::duration<double, std::nano> spent{0};
  // Springs alone answer the same wherever the robot is.
  const bool tails = from != VerdictFrom::plain;
  const bool probes = tails && !alone && options.robot == nullptr && !World{scene.environment}.surfaces.empty();
  const double end_s = to_seconds(simulation.end()).si();
  std::uint64_t rows = 0;
  ObjectWatch object;
  for (const Part& part : probes ? parts(simulation.segment_times(), end_s) : std::vector{Part{.until_s = end_s}}) {
    contacts.begin(part);
    const auto start = ThreadClock::now();
    ticks += simulation.run_until(to_duration(part.until_s), [&](const Row<N>& row) {
      if (is_kept && rows++ % options.trace_every == 0) [[unlikely]]
        keep(row);
      if (probes) contacts.add(row);
      if constexpr (N == kJointPort)
        if (scene.object) object.add(row, 1.0 / scene.master_rate_hz);
      return goes_on = metrics.add(row);
    });
    spent += ThreadClock::now() - start;
    if (!goes_on) break;
    if (probes) contacts.end(simulation, part.until_s >= end_s);
  }

  Summary s;
  metrics.fill(s);
  describe_run(scene, "lab", s);
  if (scene.object) object.fill(*scene.object, s);
  s.set_step_ns(spent.count() / static_cast<double>(std::max<std::uint64_t>(ticks, 1)));
  const RunJudge<N>& judge = metrics.judge();
  if (tails && !judge.diverged() && judge.not_judged().empty()) {
    const TailVerdict judged = judge_all(simulation, contacts, scene, judge.scale(),
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

VerdictFrom verdict_from(std::string_view name, std::string_view option) {
  for (const auto& [known, from] :
       {std::pair{"tail", VerdictFrom::tail}, {"lean", VerdictFrom::lean}, {"plain", VerdictFrom::plain}})
    if (name == known) return from;
  throw ConfigError{fmt::format("{}={}: it must be tail, lean or plain", option, name)};
}

bool has_plugin(const Scene& scene) {
  const auto is_plugin = [](const ControlOptions& c) { return transparency_layer(c).is_external; };
  return is_plugin(scene.control) || std::any_of(scene.schedule.begin(), scene.schedule.end(),
                                                 [&](const ScheduledControl& s) { return is_plugin(s.control); });
}

Summary run(const Scene& scene, const RunOptions& options) {
  return run_counted(scene, options).summary;
}

namespace {

/// One coupling, that of the gripper where `of_gripper`; recorded into `file`, where that is not null.
CountedRun run_coupling(const Scene& scene, const RunOptions& options, mcap::Writer* file, bool of_gripper) {
  return for_dof(scene.dof, [&]<int N>() {
    const auto make = [&](Taps<N>* taps) {
      return options.robot ? make_simulation<N>(scene, *options.robot, taps) : make_simulation<N>(scene, taps);
    };
    if (file == nullptr) {
      std::unique_ptr<Simulation<N>> simulation = make(nullptr);
      if (options.stop != nullptr) simulation->stop_at(*options.stop);
      return run_as<N>(*simulation, scene, options, nullptr);
    }
    LabRecording<N> recording{*file, scene, *options.record, of_gripper};
    return run_as<N>(*make(&recording.taps()), scene, options, &recording);
  });
}

}  // namespace

CountedRun run_counted(const Scene& scene, const RunOptions& options) {
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
                                             .table = options.gripper_table,
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

}  // namespace twoport::lab
