#pragma once

#include <concepts>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "lab/study/grid.h"
#include "lab/study/many_runs.h"

namespace twoport::lab {

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
/// (see lab/study/seeds.h). The texts are then those of the worst seed, which a last column worst_seed gives.
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
