#pragma once

#include <cstddef>
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

/// In which order the cells of a grid run, so that those that have run are at any time a coarse picture of all. Each level halves the
/// distance between the values of one axis, axis by axis: of an axis of n values level 0 has the first, later ones every 2^k-th.
class Refinement {
 public:
  struct Side {
    std::size_t count;  ///< values of the axis
    bool ordered;       ///< is a value like its neighbours? Level 0 has all values of an axis that is not
  };
  static constexpr std::size_t kNone = ~std::size_t{0};

  explicit Refinement(std::vector<Side> sides);
  /// Ordered are axes of numbers that only rise, or only fall.
  explicit Refinement(const Grid& grid);

  [[nodiscard]] std::size_t level(std::size_t cell) const;
  /// For each cell the one that stands for it: itself where it is known, else the known one of the finest level whose block it is in; kNone
  /// where none of its blocks is known.
  [[nodiscard]] std::vector<std::size_t> stand_ins(const std::vector<bool>& known) const;
  /// The cells at an edge of that picture: their answer (negative: not known) differs from that of a neighbour.
  [[nodiscard]] std::vector<bool> edges(const std::vector<signed char>& answers) const;

 private:
  /// Of axis `i` the distance of values at a level.
  [[nodiscard]] std::size_t stride(std::size_t i, std::size_t level) const;

  std::vector<Side> sides_;
  std::vector<std::size_t> halvings_;  ///< of each axis, until it has all its values
  std::size_t cells_ = 1;
};
/// Do numbers only rise, or only fall?
bool is_ordered(const std::vector<double>& values);

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
