#pragma once

#include <atomic>
#include <cstdint>
#include <string_view>

#include "common/base/file.h"
#include "common/record/summary.h"
#include "common/record/trace_table.h"
#include "common/scene/scene.h"

namespace twoport::lab {

struct HostedRobot;
struct RecordingOptions;

/// What the verdict is made from.
enum class VerdictFrom : unsigned char {
  tail,   ///< the loop left alone after the scene's end, beside a twin: decides nearly always, for some three more runs
  lean,   ///< the same, with the twin only where a passivity controller acts: half as many ticks
  plain,  ///< the scene's own run, as a live side judges it: costs nothing, and says UNDECIDED more often
};
/// By its name. Throws ConfigError that begins with `option`.
VerdictFrom verdict_from(std::string_view name, std::string_view option = "--verdict");

struct RunOptions {
  WholeFile* trace = nullptr;     ///< takes the rows of the scene's run; the caller commits it
  std::uint64_t trace_every = 1;  ///< one row in so many
  VerdictFrom verdict = VerdictFrom::tail;
  WholeFile* gripper_trace = nullptr;        ///< as trace, of the gripper; used where the scene has one
  const RecordingOptions* record = nullptr;  ///< null: nothing is recorded
  TraceTable* table = nullptr;               ///< takes the rows of the trace too
  TraceTable* gripper_table = nullptr;       ///< as table, of the gripper
  const std::atomic<bool>* stop = nullptr;   ///< ends the run, by lab::Stopped, soon after it has become true
  const HostedRobot* robot = nullptr;        ///< in place of the scene's robot and environment, unless null
};

/// Runs a scene in virtual time. A gripper runs by itself, over the same packets: both couplings draw the fate of packet k from the
/// scene's seed, and share nothing else in virtual time. Everything but the verdict comes from the scene's own run. The same scene and seed give the
/// same summary to the bit, `step_ns` (the mean processor time of a tick of the scene's run) excepted.
Summary run(const Scene& scene, const RunOptions& options = {});

/// A transparency layer in a process of its own goes on in one run only: neither the judge's twin nor a replay can have it.
bool has_plugin(const Scene& scene);

/// The same, and how many ticks were simulated for it, those for the verdict included.
struct CountedRun {
  Summary summary;
  std::uint64_t ticks;
};
CountedRun run_counted(const Scene& scene, const RunOptions& options = {});

/// As one run: where the arm is stable and its gripper is not, stable, verdict and verdict_kind become the gripper's, the verdict with
/// "gripper: " before it.
inline Summary with_verdict_of_both(Summary s) {
  if (!s.stable() || !s.gripper().has_stable() || s.gripper().stable()) return s;
  s.set_stable(false);
  s.set_verdict("gripper: " + s.gripper().verdict());
  s.set_verdict_kind(s.gripper().verdict_kind());
  return s;
}

}  // namespace twoport::lab
