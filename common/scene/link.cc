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
  const std::string file = (scene_folder / of.text(FIELD(trace_file))).string();
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
    if (error != std::errc{} || stop != entry.data() + entry.size() || !kDelay.holds(ms))
      of.fail(
          fmt::format("{}: {}:{}: \"{}\" is not a delay in ms; it must {}", field, file, line, entry, kDelay.words));
    delays.push_back(ms * 1e-3);
  }
  if (delays.empty()) of.fail(fmt::format("{}: {} holds no delay; it must hold one a line", field, file));
  return delays;
}

GilbertElliottOptions read_burst(const Block<schema::GilbertElliott>& of) {
  return {.p = of.required(FIELD(p), kProbability),
          .r = of.required(FIELD(r), kProbability),
          .loss_good = of.number(FIELD(loss_good), kProbability),
          .loss_bad = of.number(FIELD(loss_bad), kProbability)};
}

}  // namespace

ImpairmentOptions read_impairment(const Block<schema::Impairment>& of) {
  ImpairmentOptions options;
  options.delay_s = of.number(FIELD(delay_ms), kDelay) * 1e-3;
  options.jitter_s = of.number(FIELD(jitter_ms), kDelay) * 1e-3;
  options.jitter_distribution = of.choice<JitterDistribution>(FIELD(jitter_distribution));
  options.loss = of.number(FIELD(loss), kProbability);
  if (of.has(FIELD(burst))) options.burst = read_burst(of.block(FIELD(burst)));
  for (const auto& window : of.blocks(FIELD(blackout)))
    options.blackout.push_back({.start_s = window.required(FIELD(start_s), kNotNegative),
                                .duration_s = window.required(FIELD(duration_s), kPositive)});
  options.duplicate = of.number(FIELD(duplicate), kProbability);
  options.reorder = of.number(FIELD(reorder), kProbability);
  options.reorder_s = of.number(FIELD(reorder_ms), kDelay) * 1e-3;
  if (of.has(FIELD(trace_file))) options.recorded_delay_s = read_recorded_delays(of);
  for (const auto& step : of.blocks(FIELD(delay_step))) {
    if (of.has(FIELD(trace_file)))
      of.fail(fmt::format("{} is given, but {} too, which holds the delays", step.path(), of.path_of("trace_file")));
    const double at_s = step.required(FIELD(at_s), kNotNegative);
    if (!options.delay_step.empty() && !(at_s > options.delay_step.back().at_s))
      step.refuse(FIELD(at_s), "be later than that of the step before");
    options.delay_step.push_back({.at_s = at_s, .delay_s = step.required(FIELD(delay_ms), kDelay) * 1e-3});
  }
  return options;
}

TransmissionOptions read_transmission(const Block<schema::Impairment>& of) {
  TransmissionOptions spec;
  spec.playout_s = of.number(FIELD(playout_ms), kDelay) * 1e-3;
  if (!of.has(FIELD(deadband))) return spec;
  const auto band = of.block(FIELD(deadband));
  spec.deadband = DeadbandOptions{.ratio = band.required(FIELD(ratio), kProbability),
                                  .position_m = band.number(FIELD(position_m), kNotNegative),
                                  .velocity_m_per_s = band.number(FIELD(velocity_m_per_s), kNotNegative),
                                  .force_n = band.number(FIELD(force_n), kNotNegative),
                                  .energy_j = band.number(FIELD(energy_j), kNotNegative),
                                  .silence_s = band.number(FIELD(silence_ms), kDelay) * 1e-3};
  return spec;
}

ClockSpec read_clock(const Block<schema::Clock>& of) {
  constexpr Rule kDrift{[](double v) { return v >= -1e5 && v <= 1e5; }, "be between -100000 and 100000"};
  return {.offset_s = of.number(FIELD(offset_ms), kDelay) * 1e-3, .drift = of.number(FIELD(drift_ppm), kDrift) * 1e-6};
}

}  // namespace twoport
