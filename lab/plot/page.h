#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "lab/plot/label.h"
#include "lab/plot/scale.h"

namespace twoport::lab {

struct LegendEntry {
  enum class Mark { box, dot, cross, line, dashes };
  Mark mark;
  std::string colour, text;
};

/// A page with one panel, or with several side by side: one title, below it one legend, and one colour bar at the right.
class Page {
 public:
  Page(std::string title, std::vector<LegendEntry> legend);

  /// Several panels in a grid; each is smaller then.
  Page& panels(std::size_t count);
  /// Of one panel [pixels].
  Page& panel_size(std::size_t width, std::size_t height);
  /// Makes room for the words at the ticks of an x axis. True when they have to be slanted.
  bool slants(const Scale& x);
  Page& colour_bar(const Label& label, double low, double high, bool logarithmic);

  /// Commands before the plot command of panel i: its title, and axis labels where the page has none.
  [[nodiscard]] std::string panel(std::size_t i, const std::string& title, const Label& x, const Label& y) const;
  [[nodiscard]] bool at_left(std::size_t i) const { return i % across_ == 0; }
  /// gnuplot's input for NAME.png and NAME.svg, where `body` is panel() and a plot command for each panel.
  [[nodiscard]] std::string pages(const std::string& name, const std::string& body) const;

 private:
  [[nodiscard]] std::size_t width() const;
  [[nodiscard]] std::size_t height() const;
  [[nodiscard]] std::size_t top() const;
  [[nodiscard]] double x(double pixels) const;  ///< from the left, as a part of the page
  [[nodiscard]] double y(double pixels) const;  ///< from the bottom
  [[nodiscard]] std::string draw_legend() const;

  std::string title_, colour_bar_;
  std::vector<LegendEntry> legend_;
  std::size_t count_ = 1, across_ = 1, down_ = 1, panel_width_ = 640, panel_height_ = 430;
  std::size_t right_ = 30, bottom_ = 70;
};

}  // namespace twoport::lab
