#include "lab/study/link_parts.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

namespace twoport::lab {
namespace {

double seconds_of(const TracedWay& way) {
  if (way.size() < 2) return 0.0;
  const double packets = static_cast<double>(way.size());
  return (way.back().sent_s - way.front().sent_s) * packets / (packets - 1.0);
}

/// Sums over a part of both directions.
struct Sums {
  double packets = 0.0, lost = 0.0, delay_s = 0.0, square_s2 = 0.0;

  void add(double delay) {
    ++packets;
    if (std::isnan(delay)) {
      ++lost;
    } else {
      delay_s += delay, square_s2 += delay * delay;
    }
  }
  friend Sums operator-(Sums a, const Sums& b) {
    return {a.packets - b.packets, a.lost - b.lost, a.delay_s - b.delay_s, a.square_s2 - b.square_s2};
  }
  [[nodiscard]] double arrived() const { return std::max(1.0, packets - lost); }
  [[nodiscard]] double mean_s() const { return delay_s / arrived(); }
  [[nodiscard]] double deviation_s() const {
    return std::sqrt(std::max(0.0, square_s2 / arrived() - mean_s() * mean_s()));
  }
};

/// Both directions at one rate, in a circle.
class Circle {
 public:
  Circle(const LinkTrace& link, double length_s) {
    double least_s = 1.0;
    for (const TracedWay* way : {&link.to_slave, &link.to_master})
      least_s = std::min(least_s, seconds_of(*way) / static_cast<double>(way->size()));
    period_s_ = std::max(least_s, kLeast_s);
    there_ = delays_at(link.to_slave, 1.0 / period_s_);
    back_ = delays_at(link.to_master, 1.0 / period_s_);
    size_ = std::min(there_.size(), back_.size());
    part_ = std::min(size_, static_cast<std::size_t>(std::max(1.0, std::round(length_s / period_s_))));
    // Less the mean, so that the squares are small.
    for (std::size_t k = 0; k < size_; ++k) whole_.add(there_[k]), whole_.add(back_[k]);
    sums_.emplace_back();
    for (std::size_t k = 0; k < size_ + part_; ++k) {
      sums_.push_back(sums_.back());
      sums_.back().add(there_[k % size_] - whole_.mean_s());
      sums_.back().add(back_[k % size_] - whole_.mean_s());
    }
  }

  [[nodiscard]] Sums at(std::size_t from) const { return sums_[from + part_] - sums_[from]; }
  [[nodiscard]] double mean_s() const { return whole_.mean_s(); }
  [[nodiscard]] double mean_s(std::size_t from) const { return at(from).mean_s() + whole_.mean_s(); }
  [[nodiscard]] double since_start_s(std::size_t from) const { return static_cast<double>(from) * period_s_; }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::size_t part() const { return part_; }

  /// Where the part with the largest value begins; of neighbours with the same, the one in the middle.
  template <class Value>
  [[nodiscard]] std::size_t largest(Value value) const {
    std::vector<double> all(size_);
    for (std::size_t i = 0; i < size_; ++i) all[i] = value(at(i));
    const double most = *std::max_element(all.begin(), all.end());
    const auto is_largest = [&](std::size_t i) {
      return all[i % size_] >= most - 1e-9 * std::max(1e-3, std::abs(most));
    };
    std::size_t first = 0;
    while (first < size_ && is_largest(first)) ++first;
    if (first == size_) return 0;
    while (!is_largest(first)) ++first;
    std::size_t last = first;
    while (is_largest(last + 1)) ++last;
    return (first + (last - first) / 2) % size_;
  }

