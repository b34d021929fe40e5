#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace twoport::lab {

/// Most cells of a grid.
inline constexpr std::size_t kMostCells = 1'000'000;

/// A path into the scene that a study varies, or several that take the same value in each cell (linked), and the values,
/// as an override would write them.
struct Axis {
  std::vector<std::string> paths;
  std::vector<std::string> values;
  bool logarithmic = false;

  /// "A", or "A,B" where paths are linked.
  [[nodiscard]] std::string name() const;
  /// Appends PATH=VALUE for each path.
  void append_overrides(std::vector<std::string>& overrides, const std::string& value) const;
};
/// PATH=SPEC or PATH,PATH=SPEC, split at the first '='. SPEC is a,b,c or start:stop:count, both ends included, evenly in
/// value or, with :log, in the logarithm; nothing is split within brackets or braces. Throws ConfigError with the option,
/// the text and what is allowed.
Axis parse_axis(const std::string& text, const std::string& option = "--vary");

/// The product of axes, cell by cell, the last axis fastest.
struct Grid {
  std::vector<Axis> axes;

  [[nodiscard]] std::size_t cells() const;
  /// Of each axis the number of its value in a cell.
  [[nodiscard]] std::vector<std::size_t> at(std::size_t cell) const;
  /// Of each axis its value in a cell.
  [[nodiscard]] std::vector<std::string> values(std::size_t cell) const;
  /// PATH=VALUE for every path.
  [[nodiscard]] std::vector<std::string> overrides(std::size_t cell) const;
  /// "a=1, b=2" for an error sentence.
  [[nodiscard]] std::string name(std::size_t cell) const;
};

/// Throws ConfigError, which begins with `option`, when a path of `axis` is one of `varied`, or one is a part of the other: both would
/// set it, and their order decide.
void refuse_overlap(const Axis& axis, const std::vector<std::string>& varied, const char* option = "--vary");

/// Warns on stderr of an assignment of --set that has no effect: its path is one of `varied`, or within one.
void warn_if_lost(const std::vector<std::string>& set, const std::vector<std::string>& varied);

/// The paths of "A,B". Throws ConfigError, whose sentence begins with `what`, when one is empty or named twice.
std::vector<std::string> parse_paths(const std::string& text, const std::string& what);

/// The parts of a text between separators, nothing split within brackets or braces.
std::vector<std::string_view> parts_of(std::string_view text, char separator);

}  // namespace twoport::lab
