#include "lab/study/grid.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "common/base/check.h"
#include "common/base/print_error.h"
#include "common/base/text.h"

namespace twoport::lab {
namespace {

/// Is `path` within the block or list `whole`?
bool is_part(std::string_view path, std::string_view whole) {
  return path.starts_with(whole) && path.size() > whole.size() &&
         (path[whole.size()] == '.' || path[whole.size()] == '[');
}

}  // namespace

std::vector<std::string_view> parts_of(std::string_view text, char separator) {
  std::vector<std::string_view> all;
  int depth = 0;
  std::size_t from = 0;
  for (std::size_t i = 0; i <= text.size(); ++i) {
    if (i < text.size() && (text[i] == '[' || text[i] == '{')) ++depth;
    if (i < text.size() && (text[i] == ']' || text[i] == '}')) --depth;
    if (i < text.size() && (text[i] != separator || depth > 0)) continue;
    all.push_back(text.substr(from, i - from));
    from = i + 1;
  }
  return all;
}

std::string Axis::name() const {
  return fmt::format("{}", fmt::join(paths, ","));
}

void Axis::append_overrides(std::vector<std::string>& overrides, const std::string& value) const {
  for (const std::string& path : paths) overrides.push_back(path + "=" + value);
}

std::vector<std::string> parse_paths(const std::string& text, const std::string& what) {
  std::vector<std::string> paths;
  for (const std::string_view path : parts_of(text, ',')) {
    if (path.empty()) throw ConfigError{fmt::format("{}: a path is empty; linked paths read A,B", what)};
    if (std::find(paths.begin(), paths.end(), path) != paths.end())
      throw ConfigError{fmt::format("{}: {} is named twice", what, path)};
    paths.emplace_back(path);
  }
  return paths;
}

Axis parse_axis(const std::string& text, const std::string& option) {
  const std::string what = fmt::format("{} {}", option, text);
  const auto wrong = [&](const std::string& words) { return ConfigError{fmt::format("{}: {}", what, words)}; };
  const char* const allowed = "it must read PATH=a,b,c or PATH=start:stop:count or PATH=start:stop:count:log";
  const std::size_t equals = text.find('=');
  if (equals == text.npos || equals == 0 || equals + 1 == text.size()) throw wrong(allowed);
  Axis axis{.paths = parse_paths(text.substr(0, equals), what), .values = {}, .logarithmic = false};
  const std::string_view spec = std::string_view{text}.substr(equals + 1);

  const std::vector<std::string_view> range = parts_of(spec, ':');
  if (range.size() == 1) {
    for (const std::string_view value : parts_of(spec, ',')) {
      if (value.empty()) throw wrong("a value is empty; " + std::string{allowed});
      axis.values.emplace_back(value);
    }
    return axis;
  }
  axis.logarithmic = range.size() == 4 && range[3] == "log";
  if (range.size() != (axis.logarithmic ? 4 : 3)) throw wrong(allowed);
  const auto first = number_from<double>(range[0]), last = number_from<double>(range[1]);
  const auto number = number_from<int>(range[2]);
  if (!first || !last || !number || !std::isfinite(*first) || !std::isfinite(*last)) throw wrong(allowed);
  const double start = *first, stop = *last;
  const int count = *number;
  if (count < 2 || count > static_cast<int>(kMostCells))
    throw wrong(fmt::format("count is {}; it must be 2 to {}", count, kMostCells));
  if (axis.logarithmic && !(start * stop > 0.0))
    throw wrong(fmt::format("start is {}, stop is {}; with :log both must be > 0, or both < 0", start, stop));
  for (int i = 0; i < count; ++i) {
    const double part = static_cast<double>(i) / (count - 1);
    const double value = axis.logarithmic ? start * std::pow(stop / start, part) : start + part * (stop - start);
    // 15 digits: 0.3 and not 0.30000000000000004.
    axis.values.push_back(fmt::format("{:.15g}", i == 0 ? start : i + 1 == count ? stop : value));
  }
  return axis;
}

void refuse_overlap(const Axis& axis, const std::vector<std::string>& varied, const char* option) {
  for (const std::string& path : axis.paths)
    for (const std::string& other : varied) {
      if (path == other) throw ConfigError{fmt::format("{} {}: {} is varied twice", option, axis.name(), path)};
      if (is_part(path, other) || is_part(other, path))
        throw ConfigError{fmt::format("{} {}: {} is a part of {}, which is varied too; vary one of them", option,
                                      axis.name(), std::max(path, other), std::min(path, other))};
    }
}

void warn_if_lost(const std::vector<std::string>& set, const std::vector<std::string>& varied) {
  for (const std::string& assignment : set)
    for (const std::string& path : varied) {
      const std::string_view name = trimmed(std::string_view{assignment}.substr(0, assignment.find('=')));
      if (name == path || is_part(name, path))
        print_error("warning: --set {} has no effect: {} is varied\n", assignment, path);
    }
}

std::size_t Grid::cells() const {
  std::size_t count = 1;
  for (const Axis& axis : axes) count *= axis.values.size();
  return count;
}

std::vector<std::size_t> Grid::at(std::size_t cell) const {
  std::vector<std::size_t> all(axes.size());
  for (std::size_t i = axes.size(); i-- > 0; cell /= axes[i].values.size()) all[i] = cell % axes[i].values.size();
  return all;
}

std::vector<std::string> Grid::values(std::size_t cell) const {
  const std::vector<std::size_t> number = at(cell);
  std::vector<std::string> all;
  for (std::size_t i = 0; i < axes.size(); ++i) all.push_back(axes[i].values[number[i]]);
  return all;
}

std::vector<std::string> Grid::overrides(std::size_t cell) const {
  const std::vector<std::string> of_axis = values(cell);
  std::vector<std::string> all;
  for (std::size_t i = 0; i < axes.size(); ++i) axes[i].append_overrides(all, of_axis[i]);
  return all;
}

std::string Grid::name(std::size_t cell) const {
  const std::vector<std::string> of_axis = values(cell);
  std::vector<std::string> all;
  for (std::size_t i = 0; i < axes.size(); ++i) all.push_back(axes[i].name() + "=" + of_axis[i]);
  return fmt::format("{}", fmt::join(all, ", "));
}

}  // namespace twoport::lab
