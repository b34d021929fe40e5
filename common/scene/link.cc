#include <algorithm>
#include <charconv>
#include <filesystem>
#include <string_view>

#include "common/base/file.h"
#include "common/scene/blocks.h"
#include "common/scene/text.h"

namespace twoport {
namespace {

static_assert(same_number(JitterDistribution::normal, schema::Impairment::NORMAL) &&
              same_number(JitterDistribution::uniform, schema::Impairment::UNIFORM) &&
              same_number(JitterDistribution::pareto, schema::Impairment::PARETO) &&
              same_number(JitterDistribution::pareto, schema::Impairment::Jitter_MAX));

/// One delay in ms per line; blank lines and what follows a # are skipped. A relative path starts at the scene's folder.
std::vector<double> read_recorded_delays(const Block<schema::Impairment>& of) {
  const std::filesystem::path scene_folder = std::filesystem::path{of.context().file}.parent_path();
  const std::string file = (scene_folder / of->trace_file()).string();
  const std::string field = of.path_of("trace_file");
  const std::string text = read_whole(file, fmt::format("{}: {}: {}", of.context().file, field, file));
  std::vector<double> delays;
  int line = 0;
  for (std::string_view rest = text; !rest.empty();) {
    ++line;
    const std::size_t end = std::min(rest.find('\n'), rest.size());
    const std::string_view whole = rest.substr(0, end);
    const std::string_view entry = trimmed(whole.substr(0, whole.find('#')));
    rest.remove_prefix(std::min(end + 1, rest.size()));
    if (entry.empty()) continue;
    double ms = 0.0;
    const auto [stop, error] = std::from_chars(entry.data(), entry.data() + entry.size(), ms);
    if (error != std::errc{} || stop != entry.data() + entry.size() || !(ms >= 0.0 && ms <= 1e6))
      of.fail(fmt::format("{}: {}:{}: \"{}\" is not a delay in ms; it must be between 0 and 1000000", field, file, line,
                          entry));
    delays.push_back(ms * 1e-3);
  }
  if (delays.empty()) of.fail(fmt::format("{}: {} holds no delay; it must hold one a line", field, file));
  return delays;
}

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
  if (of->has_trace_file()) options.recorded_delay_s = read_recorded_delays(of);
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

}  // namespace twoport
