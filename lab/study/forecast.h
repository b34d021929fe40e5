#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>

namespace twoport::lab {

/// How long the runs of a study take yet. They are of kinds that cost differently, and no cost is known before: a first part of each kind
/// shows it. With n runs of a kind to come, each of which takes the mean c of those that have run, the time left is Σ n c, and for
/// runs whose kind is not known yet the mean over all kinds. Times are of the caller's clock [s].
class Forecast {
 public:
  /// `runs`: of the study; more than are expected of kinds where those of later ones are not known yet.
  explicit Forecast(std::size_t runs) : runs_{runs} {}

  /// So many runs of a kind will follow, of which the first `sample` show its cost.
  /// True where none of this kind were expected before.
  bool expect(const std::string& kind, std::size_t runs, std::size_t sample) {
    Kind& k = kinds_[kind];
    const bool first = k.expected == 0;
    if (first) k.sample = sample;
    k.expected += runs;
    return first;
  }
  /// The scenes of so many runs were read, which took that long.
  void read(std::size_t runs, double spent_s) {
    read_ += runs;
    reading_s_ += spent_s;
  }
  /// From now on, runs are of this kind.
  void begin(const std::string& kind, double now_s) {
    present_ = &kinds_[kind];
    since_s_ = now_s;
  }
  void ran(double now_s) {
    ++present_->ran;
    present_->spent_s += now_s - since_s_;
    since_s_ = now_s;
  }
  /// Runs of a kind that are not needed after all.
  void drop(const std::string& kind, std::size_t runs) {
    kinds_[kind].expected -= runs;
    runs_ -= runs;
  }
  /// Nothing while the cost of a kind is not known.
  [[nodiscard]] std::optional<double> left_s() const {
    double left_s = 0.0, whole_s = 0.0, known = 0.0;
    for (const auto& [name, k] : kinds_) {
      if (k.expected == 0) continue;
      if (k.ran == 0 || k.ran < k.sample) return {};
      const double cost_s = k.spent_s / static_cast<double>(k.ran);
      left_s += cost_s * static_cast<double>(k.expected - k.ran);
      whole_s += cost_s * static_cast<double>(k.expected);
      known += static_cast<double>(k.expected);
    }
    if (known == 0.0) return {};
    if (read_ > 0) left_s += static_cast<double>(runs_ - read_) * reading_s_ / static_cast<double>(read_);
    return left_s + (static_cast<double>(runs_) - known) * whole_s / known;
  }

 private:
  struct Kind {
    std::size_t expected = 0, sample = 0, ran = 0;
    double spent_s = 0.0;
  };
  std::size_t runs_, read_ = 0;
  std::map<std::string, Kind> kinds_;
  Kind* present_ = nullptr;
  double since_s_ = 0.0, reading_s_ = 0.0;
};

}  // namespace twoport::lab
