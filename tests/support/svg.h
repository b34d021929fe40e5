#pragma once

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace twoport::test {

using Points = std::vector<Eigen::Vector2d>;

/// A line, a filled polygon or a mark of an SVG, in pixels from its upper left corner.
struct DrawnShape {
  enum class Kind { line, polygon, mark };
  Kind kind;
  std::string colour;
  Points points;
};

/// As gnuplot writes #RRGGBB, or black, in an SVG.
inline std::string colour_in_svg(const std::string& colour) {
  const std::string hex = colour == "black" ? "#000000" : colour;
  const auto part = [&](std::size_t at) { return std::stoi(hex.substr(at, 2), nullptr, 16); };
  return fmt::format("rgb({:3}, {:3}, {:3})", part(1), part(3), part(5));
}

/// What gnuplot has drawn, in its order; a line that is interrupted is several. Without words.
inline std::vector<DrawnShape> shapes_of(const std::string& svg) {
  using Kind = DrawnShape::Kind;
  struct Written {
    Kind kind;
    const char *element, *colour, *places;
    char end;
  };
  constexpr Written kWritten[] = {{Kind::line, "<path stroke=", "stroke='", " d='", '\''},
                                  {Kind::polygon, "<polygon fill = ", "fill = '", "points = '", '\''},
                                  {Kind::mark, "<use ", "color='", "translate(", ')'}};
  std::vector<DrawnShape> all;
  std::size_t at = svg.find("</defs>");  // in there are the marks themselves
  for (;;) {
    const Written* next = nullptr;
    std::size_t begin = svg.npos;
    for (const Written& w : kWritten)
      if (const std::size_t found = svg.find(w.element, at); found < begin) begin = found, next = &w;
    if (next == nullptr) return all;
    const auto between = [&](const std::string& before, char end) {
      const std::size_t from = svg.find(before, begin) + before.size(), to = svg.find(end, from);
      at = std::max(at, to);
      return svg.substr(from, to - from);
    };
    const DrawnShape empty{next->kind, between(next->colour, '\''), {}};
    const std::string places = between(next->places, next->end);
    if (empty.kind != Kind::line) all.push_back(empty);
    for (const char* c = places.c_str(); *c != '\0';) {
      if (*c == 'M') all.push_back(empty);
      char* after = nullptr;
      const double x = std::strtod(c, &after);
      if (after == c) {
        ++c;
        continue;
      }
      const double y = std::strtod(after + 1, &after);  // after a comma
      all.back().points.emplace_back(x, y);
      c = after;
    }
  }
}

struct Box {
  Eigen::Vector2d low{1e9, 1e9}, high{-1e9, -1e9};
  void add(const Eigen::Vector2d& p) { low = low.cwiseMin(p), high = high.cwiseMax(p); }
  [[nodiscard]] bool contains(const Eigen::Vector2d& p, double margin) const {
    return (p.array() >= low.array() - margin).all() && (p.array() <= high.array() + margin).all();
  }
};
inline Box box_of(const Points& points) {
  Box box;
  for (const Eigen::Vector2d& p : points) box.add(p);
  return box;
}

/// Points among which one is looked for, to within a rounding.
class Near {
 public:
  explicit Near(double rounding) : rounding_{rounding} {}
  void add(const Eigen::Vector2d& p) { cells_.insert(cell(p)); }
  [[nodiscard]] bool has(const Eigen::Vector2d& p) const {
    const auto [x, y] = cell(p);
    for (const long dx : {-1, 0, 1})
      for (const long dy : {-1, 0, 1})
        if (cells_.contains({x + dx, y + dy})) return true;
    return false;
  }
  [[nodiscard]] bool empty() const { return cells_.empty(); }

 private:
  [[nodiscard]] std::pair<long, long> cell(const Eigen::Vector2d& p) const {
    return {std::lround(p.x() / rounding_), std::lround(p.y() / rounding_)};
  }
  double rounding_;
  std::set<std::pair<long, long>> cells_;
};

/// The axes of each panel in two dimensions, in their order: a picture draws their border as a closed line.
inline std::vector<Box> axes_in(const std::vector<DrawnShape>& shapes) {
  std::vector<Box> all;
  for (const DrawnShape& s : shapes)
    if (s.kind == DrawnShape::Kind::line && s.colour == colour_in_svg("#505050") && s.points.size() == 5)
      if (const Box box = box_of(s.points); all.empty() || all.back().low != box.low) all.push_back(box);
  return all;
}

}  // namespace twoport::test