  /// The longest time between two arrivals of a direction, less the time between rows, and where the part around it begins.
  [[nodiscard]] std::pair<double, std::size_t> longest_gap() const {
    std::pair<double, std::size_t> longest{0.0, 0};
    const double whole_s = static_cast<double>(size_) * period_s_;
    for (const std::vector<double>* way : {&there_, &back_}) {
      std::vector<double> arrivals_s;
      for (std::size_t k = 0; k < size_; ++k)
        if (!std::isnan((*way)[k])) arrivals_s.push_back(since_start_s(k) + (*way)[k]);
      std::sort(arrivals_s.begin(), arrivals_s.end());
      if (!arrivals_s.empty()) arrivals_s.push_back(arrivals_s.front() + whole_s);
      for (std::size_t i = 1; i < arrivals_s.size(); ++i) {
        const double gap_s = arrivals_s[i] - arrivals_s[i - 1] - 2.0 * period_s_;
        if (gap_s <= longest.first + 1e-9) continue;
        const double middle_s =
            0.5 * (arrivals_s[i] + arrivals_s[i - 1]) - 0.5 * static_cast<double>(part_) * period_s_;
        const auto from = static_cast<std::int64_t>(std::floor(middle_s / period_s_ + 1e-6));
        const auto around = static_cast<std::int64_t>(size_);
        longest = {gap_s, static_cast<std::size_t>((from % around + around) % around)};
      }
    }
    return longest;
  }

 private:
  static constexpr double kLeast_s = 2e-4;
  double period_s_ = 1.0;
  std::vector<double> there_, back_;
  std::size_t size_ = 0, part_ = 0;
  Sums whole_;
  std::vector<Sums> sums_;  ///< of all before
};

}  // namespace

double duration_s(const LinkTrace& link) {
  return std::max(seconds_of(link.to_slave), seconds_of(link.to_master));
}

std::vector<LinkPart> worst_parts(const LinkTrace& link, double length_s) {
  constexpr double kNoGap_s = 0.01, kNoChange_s = 1e-3;
  if (!(seconds_of(link.to_slave) > length_s && seconds_of(link.to_master) > length_s)) return {{}};
  const Circle circle{link, length_s};
  std::vector<std::pair<std::size_t, std::string>> found;
  const auto add = [&](std::size_t from, std::string why) {
    for (auto& [other, words] : found) {
      const std::size_t apart = from > other ? from - other : other - from;
      if (4 * std::min(apart, circle.size() - apart) > circle.part()) continue;
      words += ", " + why;
      return;
    }
    found.emplace_back(from, std::move(why));
  };
  const std::size_t delayed = circle.largest([](const Sums& s) { return s.mean_s(); });
  if (circle.mean_s(delayed) > circle.mean_s() + kNoChange_s)
    add(delayed, fmt::format("the longest delays, {:.3g} ms in the mean", 1e3 * circle.mean_s(delayed)));
  if (const std::size_t lossy = circle.largest([](const Sums& s) { return s.lost; }); circle.at(lossy).lost > 0.0)
    add(lossy, fmt::format("most lost, {:.2g} %", 100.0 * circle.at(lossy).lost / circle.at(lossy).packets));
  if (const auto [gap_s, from] = circle.longest_gap(); gap_s > kNoGap_s)
    add(from, fmt::format("the longest gap, {:.3g} ms", 1e3 * gap_s));
  const std::size_t changing = circle.largest([](const Sums& s) { return s.deviation_s(); });
  if (const double change_s = circle.at(changing).deviation_s(); change_s > kNoChange_s)
    add(changing, fmt::format("the largest change of delay, {:.3g} ms rms", 1e3 * change_s));
  if (found.empty()) found.emplace_back(0, "all parts are alike");
  std::vector<LinkPart> parts;
  for (auto& [from, why] : found) parts.push_back({circle.since_start_s(from), std::move(why)});
  return parts;
}

std::vector<double> delays_from(const TracedWay& way, double from_s, double rate_hz) {
  std::vector<double> all = delays_at(way, rate_hz);
  const auto from = static_cast<std::size_t>(std::llround(from_s * rate_hz)) % all.size();
  std::rotate(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(from), all.end());
  return all;
}

}  // namespace twoport::lab
