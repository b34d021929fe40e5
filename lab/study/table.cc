#include "lab/study/table.h"

#include <fmt/format.h>

#include <algorithm>
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

}  // namespace twoport::lab
