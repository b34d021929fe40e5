#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "lab/study/many_runs.h"
#include "lab/study/table.h"

namespace twoport::lab {

/// A number of a scene to search along, or several linked ones: A=LO:HI or A,B=LO:HI, LO < HI.
struct Interval {
  std::vector<std::string> paths;
  double low, high;

  [[nodiscard]] std::string name() const;  ///< "A" or "A,B"
};
/// Throws ConfigError with the option, the text and what is allowed.
Interval parse_interval(const std::string& text, const std::string& option = "--vary");

struct BoundaryOptions {
  std::string scene;                  ///< its file
  std::optional<std::string> text{};  ///< as SweepOptions::text
  std::vector<std::string> set;       ///< overrides, applied before the one that varies
  Interval vary;
  double tolerance = 1e-3;                  ///< of the value, relative
  int scan = 8;                             ///< values between the ends that are tried first: the first change counts
  int jobs = 1;                             ///< threads
  int lanes = 0;                            ///< as ManyRuns::lanes
  VerdictFrom verdict = VerdictFrom::tail;  ///< as ManyRuns::verdict
  const HostedRobot* robot = nullptr;       ///< as RunOptions::robot
  const std::atomic<bool>* stop = nullptr;  ///< as RunOptions::stop
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

/// Result of a search.
struct BoundarySearch {
  std::optional<Boundary> boundary;    ///< none where both ends agree
  bool stable_at_low = false;          ///< the verdict at LO
  std::optional<double> disagreement;  ///< where both ends agree: the first value of the scan that does not
  bool open = false;                   ///< stopped before the boundary's sides were as near as the tolerance
};

/// The first value between LO and HI at which the verdict `stable` of the scene changes: ends and scan first, then
/// bisection, in the logarithm where both ends have one sign. `tried` is called for every run, in the order of values for
/// the scan. Throws ConfigError when the scene is wrong.
BoundarySearch search_boundary(const BoundaryOptions& options, const std::function<void(const Trial&)>& tried = {},
                               const Heard& heard = {});
/// The same. Throws ConfigError also when both ends agree.
Boundary find_boundary(const BoundaryOptions& options, const std::function<void(const Trial&)>& tried = {},
                       const Heard& heard = {});

/// What makes the run unstable just beyond a boundary: contact, if without its environment it is not unstable there, else the free motion.
/// Nothing with a robot in a world of its own.
struct Decided {
  bool by_contact;
  std::string verdict;  ///< without the environment
};
std::optional<Decided> what_decides(const BoundaryOptions& options, const Boundary& boundary);

/// A boundary for each value of a second axis.
struct BoundaryCurve {
  std::string scene;  ///< its name
  Axis along;
  Interval vary;
  std::vector<BoundarySearch> found;  ///< one for each of along.values; none where it was stopped within the scan
  /// As what_decides(), of each of `found`; nothing where there is no boundary. Empty where it was stopped.
  std::vector<std::optional<Decided>> decided;
  LaneUse use;
  bool stopped = false;
};

/// Searches at every value of `along`, all of them step by step together; the result is the same for any number of jobs and lanes.
/// Throws ConfigError when a scene is wrong; that a search finds no boundary is a result. `heard` hears of runs, `coarse` after each step of
/// what is known, as of a curve that was stopped.
BoundaryCurve boundary_curve(const BoundaryOptions& options, const Axis& along, const Heard& heard = {},
                             const std::function<void(const BoundaryCurve&)>& coarse = {});

/// A row for each value: the paths of `along`, the varied paths, a note, and what decides: "contact" or "free space". The note is empty where the
/// run is stable from LO up to the value, "stable from here up" where it is from the value up to HI. Without a boundary
/// the varied columns are empty and the note says "stable at both ends" or "unstable at both ends".
Table to_table(const BoundaryCurve& curve);

}  // namespace twoport::lab
