#pragma once

#include <cstddef>
#include <initializer_list>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "lab/study/grid.h"

namespace twoport::lab {

/// Label of a number on an axis, in a legend or a title.
struct Label {
  std::string words, unit;  ///< unit: "N/m"; empty where there is none

  /// "wall stiffness [N/m]"
  [[nodiscard]] std::string text() const;
  friend bool operator==(const Label&, const Label&) = default;
};

/// Of a path into a scene, or of several linked ones:
///
///     environment[0].wall.stiffness_n_per_m    wall stiffness [N/m]
///     to_slave.delay_ms                        delay to the slave [ms]
///     to_slave.delay_ms, to_master.delay_ms    delay each way [ms]
Label label_of_paths(const std::vector<std::string>& paths);

/// Of a figure of the summary; KEY_sd and KEY_worst are over seeds:
///
///     position_error_rms_m    position error, rms [m]
///     drift_m_worst           drift, worst seed [m]
Label label_of_figure(std::string_view key);

// Blue-green and orange: they differ for most eyes, and in grey.
inline constexpr const char *kStableColour = "#2a788e", *kUnstableColour = "#f4a582", *kNothingColour = "#d0d0d0";
inline constexpr double kAsDataNeed = std::numeric_limits<double>::quiet_NaN();

/// One direction of a panel.
struct Scale {
  Label label;
  double low = kAsDataNeed, high = kAsDataNeed;
  bool logarithmic = false;
  std::vector<std::pair<double, std::string>> ticks{};  ///< where, and what stands there; none: gnuplot's choice
  bool words = false;                                   ///< ticks are words, which have no grid and no order
  friend bool operator==(const Scale&, const Scale&) = default;
};

enum class Look { line, dashes, joined_dots, dots, crosses, triangles, boxes, area, arrows, strokes, words };

/// What is drawn in one way. A row of numbers, whose first is NaN where a line is interrupted or a polygon ends:
///
///     line, dashes, joined_dots, dots, crosses, triangles   x y, in three dimensions x y z: lines of as many points are a mesh
///     boxes                                                 left right bottom top, and the value that makes the colour
///     area                                                  x y of a polygon's corners, none outside the axes: gnuplot 5.4 clips wrongly
///     arrows, strokes (without a head)                      x y dx dy, in three dimensions x y z dx dy dz
///     words                                                 x y
struct Series {
  Look look;
  std::string colour;  ///< empty, of boxes: by their value
  std::string name{};  ///< in the legend; empty: not there
  double size = 1.5;   ///< of a line, a mark; of words in points
  double align = 0.5;  ///< of words: 0 they begin at their place, 1 they end there
  std::vector<std::vector<double>> rows{};
  std::vector<std::string> texts{};  ///< of words

  void add(std::initializer_list<double> row) { rows.emplace_back(row); }
  void add_text(double x, double y, std::string text) { add({x, y}), texts.push_back(std::move(text)); }
  void interrupt() { add({kAsDataNeed, kAsDataNeed}); }
};

struct Panel {
  std::string title;
  Scale x, y;
  std::vector<Series> series{};
  bool equal = false;                              ///< units are as long along x as along y; needs the ends of both
  std::optional<Scale> z{};                        ///< in three dimensions
  std::pair<double, double> view_deg{60.0, 30.0};  ///< from above, around z
};

/// What the colours of boxes stand for.
struct ColourBar {
  enum class Palette { value, share, from_unstable };
  Label label;
  double low = 0.0, high = 1.0;
  bool logarithmic = false;
  Palette palette = Palette::value;
};

/// A picture: panels side by side under one title and one legend. A panel leaves the words at its axes to its neighbour to the left or
/// below where that has the same scale, with both ends.
struct Picture {
  std::string name, title;
  std::vector<Panel> panels{};
  std::optional<ColourBar> bar{};
  std::size_t across = 0;                           ///< panels in a row; 0: nearly a square
  std::pair<std::size_t, std::size_t> panel{0, 0};  ///< its size [pixels]; 0: by the number of panels
};

/// Draws FOLDER/NAME.png and .svg with gnuplot; what it was given stays beside them, as NAME.gp and NAME.dat. Returns one sentence: what
/// was drawn, or why nothing was.
std::string draw(const Picture& picture, const std::string& folder);

/// Where a picture puts the values of an axis, by their numbers, and how far the cell of each reaches: half way to its neighbours.
/// Values that are not all numbers have a spacing of one, from 0.
class Places {
 public:
  explicit Places(const Axis& axis);

  [[nodiscard]] double at(std::size_t value) const { return at_[value]; }
  /// `part`: of what the cell has.
  [[nodiscard]] std::pair<double, double> reach(std::size_t value, double part = 1.0) const;
  [[nodiscard]] bool words() const { return scale_.words; }
  [[nodiscard]] std::size_t size() const { return at_.size(); }
  /// From the first cell to the last, with ticks at the values that were run, unless their numbers would touch.
  [[nodiscard]] const Scale& scale() const { return scale_; }

 private:
  Scale scale_;
  std::vector<double> at_;
  std::vector<std::pair<double, double>> reach_;
};

}  // namespace twoport::lab
