#pragma once

#include <spdlog/logger.h>

#include <string>

#include "common/base/fmt.h"

namespace twoport {

/// An unregistered logger: lines on stderr with time, `program` and level, in colour on a terminal. Pass it by
/// reference. It writes at once and may wait for the terminal: do not use it in a control step.
spdlog::logger make_log(const std::string& program, spdlog::level::level_enum least = spdlog::level::info);

}  // namespace twoport
