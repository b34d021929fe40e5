#include "common/scene/trace_file.h"

#include <optional>
#include <string_view>

#include "common/base/file.h"
#include "common/base/text.h"
#include "common/link/link_trace.h"
#include "common/scene/find.h"

namespace twoport {

std::vector<double> read_trace_file(const Block<schema::Impairment>& of, double rate_hz) {
  if (!of->has_trace_file()) return {};
  const std::string file = file_beside(of.context().file, of->trace_file());
  const std::string field = of.path_of("trace_file");
  const std::string text = read_text(file, fmt::format("{}: {}: {}", of.context().file, field, file));
  if (is_link_trace(text)) {
    const LinkTrace trace = parse_link_trace(text, fmt::format("{}: {}: {}", of.context().file, field, file));
    const TracedWay& way = of.path() == "to_slave" ? trace.to_slave : trace.to_master;
    if (way.empty()) of.fail(fmt::format("{}: {} has no row of {}; it must have one a packet", field, file, of.path()));
    return delays_at(way, rate_hz);
  }
  std::vector<double> delays;
  int line = 0;
  for (std::string_view rest = text; !rest.empty();) {
    ++line;
    const std::string_view entry = take_line(rest);
    if (entry.empty()) continue;
    const std::optional<double> ms = number_from<double>(entry);
    if (!ms || !(*ms >= 0.0 && *ms <= 1e6))
      of.fail(fmt::format("{}: {}:{}: \"{}\" is not a delay in ms; it must be between 0 and 1000000", field, file, line,
                          entry));
    delays.push_back(*ms * 1e-3);
  }
  if (delays.empty()) of.fail(fmt::format("{}: {} holds no delay; it must hold one a line", field, file));
  return delays;
}

}  // namespace twoport
