#include "lab/study/seeds.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace twoport::lab {

bool smallest_is_worst(std::string_view figure) {
  constexpr std::array<std::string_view, 6> kNames = {"stable", "held_force_ratio", "contact_s",
                                                      "steps",  "duration_s",       "environment_force_mean_n"};
  if (std::find(kNames.begin(), kNames.end(), figure) != kNames.end()) return true;
  if (figure.starts_with("min_") || figure.ends_with("_min_energy_j")) return true;
  if (figure.starts_with("packets.")) return figure.ends_with(".sent") || figure.ends_with(".received");
  return figure.ends_with("_share") && figure != "muted_share";
}

Spread spread(std::string_view figure, std::span<const double> values) {
  const double count = static_cast<double>(values.size()), first = values.front();
  double sum = 0.0, above_first = 0.0;
  for (const double v : values) sum += v, above_first += v - first;
  Spread s{.mean = first + above_first / count, .sd = 0.0, .worst = first};
  if (!std::isfinite(s.mean)) s.mean = sum / count;  // ±inf stays what it is
  double squares = 0.0;
  for (const double v : values) squares += (v - s.mean) * (v - s.mean);
  if (values.size() > 1) s.sd = std::sqrt(squares / (count - 1.0));
  const bool smallest = smallest_is_worst(figure);
  for (const double v : values) {
    if (std::isnan(v)) s.worst = v;
    if (smallest ? v < s.worst : v > s.worst) s.worst = v;
  }
  return s;
}

Spread spread(const Figure& figure, std::span<const Summary> of_seeds) {
  std::vector<double> values;
  for (const Summary& summary : of_seeds) values.push_back(figure.of(summary));
  return spread(figure.name(), values);
}

std::size_t worst_seed(const std::vector<Summary>& of_seeds) {
  const auto energy = [](const Summary& s) {
    return std::isnan(s.min_port_energy_j()) ? -std::numeric_limits<double>::infinity() : s.min_port_energy_j();
  };
  const auto worse = [&](const Summary& a, const Summary& b) {
    return a.stable() != b.stable() ? b.stable() : energy(a) < energy(b);
  };
  return static_cast<std::size_t>(std::min_element(of_seeds.begin(), of_seeds.end(), worse) - of_seeds.begin());
}

}  // namespace twoport::lab
