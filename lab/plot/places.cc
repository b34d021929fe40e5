#include "lab/plot/places.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/base/text.h"

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

Places::Places(const Axis& axis) : scale_{.label = label_of_paths(axis.paths)} {
  scale_.words =
      !std::all_of(axis.values.begin(), axis.values.end(), [](const std::string& v) { return number_from<double>(v); });
  for (std::size_t i = 0; i < axis.values.size(); ++i)
    at_.push_back(scale_.words ? static_cast<double>(i) : *number_from<double>(axis.values[i]));
  std::vector<double> places = at_;
  std::sort(places.begin(), places.end());
  places.erase(std::unique(places.begin(), places.end()), places.end());
  scale_.logarithmic = axis.logarithmic && !scale_.words && places.front() > 0.0;
  const auto along = [&](double v) { return scale_.logarithmic ? std::log(v) : v; };
  const auto back = [&](double v) { return scale_.logarithmic ? std::exp(v) : v; };
  const auto half = [&](double a, double b) { return 0.5 * (along(a) + along(b)); };
  double nearest = std::numeric_limits<double>::infinity();
  for (const double place : at_) {
    const auto found = std::lower_bound(places.begin(), places.end(), place);
    const double middle = along(place);
    double low = found != places.begin() ? half(*std::prev(found), place) : kAsDataNeed;
    double high = std::next(found) != places.end() ? half(place, *std::next(found)) : kAsDataNeed;
    if (std::isnan(low) && std::isnan(high))
      low = middle - (scale_.words || middle == 0.0 ? 0.5 : 0.05 * std::abs(middle));
    if (std::isnan(low)) low = 2.0 * middle - high;
    if (std::isnan(high)) high = 2.0 * middle - low;
    reach_.emplace_back(back(low), back(high));
    nearest = std::min({nearest, 2.0 * (middle - low), 2.0 * (high - middle)});
    scale_.low = std::isnan(scale_.low) ? back(low) : std::min(scale_.low, back(low));
    scale_.high = std::isnan(scale_.high) ? back(high) : std::max(scale_.high, back(high));
  }
  if (scale_.words || nearest > 0.065 * (along(scale_.high) - along(scale_.low)))
    for (std::size_t i = 0; i < at_.size(); ++i)
      scale_.ticks.emplace_back(at_[i], scale_.words ? axis.values[i] : short_number(at_[i]));
}

std::pair<double, double> Places::reach(std::size_t value, double part) const {
  const auto [low, high] = reach_[value];
  const auto shrunk = [&, place = at_[value]](double edge) {
    return scale_.logarithmic ? place * std::pow(edge / place, part) : place + part * (edge - place);
  };
  return {shrunk(low), shrunk(high)};
}

}  // namespace twoport::lab
