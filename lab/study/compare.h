#pragma once

#include <string>
#include <vector>

#include "common/record/figure.h"
#include "common/record/summary.h"
#include "lab/study/many_runs.h"
#include "lab/study/table.h"

namespace twoport::lab {

struct CompareOptions {
  std::string scene;
  std::vector<std::string> set;
  std::vector<std::string> methods;  ///< empty: every method
  int jobs = 1;
  std::string out;  ///< folder; METHOD/summary.json and METHOD/trace.csv are written there; empty: nothing
};

/// One scene run with several methods.
struct Comparison {
  std::string scene;  ///< its name
  int dof = 0;
  std::vector<std::string> methods;
  std::vector<Summary> summaries;  ///< one for each method
};

/// Throws ConfigError for an invalid scene or method, before anything runs.
Comparison compare(const CompareOptions& options, const Heard& heard = {});

/// A row for each method: its name, then every figure of the summary, then its texts.
Table to_table(const Comparison& all);
/// For people.
std::string to_text(const Comparison& all);

/// A figure that tells runs of one scene apart, for people.
struct ShownFigure {
  const char* title;
  Figure figure;
  double scale = 1.0;  ///< of the unit that the title names
};
const std::vector<ShownFigure>& compared_figures();
/// Their values, each in ten characters, "-" where it is not known; titles where there is no summary.
std::string compared_columns(const Summary* of);

}  // namespace twoport::lab
