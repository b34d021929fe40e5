#pragma once

#include <string>

#include "common/record/summary.h"
#include "common/scene/scene.h"

namespace twoport::lab {

/// Runs a scene in virtual time. Writes `trace_path` unless it is empty. The same scene and seed give the same summary
/// to the bit, `step_ns` (the mean wall time of a tick) excepted. Throws ConfigError when the trace cannot be written.
Summary run(const Scene& scene, const std::string& trace_path = {});

}  // namespace twoport::lab
