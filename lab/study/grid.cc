#include "lab/study/grid.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>

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
    for (const std::string_view linked : parts_of(std::string_view{assignment}.substr(0, assignment.find('=')), ','))
      for (const std::string& path : varied)
        if (const std::string_view name = trimmed(linked); name == path || is_part(name, path))
          print_error("warning: --set {} has no effect{}: {} is varied\n", assignment,
                      linked.size() < assignment.find('=') ? fmt::format(" on {}", name) : "", path);
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

bool is_ordered(const std::vector<double>& values) {
  const auto none = [&](auto turns) { return std::adjacent_find(values.begin(), values.end(), turns) == values.end(); };
  return none(std::greater_equal{}) || none(std::less_equal{});
}

Refinement::Refinement(std::vector<Side> sides) : sides_{std::move(sides)} {
  for (std::size_t i = 0; i < sides_.size(); ++i) {
    halvings_.push_back(sides_[i].ordered ? static_cast<std::size_t>(std::bit_width(sides_[i].count - 1)) : 0);
    cells_ *= sides_[i].count;
  }
}

Refinement::Refinement(const Grid& grid)
    : Refinement{[&] {
        std::vector<Side> sides;
        for (const Axis& axis : grid.axes) {
          std::vector<double> numbers;
          for (const std::string& value : axis.values)
            if (const auto number = number_from<double>(value)) numbers.push_back(*number);
          sides.push_back({axis.values.size(), numbers.size() == axis.values.size() && is_ordered(numbers)});
        }
        return sides;
      }()} {}

std::size_t Refinement::level(std::size_t cell) const {
  std::size_t level = 0;
  for (std::size_t i = sides_.size(); i-- > 0; cell /= sides_[i].count) {
    const std::size_t at = cell % sides_[i].count;
    if (at == 0 || halvings_[i] == 0) continue;
    const std::size_t halving = halvings_[i] - static_cast<std::size_t>(std::countr_zero(at));
    level = std::max(level, (halving - 1) * sides_.size() + i + 1);
  }
  return level;
}

std::size_t Refinement::stride(std::size_t i, std::size_t level) const {
  const std::size_t done = level > i ? (level - i - 1) / sides_.size() + 1 : 0;
  return std::size_t{1} << (halvings_[i] - std::min(done, halvings_[i]));
}

std::vector<std::size_t> Refinement::stand_ins(const std::vector<bool>& known) const {
  std::vector<std::size_t> all(cells_, kNone);
  std::size_t finest = 0;
  for (std::size_t cell = 0; cell < cells_; ++cell)
    if (known[cell]) finest = std::max(finest, level(cell));
  for (std::size_t cell = 0; cell < cells_; ++cell)
    for (std::size_t level = finest + 1; all[cell] == kNone && level-- > 0;) {
      std::size_t block = 0, step = 1, rest = cell;
      for (std::size_t i = sides_.size(); i-- > 0; step *= sides_[i].count, rest /= sides_[i].count) {
        const std::size_t apart = stride(i, level), at = rest % sides_[i].count;
        const std::size_t nearest = (at + (apart - 1) / 2) / apart * apart;
        block += step * (nearest < sides_[i].count ? nearest : nearest - apart);
      }
      if (known[block]) all[cell] = block;
    }
  return all;
}

std::vector<bool> Refinement::edges(const std::vector<signed char>& answers) const {
  std::vector<bool> known(cells_), edge(cells_);
  for (std::size_t cell = 0; cell < cells_; ++cell) known[cell] = answers[cell] >= 0;
  const std::vector<std::size_t> shown = stand_ins(known);
  std::size_t step = 1;
  for (std::size_t i = sides_.size(); i-- > 0; step *= sides_[i].count)
    for (std::size_t cell = 0; sides_[i].ordered && cell + step < cells_; ++cell)
      if (const std::size_t a = shown[cell], b = shown[cell + step];
          cell / step % sides_[i].count + 1 < sides_[i].count && a != kNone && b != kNone && answers[a] != answers[b])
        edge[cell] = edge[cell + step] = true;
  return edge;
}

}  // namespace twoport::lab
