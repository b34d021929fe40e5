#include "lab/run.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "common/coupling/registration.h"
#include "common/record/metrics.h"
#include "common/record/trace.h"
#include "lab/engine/quiet_tail.h"
#include "lab/engine/simulation.h"

namespace twoport::lab {
namespace {

/// Parts of a run, each to the end of a segment of the operator's path or, where the path has no more than one, sixteenths.
/// Times of their ends [s].
std::vector<double> parts(std::vector<double> segment_ends_s, double end_s) {
  std::erase_if(segment_ends_s, [&](double t) { return !(t > 0.0 && t < end_s); });
  if (segment_ends_s.empty())
    for (int i = 1; i < 16; ++i) segment_ends_s.push_back(end_s * i / 16);
  segment_ends_s.push_back(end_s);
  return segment_ends_s;
}

/// The state in which a run has pressed most against its environment: at the end of the part with the largest ∫|f| dt. An
/// integral, as a loop that bounces presses now and then.
template <int N>
class MostPressed {
 public:
  /// A tick of the run.
  void see(const Row<N>& row) { pressed_ += std::sqrt(row.env_f.squared_norm()); }
  /// A part of the run is over.
  void end_part(const Simulation<N>& now, double now_s, bool last) {
    const double pressed = std::exchange(pressed_, 0.0);
    if (!(pressed > most_)) return;
    at_ = last ? nullptr : now.copy();
    at_s_ = now_s;
    most_ = pressed;
  }
  /// Null: it never pressed, or most in the last part.
  [[nodiscard]] const Simulation<N>* at() const { return at_.get(); }
  [[nodiscard]] double at_s() const { return at_s_; }

 private:
  std::unique_ptr<Simulation<N>> at_;
  double at_s_ = 0.0, most_ = 0.0, pressed_ = 0.0;
};

int severity(VerdictKind kind) {
  switch (kind) {
    case VerdictKind::stable:
      return 0;
    case VerdictKind::restless:
      return 1;
    case VerdictKind::undecided:
      return 2;
    case VerdictKind::unstable:
      break;
  }
  return 3;
}

/// The verdict of the loop as the scene leaves it and, where it has pressed more before, as it was there: the worse counts.
template <int N>
TailVerdict judge_twice(const Simulation<N>& at_end, const MostPressed<N>& most_pressed, const Scene& scene,
                        const MotionScale& scale) {
  TailVerdict left = judge_tail(at_end, scene, scale);
  if (left.verdict.kind == VerdictKind::unstable || most_pressed.at() == nullptr) return left;
  TailVerdict pressed = judge_tail(*most_pressed.at(), scene, scale);
  pressed.ticks += left.ticks;
  pressed.verdict.text += fmt::format(" (held where it pressed most, at {:.4g} s)", most_pressed.at_s());
  if (severity(pressed.verdict.kind) <= severity(left.verdict.kind)) pressed.verdict = left.verdict;
  return pressed;
}

template <int N>
CountedRun run_as(Simulation<N>& simulation, const Scene& scene, const RunOptions& options) {
  const bool alone = scene.control.architecture == Architecture::uncontrolled;
  const bool link = simulation.link().has_value();
  const double rate_hz = alone ? scene.slave_rate_hz : scene.master_rate_hz;
  Metrics<N> metrics{
      {.rate_hz = rate_hz,
       .duration_s = scene.duration_s,
       .quiet_from_s = simulation.quiet_from_s(),
       .initial_energy_j = simulation.initial_energy().si(),
       .controller = has_controller(scene),
       .coarse = is_coarse(scene),
       .link = link},
      Registration<N>{scene.control}.to_master(Energy{1.0}).si(),
      {.hand = !alone, .link = link, .robot = link || alone, .robot_energy = link, .rests = rests(scene)}};
  std::optional<Trace<N>> trace;
  if (options.trace != nullptr) trace.emplace(*options.trace);

  bool goes_on = true;
  MostPressed<N> most_pressed;
  std::uint64_t ticks = 0;
  std::chrono::duration<double, std::nano> spent{0};
  // Springs alone answer the same wherever the robot is.
  const bool probes = options.verdict == VerdictFrom::tail && !alone && !World{scene.environment}.surfaces.empty();
  const double end_s = to_seconds(simulation.end()).si();
  for (const double until_s : probes ? parts(simulation.segment_ends_s(), end_s) : std::vector{end_s}) {
    const auto start = std::chrono::steady_clock::now();
    ticks += simulation.run_until(to_duration(until_s), [&](const Row<N>& row) {
      if (trace) trace->add(row);
      if (probes) most_pressed.see(row);
      return goes_on = metrics.add(row);
    });
    spent += std::chrono::steady_clock::now() - start;
    if (!goes_on) break;
    if (probes) most_pressed.end_part(simulation, until_s, until_s >= end_s);
  }

  Summary s;
  metrics.fill(s);
  describe_run(scene, "lab", s);
  s.set_step_ns(spent.count() / static_cast<double>(std::max<std::uint64_t>(ticks, 1)));
  const RunJudge<N>& judge = metrics.judge();
  if (options.verdict == VerdictFrom::tail && !judge.diverged() && judge.not_judged().empty()) {
    const TailVerdict judged = judge_twice(simulation, most_pressed, scene, judge.scale());
    set_verdict(judged.verdict, s);
    ticks += judged.ticks;
  }
  say_if_coupling_feeds(s, scene.control.initial_energy);
  if (const std::optional<LinkUse> use = simulation.link()) {
    schema::Directions& packets = *s.mutable_packets();
    *packets.mutable_to_slave() = received_packets(use->slave);
    packets.mutable_to_slave()->set_sent(count(use->master.sent));
    *packets.mutable_to_master() = received_packets(use->master);
    packets.mutable_to_master()->set_sent(count(use->slave.sent));
    if (use->overflowed > 0) s.mutable_verdict()->append("; packets in flight exceeded the line's room");
  }
  return {s, ticks};
}

}  // namespace

Summary run(const Scene& scene, const RunOptions& options) {
  return run_counted(scene, options).summary;
}

CountedRun run_counted(const Scene& scene, const RunOptions& options) {
  return dispatch_dof(scene, [&]<int N>() { return run_as(*make_simulation<N>(scene), scene, options); });
}

}  // namespace twoport::lab
