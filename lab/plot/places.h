#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "lab/plot/picture.h"
#include "lab/study/grid.h"

namespace twoport::lab {

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
