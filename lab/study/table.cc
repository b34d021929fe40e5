#include "lab/study/table.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace twoport::lab {

Value Value::finite(double number) {
  return std::isfinite(number) ? Value{number} : Value{};
}

double Value::number() const {
  const double* const found = std::get_if<double>(&is_);
  return found != nullptr ? *found : std::numeric_limits<double>::quiet_NaN();
}

std::string Value::text() const {
  if (const double* number = std::get_if<double>(&is_)) return fmt::format("{}", *number);
  const std::string* const found = std::get_if<std::string>(&is_);
  return found != nullptr ? *found : std::string{};
}

std::optional<std::size_t> Table::find(std::string_view column) const {
  const auto found = std::find(columns.rbegin(), columns.rend(), column);
  if (found == columns.rend()) return std::nullopt;
  return static_cast<std::size_t>(columns.rend() - found) - 1;
}

std::string csv_line(const Values& row) {
  std::string csv;
  for (std::size_t i = 0; i < row.size(); ++i) {
    if (i > 0) csv += ',';
    const std::string text = row[i].text();
    if (!row[i].quoted() && text.find_first_of(",\"\n") == std::string::npos) {
      csv += text;
      continue;
    }
    csv += '"';
    for (const char c : text) csv += c == '"' ? "\"\"" : std::string(1, c);
    csv += '"';
  }
  return csv + '\n';
}

std::string to_csv(const Table& table) {
  std::string csv = csv_line({table.columns.begin(), table.columns.end()});
  for (const Values& row : table.rows) csv += csv_line(row);
  return csv;
}

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

double median(std::vector<double> of) {
  const auto middle = of.begin() + static_cast<std::ptrdiff_t>(of.size() / 2);
  std::nth_element(of.begin(), middle, of.end());
  return of.size() % 2 == 1 ? *middle : 0.5 * (*middle + *std::max_element(of.begin(), middle));
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
