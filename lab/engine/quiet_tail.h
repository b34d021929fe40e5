#pragma once

#include <cstdint>

#include "common/record/verdict.h"
#include "common/scene/scene.h"
#include "lab/engine/simulation.h"

namespace twoport::lab {

/// When a tail is run beside a twin. Without one a growth that the motion itself does not show is not found.
enum class TwinUse : unsigned char {
  always,
  under_control,  ///< from the start anew where a passivity controller acts in the tail without one
};

/// A verdict, and the ticks that were simulated for it.
struct TailVerdict {
  Verdict verdict;
  std::uint64_t ticks = 0;
};

/// Judges the loop in the state that `at` is in: goes on from there with the loop left alone (Simulation::be_quiet), beside a
/// twin whose every coordinate that has moved is kicked at the beginning by
///
///     δv = ± min(1e-3 V, max(1e-6 V, 1e6 u))     V: its largest speed in the run, u: what rounding makes of it
///
/// until judge() decides, at 1/4, 1/2, 1, 2, 4 … 32 lengths of the scene. `run` is how large the motion of the run was.
/// A body that nobody drives has no loop: it is judged by its mechanical energy, without a twin.
template <int N>
TailVerdict judge_tail(const Simulation<N>& at, const Scene& scene, const MotionScale& run,
                       TwinUse twin = TwinUse::always);

extern template TailVerdict judge_tail<1>(const Simulation<1>&, const Scene&, const MotionScale&, TwinUse);
extern template TailVerdict judge_tail<3>(const Simulation<3>&, const Scene&, const MotionScale&, TwinUse);
extern template TailVerdict judge_tail<6>(const Simulation<6>&, const Scene&, const MotionScale&, TwinUse);
extern template TailVerdict judge_tail<kJointPort>(const Simulation<kJointPort>&, const Scene&, const MotionScale&,
                                                   TwinUse);

}  // namespace twoport::lab
