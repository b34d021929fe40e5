#include "lab/study/tune.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/base/check.h"
#include "common/base/random.h"
#include "common/method/catalogue.h"
#include "lab/study/map.h"
#include "lab/study/parallel.h"

namespace twoport::lab {
namespace {

constexpr double kWorst = 2.0;

double score(const TuneOptions& o, const std::string& method, double round_trip_ms,
             const std::vector<std::string>& gains) {
  double sum = 0.0, count = 0.0;
  for (const std::string& scene : o.scenes) {
    std::vector<std::string> set = o.set;
    set.insert(set.end(), gains.begin(), gains.end());
    const Map map = make_map({.scene = scene,
                              .set = set,
                              .methods = {method},
                              .round_trips_ms = {round_trip_ms},
                              .losses = o.losses,
                              .bursts_packets = {1.0},
                              .stiffnesses_n_per_m = o.stiffnesses_n_per_m,
                              .seeds = 1,
                              .verdict = VerdictFrom::lean,
                              .jobs = 1});
    for (std::size_t p = 0; p < map.places.size(); ++p, ++count) {
      const MapCell& cell = map.at(0, p);
      sum += cell.stable == 1 ? std::min(kWorst, cell.error_n.mean / map.reference_n[p]) : kWorst;
    }
  }
  return sum / count;
}

Tuned search(const TuneOptions& o, const std::string& method, double round_trip_ms) {
  const std::vector<Gain> gains = gains_of(method);
  Tuned found;
  found.method = method;
  found.round_trip_ms = round_trip_ms;
  found.rule = found.best = score(o, method, round_trip_ms, {});
  const Random random{o.seed};
  std::vector<double> best;
  for (int e = 1; e < o.evaluations; ++e) {
    const bool near = 2 * e >= o.evaluations && !best.empty();
    std::vector<double> values;
    std::vector<std::string> overrides;
    for (std::size_t g = 0; g < gains.size(); ++g) {
      const double u = random.uniform(static_cast<std::uint64_t>(e), static_cast<unsigned>(g));
      const double value = near ? std::clamp(best[g] * std::pow(2.0, 2.0 * u - 1.0), gains[g].low, gains[g].high)
                                : gains[g].low * std::pow(gains[g].high / gains[g].low, u);
      values.push_back(value);
      overrides.push_back(fmt::format("{}={:.4g}", gains[g].path, value));
    }
    const double reached = score(o, method, round_trip_ms, overrides);
    if (reached >= found.best) continue;
    found.best = reached;
    found.overrides = overrides;
    best = values;
  }
  return found;
}

}  // namespace

std::vector<Gain> gains_of(const std::string& method) {
  if (method == "CLASSIC" || method == "FORCE_PROJECTED")
    return {{"control.passivity.max_gain", 1.0, 300.0}, {"control.virtual_coupling.catch_up_m_per_s", 0.01, 1.0}};
  if (method == "FIXED_DAMPING")
    return {{"control.passivity.fixed_damping.stiffness_n_per_m", 20.0, 2000.0},
            {"control.passivity.fixed_damping.damping_n_s_per_m", 1.0, 100.0}};
  if (method == "WAVE_VARIABLES")
    return {{"control.passivity.wave_variables.impedance_n_s_per_m", 1.0, 100.0},
            {"control.passivity.wave_variables.position_correction_per_s", 0.01, 10.0}};
  if (method == "SET_POSITION_MODULATION")
    return {{"control.passivity.set_position_modulation.stiffness_n_per_m", 50.0, 4000.0},
            {"control.passivity.set_position_modulation.damping_n_s_per_m", 0.5, 50.0},
            {"control.passivity.set_position_modulation.energy_ceiling_j", 1e-3, 1.0}};
  if (method == "ENERGY_TANK")
    return {{"control.passivity.energy_tank.desired_level_j", 1e-3, 1.0},
            {"control.passivity.energy_tank.level_gain_n_s_per_m_per_j", 10.0, 1e4},
            {"control.passivity.energy_tank.transfer_per_s", 0.3, 50.0}};
  if (method == "FOUR_CHANNEL")
    return {{"control.passivity.four_channel.force_gain", 0.05, 1.0},
            {"control.passivity.four_channel.observer_bandwidth_rad_per_s", 10.0, 1000.0}};
  if (method == "FRACTAL_IMPEDANCE") return {{"control.passivity.fractal_impedance.stiffness_n_per_m", 10.0, 3000.0}};
  return {};
}

std::vector<Tuned> tune(const TuneOptions& o, const Heard& heard) {
  if (o.evaluations < 1) throw ConfigError{fmt::format("--evaluations is {}; it must be at least 1", o.evaluations)};
  std::vector<std::string> methods = o.methods;
  if (methods.empty())
    for (const std::string& method : method_names())
      if (!gains_of(method).empty()) methods.push_back(method);
  for (const std::string& method : methods)
    if (gains_of(method).empty())
      throw ConfigError{fmt::format("--methods has {}; it has no gains of its own", method)};
  std::vector<Tuned> all(methods.size() * o.round_trips_ms.size());
  Tally tally{all.size(), heard};
  for_each_parallel(all.size(), o.jobs, [&](std::size_t i) {
    all[i] = search(o, methods[i / o.round_trips_ms.size()], o.round_trips_ms[i % o.round_trips_ms.size()]);
    tally.done();
  });
  return all;
}

std::string to_text(const std::vector<Tuned>& all) {
  std::string out = fmt::format("{:<24} {:>13} {:>7} {:>7}  {}\n", "method", "round trip ms", "rule", "best", "gains");
  for (const Tuned& each : all) {
    std::string gains;
    for (const std::string& one : each.overrides)
      gains += fmt::format("{}{}", gains.empty() ? "" : " ", one.substr(one.rfind('.', one.find('=')) + 1));
    out += fmt::format("{:<24} {:>13} {:>7.3f} {:>7.3f}  {}\n", each.method, each.round_trip_ms, each.rule, each.best,
                       gains.empty() ? "of the rule" : gains);
  }
  return out;
}

}  // namespace twoport::lab
