#include "lab/plot/scale.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

#include "lab/plot/gnuplot.h"

namespace twoport::lab {
namespace {

/// Three digits, in full where that is not too long: 7920, 0.0333, 2e+07.
std::string short_number(double value) {
  const double size = std::abs(value);
  if (!(size >= 1000.0 && size < 1e7)) return fmt::format("{:.3g}", value);
  const double unit = std::pow(10.0, std::floor(std::log10(size)) - 2.0);
  return fmt::format("{:.0f}", std::round(value / unit) * unit);
}

}  // namespace

std::optional<double> number_of(const std::string& text) {
  double value = 0.0;
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || stop != text.data() + text.size()) return std::nullopt;
  return value;
}

std::string log_ticks(char name, double low, double high) {
  if (!(low > 0.0) || high > 1e3 * low) return "";
  std::vector<std::string> ticks;
  for (double decade = std::pow(10.0, std::floor(std::log10(low))); decade <= high; decade *= 10.0)
    for (const double digit : {1.0, 2.0, 5.0}) ticks.push_back(fmt::format("{:.12g}", digit * decade));
  return fmt::format("set {}tics ({})\n", name, fmt::join(ticks, ", "));
}

Scale::Scale(const Axis& axis) : label_{label_of_paths(axis.paths)} {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  words_ = !std::all_of(axis.values.begin(), axis.values.end(), [](const std::string& v) { return number_of(v); });
  for (std::size_t i = 0; i < axis.values.size(); ++i)
    at_.emplace(axis.values[i], words_ ? static_cast<double>(i) : *number_of(axis.values[i]));
  std::vector<double> places;
  for (const auto& [text, place] : at_) places.push_back(place);
  std::sort(places.begin(), places.end());
  logarithmic_ = axis.logarithmic && !words_ && places.front() > 0.0;
  const auto half = [&](double a, double b) { return logarithmic_ ? std::sqrt(a * b) : 0.5 * (a + b); };
  const auto mirror = [&](double edge, double of) { return logarithmic_ ? of * of / edge : 2.0 * of - edge; };
  for (std::size_t i = 0; i < places.size(); ++i) {
    const double p = places[i];
    double lo = i > 0 ? half(places[i - 1], p) : kNone, hi = i + 1 < places.size() ? half(p, places[i + 1]) : kNone;
    if (std::isnan(lo) && std::isnan(hi)) {
      lo = words_ ? p - 0.5 : p - 0.05 * std::abs(p) - (p == 0.0 ? 0.5 : 0.0);
      hi = 2.0 * p - lo;
    }
    if (std::isnan(lo)) lo = mirror(hi, p);
    if (std::isnan(hi)) hi = mirror(lo, p);
    reach_[p] = {lo, hi};
  }
}

std::pair<double, double> Scale::reach(double place, double part) const {
  const auto [lo, hi] = reach_.at(place);
  const auto shrunk = [&](double edge) {
    return logarithmic_ ? place * std::pow(edge / place, part) : place + part * (edge - place);
  };
  return {shrunk(lo), shrunk(hi)};
}

std::size_t Scale::longest_word() const {
  std::size_t longest = 0;
  for (const auto& [text, place] : at_) longest = std::max(longest, words_ ? text.size() : 0);
  return longest;
}

std::string Scale::commands(char name, bool with_tick_labels, bool slanted) const {
  const double low = reach_.begin()->second.first, high = reach_.rbegin()->second.second;
  std::string out = fmt::format("set {}range [{}:{}]\n", name, low, high);
  if (logarithmic_) out += fmt::format("set logscale {}\n", name);
  const auto along = [&](double place) { return logarithmic_ ? std::log(place) : place; };
  std::map<double, std::string> by_place;
  for (const auto& [text, place] : at_) by_place.emplace(place, text);
  std::vector<std::string> ticks;
  double last = -std::numeric_limits<double>::infinity(), nearest = std::numeric_limits<double>::infinity();
  for (const auto& [place, text] : by_place) {
    const std::string label = words_ ? text : short_number(place);
    ticks.push_back(fmt::format("{} {}", with_tick_labels ? gnuplot_quoted(label) : "''", place));
    nearest = std::min(nearest, (along(place) - last) / (along(high) - along(low)));
    last = along(place);
  }
  // Ticks at the values that were run, unless their numbers would touch.
  if (words_ || nearest > (name == 'x' ? 0.07 : 0.05)) {
    const char* const turned = slanted ? " rotate by 35 right" : words_ && name == 'y' ? " rotate by 90 center" : "";
    return out + fmt::format("set {}tics ({}){}\n", name, fmt::join(ticks, ", "), turned);
  }
  if (logarithmic_) out += log_ticks(name, low, high);
  return out + fmt::format("set format {} '{}'\n", name, with_tick_labels ? "%h" : "");
}

}  // namespace twoport::lab
