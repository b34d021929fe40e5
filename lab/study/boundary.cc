#include "lab/study/boundary.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "common/base/check.h"
#include "common/scene/load.h"
#include "lab/run.h"
#include "lab/study/parallel.h"
#include "lab/study/sweep.h"

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

Boundary find_boundary(const BoundaryOptions& o, const std::function<void(const Trial&)>& tried) {
  const double low = o.vary.low, high = o.vary.high;
  if (!(o.tolerance > 0.0 && o.tolerance < 1.0))
    throw ConfigError{fmt::format("--tolerance is {}; it must be between 0 and 1", o.tolerance)};
  const auto scene_at = [&](double value) {
    std::vector<std::string> overrides = o.set;
    for (const std::string& path : o.vary.paths) overrides.push_back(fmt::format("{}={}", path, value));
    return load_scene(o.scene, overrides);
  };
  const auto run_at = [&](double value) {
    const Summary s = run(scene_at(value));
    return Trial{value, s.stable, s.verdict};
  };
  const auto tell = [&](const Trial& trial) {
    if (tried) tried(trial);
  };

  for (const double end : {low, high}) scene_at(end);  // complains of an end, not of what lies between

  std::vector<Trial> scan(static_cast<std::size_t>(2 + std::max(o.scan, 0)));
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const double part = static_cast<double>(i) / static_cast<double>(scan.size() - 1);
    scan[i].value = i == 0 ? low : i + 1 == scan.size() ? high : rounded(between(low, high, part), o.tolerance);
  }
  for_each_parallel(scan.size(), o.jobs, [&](std::size_t i) { scan[i] = run_at(scan[i].value); });
  for (const Trial& trial : scan) tell(trial);
  const Trial &first = scan.front(), &last = scan.back();
  const auto change = std::find_if(scan.begin(), scan.end(), [&](const Trial& t) { return t.stable != first.stable; });
  if (first.stable == last.stable)
    throw ConfigError{fmt::format("{}: both ends are {}, {} and {}{}; the ends must differ", o.vary.name(),
                                  first.stable ? "stable" : "unstable", low, high,
                                  change == scan.end() ? "" : fmt::format(", though {} is not", change->value))};

  double same = std::prev(change)->value, other = change->value;
  while (other - same > o.tolerance * std::max(std::abs(same), std::abs(other))) {
    const double middle = between(same, other, 0.5), shorter = rounded(middle, o.tolerance);
    const double value = same < shorter && shorter < other ? shorter : middle;
    if (!(same < value && value < other)) break;
    const Trial trial = run_at(value);
    tell(trial);
    (trial.stable == first.stable ? same : other) = value;
  }
  return first.stable ? Boundary{same, other} : Boundary{other, same};
}

}  // namespace twoport::lab
