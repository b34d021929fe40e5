#pragma once

#include <string>
#include <vector>

#include "common/record/summary.h"
#include "common/scene/scene.h"

namespace twoport {

/// What the scene expects and the run did not meet: one sentence each, with the key, the value and the bound. Empty: all
/// is met. An UNDECIDED run meets neither `stable: true` nor `stable: false`. Throws ConfigError for a key that no summary
/// has.
std::vector<std::string> violations(const ExpectSpec& expect, const Summary& summary);

}  // namespace twoport
