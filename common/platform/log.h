#pragma once

#include <spdlog/logger.h>

#include <string>

namespace twoport {

/// A logger of its own, registered nowhere: lines on stderr with time, `program` and level, in colour on a terminal.
/// Pass it on by reference. It writes at once and may wait for the terminal: never from a control step.
spdlog::logger make_log(const std::string& program, spdlog::level::level_enum least = spdlog::level::info);

}  // namespace twoport
