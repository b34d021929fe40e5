#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "lab/study/many_runs.h"

namespace twoport::lab {

/// A gain of a method: path in the scene, and the range that is searched, uniformly in the logarithm.
struct Gain {
  const char* path;
  double low, high;
};
/// Empty where a method has none of its own.
std::vector<Gain> gains_of(const std::string& method);

struct TuneOptions {
  std::vector<std::string> scenes;   ///< files of the training set
  std::vector<std::string> set;      ///< overrides of each
  std::vector<std::string> methods;  ///< empty: every method with gains
  std::vector<double> round_trips_ms{40, 200, 800};
  std::vector<double> losses{0.1};
  std::vector<double> stiffnesses_n_per_m{800, 6000};
  int evaluations = 32;  ///< of each method and round trip, that of the method's rule included
  std::uint64_t seed = 1;
  int jobs = 1;
};

/// What was found for one method and round trip. A score is the mean over scenes, losses and stiffnesses of
/// min(2, error_n/reference force) as the map has them, 2 where the run is not stable and quiet: 1 is as bad as no force at
/// all, 0 is transparent.
struct Tuned {
  std::string method;
  double round_trip_ms = 0.0;
  double rule = 0.0, best = 0.0;       ///< score of the method's own gains; of the best found
  std::vector<std::string> overrides;  ///< of the best; empty: the rule's
};

/// Searches the gains of each method at each round trip: half of the evaluations anywhere in the ranges, half within a
/// factor of two of the best so far. Throws ConfigError when an option or a scene is invalid.
std::vector<Tuned> tune(const TuneOptions& options, const Heard& heard = {});

std::string to_text(const std::vector<Tuned>& all);

}  // namespace twoport::lab
