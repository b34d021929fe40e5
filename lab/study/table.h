#pragma once

#include <concepts>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "common/record/summary.h"
#include "lab/study/grid.h"
#include "lab/study/many_runs.h"

namespace twoport::lab {

/// Is the smallest value of a figure over several seeds the worst one? For these it is; of any other figure (errors,
/// deficits, chatter, forces, losses, delays) the largest is:
///
///     stable, min_*, *_min_energy_j, *_share but muted_share, held_force_ratio, contact_s, steps, duration_s,
///     environment_force_mean_n, packets.*.sent, packets.*.received
bool smallest_is_worst(std::string_view figure);

/// One figure over several seeds.
struct Spread {
  double mean;
  double sd;     ///< sample standard deviation, √(Σ (x - mean)² / (n - 1)); 0 for one seed
  double worst;  ///< see smallest_is_worst; NaN where one value is
};
/// All equal values give a mean equal to them and an sd of 0, to the bit.
Spread spread(std::string_view figure, std::span<const double> values);
Spread spread(const Figure& figure, std::span<const Summary> of_seeds);

double median(std::vector<double> of);

/// Index of the worst seed, whose verdict is reported: an unstable seed before a stable one, then the smallest port
/// energy, then the first.
std::size_t worst_seed(const std::vector<Summary>& of_seeds);

/// What stands in one place of a table: a number, a text, or nothing.
class Value {
 public:
  Value() = default;
  template <class Number>
  requires std::integral<Number> || std::floating_point<Number> Value(Number number)
      : is_{static_cast<double>(number)} {}            // NOLINT(google-explicit-constructor): a row is a list of these
  Value(std::string text, bool always_quoted = false)  // NOLINT(google-explicit-constructor)
      : is_{std::move(text)}, quoted_{always_quoted} {}
  Value(const char* text) : Value{std::string{text}} {}  // NOLINT(google-explicit-constructor)
  /// Nothing where the number is not finite.
  static Value finite(double number);

  [[nodiscard]] double number() const;     ///< NaN where there is none
  [[nodiscard]] std::string text() const;  ///< of a number the least digits that read back
  /// Is its text always in quotes?
  [[nodiscard]] bool quoted() const { return quoted_; }
  friend bool operator==(const Value& a, const Value& b) { return a.text() == b.text(); }

 private:
  std::variant<std::monostate, double, std::string> is_;
  bool quoted_ = false;
};
using Values = std::vector<Value>;

/// Result of a study. That of a sweep has one row for each cell, in the order of cells: the varied paths first, then every
/// figure of the summary, then its texts. With seeds each figure KEY has three columns: KEY, the mean; KEY_sd; KEY_worst
/// (see lab/study/table.h). The texts are then those of the worst seed, which a last column worst_seed gives.
struct Table {
  Grid grid{};            ///< of a sweep
  std::size_t seeds = 0;  ///< of a sweep
  std::vector<std::string> columns{};
  std::vector<Values> rows{};
  LaneUse use{};
  bool stopped = false;              ///< was the sweep stopped? Then only some cells have a row:
  std::vector<std::size_t> cells{};  ///< the cell of each row

  /// The last column of this name: a varied path may have the name of a figure.
  [[nodiscard]] std::optional<std::size_t> find(std::string_view column) const;
};

/// CSV; a text that holds a comma, a quote or a line's end is quoted.
std::string to_csv(const Table& table);
/// One line of it, its end included.
std::string csv_line(const Values& row);

}  // namespace twoport::lab
