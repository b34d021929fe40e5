#include "common/platform/log.h"

#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_color_sinks.h>

#include <memory>
#include <string_view>

#include "common/base/text.h"

namespace twoport {
namespace {

/// The message as a terminal may show it: names in it come from files and drivers.
class Message : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm&, spdlog::memory_buf_t& to) override {
    const std::string text = printable(std::string_view{message.payload.data(), message.payload.size()});
    to.append(text.data(), text.data() + text.size());
  }
  [[nodiscard]] std::unique_ptr<custom_flag_formatter> clone() const override { return std::make_unique<Message>(); }
};

}  // namespace

spdlog::logger make_log(const std::string& program, spdlog::level::level_enum least) {
  spdlog::logger log{program, std::make_shared<spdlog::sinks::stderr_color_sink_mt>()};
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  formatter->add_flag<Message>('*').set_pattern("%H:%M:%S.%e %n %^%l%$: %*");
  log.set_formatter(std::move(formatter));
  log.set_level(least);
  log.flush_on(spdlog::level::trace);
  return log;
}

}  // namespace twoport
