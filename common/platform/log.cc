#include "common/platform/log.h"

#include <spdlog/sinks/stdout_color_sinks.h>

#include <memory>

namespace twoport {

spdlog::logger make_log(const std::string& program, spdlog::level::level_enum least) {
  spdlog::logger log{program, std::make_shared<spdlog::sinks::stderr_color_sink_mt>()};
  log.set_pattern("%H:%M:%S.%e %n %^%l%$: %v");
  log.set_level(least);
  log.flush_on(spdlog::level::trace);
  return log;
}

}  // namespace twoport
