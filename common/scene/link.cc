#include <optional>
#include <string_view>

#include "common/base/file.h"
#include "common/base/text.h"
#include "common/link/link_trace.h"
#include "common/scene/blocks.h"
#include "common/scene/find.h"

namespace twoport {
namespace {

static_assert(same_number(JitterDistribution::normal, schema::Impairment::NORMAL) &&
              same_number(JitterDistribution::uniform, schema::Impairment::UNIFORM) &&
              same_number(JitterDistribution::pareto, schema::Impairment::PARETO) &&
              same_number(JitterDistribution::pareto, schema::Impairment::Jitter_MAX));

GilbertElliottOptions read_burst(const Block<schema::GilbertElliott>& of) {
  return {.p = of->p(), .r = of->r(), .loss_good = of->loss_good(), .loss_bad = of->loss_bad()};
}

}  // namespace

ImpairmentOptions read_impairment(const Block<schema::Impairment>& of) {
  ImpairmentOptions options;
  options.delay_s = of->delay_ms() * 1e-3;
  options.jitter_s = of->jitter_ms() * 1e-3;
  options.jitter_distribution = static_cast<JitterDistribution>(of->jitter_distribution());
  options.loss = of->loss();
  if (of->has_burst()) options.burst = read_burst(of.block(FIELD(burst)));
  for (const auto& window : of.blocks(FIELD(blackout)))
    options.blackout.push_back({.start_s = window->start_s(), .duration_s = window->duration_s()});
  options.duplicate = of->duplicate();
  options.reorder = of->reorder();
  options.reorder_s = of->reorder_ms() * 1e-3;
  for (const auto& step : of.blocks(FIELD(delay_step))) {
    if (of->has_trace_file())
      of.fail(fmt::format("{} is given, but {} too, which holds the delays", step.path(), of.path_of("trace_file")));
    const double at_s = step->at_s();
    if (!options.delay_step.empty() && !(at_s > options.delay_step.back().at_s))
      step.refuse(FIELD(at_s), "be later than that of the step before");
    options.delay_step.push_back({.at_s = at_s, .delay_s = step->delay_ms() * 1e-3});
  }
  return options;
}

TransmissionOptions read_transmission(const Block<schema::Impairment>& of) {
  TransmissionOptions spec;
  spec.playout_s = of->playout_ms() * 1e-3;
  if (!of->has_deadband()) return spec;
  const auto band = of.block(FIELD(deadband));
  spec.deadband = DeadbandOptions{.ratio = band->ratio(),
                                  .position_m = band->position_m(),
                                  .velocity_m_per_s = band->velocity_m_per_s(),
                                  .force_n = band->force_n(),
                                  .energy_j = band->energy_j(),
                                  .silence_s = band->silence_ms() * 1e-3};
  return spec;
}

ClockSpec read_clock(const Block<schema::Clock>& of) {
  return {.offset_s = of->offset_ms() * 1e-3, .drift = of->drift_ppm() * 1e-6};
}

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
      of.fail(fmt::format(
          "{}: {}:{}: \"{}\" is not a delay in ms; it must be between 0 and 1000000, or the file begin with "
          "{}",
          field, file, line, in_one_line(entry.substr(0, 60)), kLinkTraceHeader));
    delays.push_back(*ms);
  }
  if (const std::string why = why_no_delays(delays); !why.empty()) of.fail(fmt::format("{}: {}: {}", field, file, why));
  for (double& each : delays) each *= 1e-3;
  if (delays.empty()) of.fail(fmt::format("{}: {} holds no delay; it must hold one a line", field, file));
  return delays;
}

}  // namespace twoport
