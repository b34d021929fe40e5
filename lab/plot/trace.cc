#include "lab/plot/trace.h"

#include <fmt/format.h>

#include <cmath>
#include <fstream>
#include <limits>

#include "common/base/check.h"
#include "common/base/text.h"
#include "lab/study/grid.h"

namespace twoport::lab {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

}  // namespace

TraceFile::TraceFile(const std::string& path, std::size_t most_rows) : path_{path} {
  std::ifstream in{path};
  std::string line;
  if (!std::getline(in, line)) throw ConfigError{fmt::format("{}: is no trace", path)};
  std::vector<std::vector<double>*> columns;
  for (const std::string_view name : parts_of(line, ',')) columns.push_back(&columns_[std::string{name}]);
  const auto begin = in.tellg();
  std::size_t rows = 0;
  for (std::string each; std::getline(in, each);) ++rows;
  in.clear();
  in.seekg(begin);
  const std::size_t step = rows / most_rows + 1;
  for (std::size_t row = 0; std::getline(in, line); ++row) {
    if (row % step != 0) continue;
    const std::vector<std::string_view> values = parts_of(line, ',');
    for (std::size_t i = 0; i < columns.size(); ++i)
      columns[i]->push_back(i < values.size() ? number_from<double>(values[i]).value_or(kNone) : kNone);
  }
  t_ = (*this)["t_s"];
}

const std::vector<double>& TraceFile::operator[](const std::string& column) const {
  const auto found = columns_.find(column);
  if (found == columns_.end()) throw ConfigError{fmt::format("{}: has no column {}", path_, column)};
  return found->second;
}

double TraceFile::norm(const std::string& column, std::size_t row, int first, int count) const {
  double sum = 0.0;
  for (int i = first; i < first + count; ++i)
    if (const auto found = columns_.find(fmt::format("{}_{}", column, i)); found != columns_.end())
      sum += found->second[row] * found->second[row];
  return std::sqrt(sum);
}

}  // namespace twoport::lab
