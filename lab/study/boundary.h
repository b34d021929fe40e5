#pragma once

#include <functional>
#include <string>
#include <vector>

namespace twoport::lab {

/// A number of a scene to search along, or several that move together: A=LO:HI or A,B=LO:HI, LO < HI.
struct Interval {
  std::vector<std::string> paths;
  double low, high;

  [[nodiscard]] std::string name() const;  ///< "A" or "A,B"
};
/// Throws ConfigError with the text and what is allowed.
Interval parse_interval(const std::string& text);

struct BoundaryOptions {
  std::string scene;
  std::vector<std::string> set;  ///< overrides, applied before the one that varies
  Interval vary;
  double tolerance = 1e-3;  ///< of the value, relative
  int scan = 8;             ///< values between the ends that are tried first: the first change counts
  int jobs = 1;             ///< threads for the scan
};

/// One run of the search.
struct Trial {
  double value;
  bool stable;
  std::string verdict;
};

/// Neighbours on either side of the boundary, no further apart than the tolerance.
struct Boundary {
  double stable, unstable;
};

/// The first value between LO and HI at which the verdict `stable` of the scene changes: ends and scan first, then
/// bisection, in the logarithm where both ends have one sign. `tried` hears of every run, in the order of values for
/// the scan. Throws ConfigError when the scene is wrong, or when both ends agree.
Boundary find_boundary(const BoundaryOptions& options, const std::function<void(const Trial&)>& tried = {});

}  // namespace twoport::lab
