#pragma once

#include "common/record/summary.h"
#include "lab/run.h"

namespace twoport::lab {

/// run(), with the rows of the gripper's trace in `gripper` too, where it is not null and the scene has a gripper.
Summary run_with_gripper_table(const Scene& scene, const RunOptions& options, TraceTable* gripper);

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
