#pragma once

#include "common/base/file.h"
#include "common/record/summary.h"
#include "common/scene/scene.h"

namespace twoport::lab {

/// Runs a scene in virtual time. Writes its rows into `trace` unless it is null; the caller commits it. The same scene and
/// seed give the same summary to the bit, `step_ns` (the mean wall time of a tick) excepted.
Summary run(const Scene& scene, WholeFile* trace = nullptr);

}  // namespace twoport::lab
