#include "lab/study/boundary.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <mutex>

#include "common/base/check.h"
#include "common/scene/load.h"
#include "lab/run.h"
#include "lab/study/parallel.h"

namespace twoport::lab {
namespace {

/// The value halfway, in the logarithm where that exists.
double between(double low, double high, double part) {
  if (low * high > 0.0) return low * std::pow(high / low, part);
  return low + part * (high - low);
}

/// Short to write, and off by no more than a tenth of the tolerance.
double rounded(double value, double tolerance) {
  const int digits = std::clamp(2 + static_cast<int>(std::ceil(-std::log10(tolerance))), 1, 17);
  return std::stod(fmt::format("{:.{}g}", value, digits));
}

double number(const std::string& whole, std::string_view text) {
  double value = 0.0;
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || stop != text.data() + text.size() || !std::isfinite(value))
    throw ConfigError{fmt::format("--vary {}: \"{}\" is not a number; it must read PATH=LO:HI", whole, text)};
  return value;
}

Scene scene_at(const BoundaryOptions& o, double value) {
  std::vector<std::string> overrides = o.set;
  for (const std::string& path : o.vary.paths) overrides.push_back(fmt::format("{}={}", path, value));
  return o.text ? parse_scene(*o.text, o.scene, overrides) : load_scene(o.scene, overrides);
}

}  // namespace

Interval parse_interval(const std::string& text) {
  const std::size_t equals = text.find('='), colon = text.find(':', equals == text.npos ? 0 : equals);
  if (equals == text.npos || equals == 0 || colon == text.npos)
    throw ConfigError{fmt::format("--vary {}: it must read PATH=LO:HI", text)};
  const std::string_view all{text};
  const Interval interval{.paths = parse_paths(text.substr(0, equals), "--vary " + text),
                          .low = number(text, all.substr(equals + 1, colon - equals - 1)),
                          .high = number(text, all.substr(colon + 1))};
  if (!(interval.low < interval.high))
    throw ConfigError{fmt::format("--vary {}: LO is {}, HI is {}; LO must be < HI", text, interval.low, interval.high)};
  return interval;
}

std::string Interval::name() const {
  return fmt::format("{}", fmt::join(paths, ","));
}

BoundarySearch search_boundary(const BoundaryOptions& o, const std::function<void(const Trial&)>& tried) {
  const double low = o.vary.low, high = o.vary.high;
  if (!(o.tolerance > 0.0 && o.tolerance < 1.0))
    throw ConfigError{fmt::format("--tolerance is {}; it must be between 0 and 1", o.tolerance)};
  const auto run_at = [&](double value) {
    const Summary s = run(scene_at(o, value), {.stop = o.stop});
    return Trial{value, s.stable(), s.verdict()};
  };
  const auto tell = [&](const Trial& trial) {
    if (tried) tried(trial);
  };

  for (const double end : {low, high}) scene_at(o, end);  // complains of an end, not of what lies between

  std::vector<Trial> scan(static_cast<std::size_t>(2 + std::max(o.scan, 0)));
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const double part = static_cast<double>(i) / static_cast<double>(scan.size() - 1);
    scan[i].value = i == 0 ? low : i + 1 == scan.size() ? high : rounded(between(low, high, part), o.tolerance);
  }
  for_each_parallel(scan.size(), o.jobs, [&](std::size_t i) { scan[i] = run_at(scan[i].value); });
  for (const Trial& trial : scan) tell(trial);
  const Trial &first = scan.front(), &last = scan.back();
  const auto change = std::find_if(scan.begin(), scan.end(), [&](const Trial& t) { return t.stable != first.stable; });
  BoundarySearch result{.boundary = {}, .stable_at_low = first.stable, .disagreement = {}};
  if (first.stable == last.stable) {
    if (change != scan.end()) result.disagreement = change->value;
    return result;
  }

  double same = std::prev(change)->value, other = change->value;
  while (other - same > o.tolerance * std::max(std::abs(same), std::abs(other))) {
    const double middle = between(same, other, 0.5), shorter = rounded(middle, o.tolerance);
    const double value = same < shorter && shorter < other ? shorter : middle;
    if (!(same < value && value < other)) break;
    const Trial trial = run_at(value);
    tell(trial);
    (trial.stable == first.stable ? same : other) = value;
  }
  result.boundary = first.stable ? Boundary{same, other} : Boundary{other, same};
  return result;
}

Boundary find_boundary(const BoundaryOptions& o, const std::function<void(const Trial&)>& tried) {
  const BoundarySearch found = search_boundary(o, tried);
  if (!found.boundary)
    throw ConfigError{fmt::format("{}: both ends are {}, {} and {}{}; the ends must differ", o.vary.name(),
                                  found.stable_at_low ? "stable" : "unstable", o.vary.low, o.vary.high,
                                  found.disagreement ? fmt::format(", though {} is not", *found.disagreement) : "")};
  return *found.boundary;
}

BoundaryCurve boundary_curve(const BoundaryOptions& o, const Axis& along,
                             const std::function<void(std::size_t)>& finished) {
  for (const std::string& path : along.paths)
    if (std::find(o.vary.paths.begin(), o.vary.paths.end(), path) != o.vary.paths.end())
      throw ConfigError{fmt::format("--along {}: {} is varied by --vary", along.name(), path)};
  const auto options_at = [&](const std::string& value) {
    BoundaryOptions at = o;
    along.append_overrides(at.set, value);
    at.jobs = 1;
    return at;
  };
  BoundaryCurve curve{.scene = {}, .along = along, .vary = o.vary, .found = {}};
  // A scene that is wrong is found before anything runs.
  for (const std::string& value : along.values)
    for (const double end : {o.vary.low, o.vary.high}) curve.scene = scene_at(options_at(value), end).name;

  curve.found.resize(along.values.size());
  std::mutex guard;
  std::size_t done = 0;
  for_each_parallel(along.values.size(), o.jobs, [&](std::size_t i) {
    curve.found[i] = search_boundary(options_at(along.values[i]));
    const std::lock_guard lock{guard};
    if (finished) finished(++done);
  });
  return curve;
}

std::string to_csv(const BoundaryCurve& curve) {
  Table table{.axes = {}, .columns = curve.along.paths, .rows = {}};
  table.columns.insert(table.columns.end(), curve.vary.paths.begin(), curve.vary.paths.end());
  table.columns.emplace_back("note");
  for (std::size_t i = 0; i < curve.found.size(); ++i) {
    const BoundarySearch& at = curve.found[i];
    std::vector<std::string>& row = table.rows.emplace_back(curve.along.paths.size(), curve.along.values[i]);
    row.insert(row.end(), curve.vary.paths.size(), at.boundary ? fmt::format("{}", at.boundary->stable) : "");
    if (at.boundary) {
      row.emplace_back(at.stable_at_low ? "" : "stable from here up");
      continue;
    }
    const char* const verdict = at.stable_at_low ? "stable" : "unstable";
    row.push_back(fmt::format("{} at both ends", verdict));
    if (at.disagreement) row.back() += fmt::format(" but not at {}", *at.disagreement);
  }
  return to_csv(table);
}

}  // namespace twoport::lab
