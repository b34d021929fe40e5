#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "common/coupling/options.h"
#include "common/record/summary.h"
#include "lab/study/many_runs.h"
#include "lab/study/ranking.h"
#include "lab/study/table.h"

namespace twoport::lab {

struct CompareOptions {
  std::string scene;
  std::vector<std::string> set;
  std::vector<std::string> methods;    ///< empty: every method
  const HostedRobot* robot = nullptr;  ///< as RunOptions::robot
  int jobs = 1;
  std::string out;  ///< folder; METHOD/summary.json and METHOD/trace.csv are written there; empty: nothing
};

/// One scene run with several methods.
struct Comparison {
  std::string scene;  ///< its name
  int dof = 0;
  ControlOptions control{};  ///< of the scene as it is
  std::vector<std::string> methods;
  std::vector<Summary> summaries;  ///< one for each method
  /// One for each method; none without a link.
  std::vector<Standing> standings;
  double unplayed_s = 0.0;  ///< of a link's trace what comes after the end of the scene
};

/// Throws ConfigError for an invalid scene or method, before anything runs.
Comparison compare(const CompareOptions& options, const Heard& heard = {});

/// A row for each method: its name, then every figure of the summary, the error by which methods are ranked, then its texts.
Table to_table(const Comparison& all);
/// For people; below the table which method is best, and why.
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

struct GalleryOptions {
  std::string folder = "scenes/edge";
  std::vector<std::string> methods;  ///< empty: every method
  int jobs = 1;
};

/// Every scene of a folder, run with every method.
struct Gallery {
  struct Entry {
    std::string scene;                ///< file name without its ending
    std::vector<Summary> summaries;   ///< one for each method
    std::vector<std::string> missed;  ///< expectations that were not met, one sentence each
  };
  std::vector<std::string> methods;
  std::vector<Entry> entries;
};

/// Throws ConfigError for a folder without scenes, an invalid scene or an unknown method. Only expectations of a method's
/// verdict (`of_method`) are checked.
Gallery gallery(const GalleryOptions& options, const Heard& heard = {});

/// What a run was, in a word: stable, mute (stable, and nothing is felt in more than half of the contact), restless,
/// UNSTABLE, undecided.
std::string in_a_word(const Summary& summary);

/// Who survives what: a row for each scene, a column for each method.
std::string to_text(const Gallery& all);
/// A row for each scene and method.
Table to_table(const Gallery& all);

struct MatrixOptions {
  std::string scene;
  std::vector<std::string> set;
  std::vector<std::string> transparencies, passivities;  ///< empty: every layer that some pair can run with
  const HostedRobot* robot = nullptr;                    ///< as RunOptions::robot
  int jobs = 1;
  int lanes = 0;  ///< as ManyRuns::lanes
};

/// One scene run with every pair of a transparency and a passivity layer, with the same E(0).
struct Matrix {
  static constexpr double kTolerance_j = 1e-4;

  struct Cell {
    std::string refused;  ///< why the pair makes no sense; empty: it ran
    Summary summary{};
    bool broken =
        false;  ///< the energy of the port that the passivity layer claims to bound fell below -E(0) - kTolerance_j
  };
  std::string scene;  ///< its name
  std::vector<std::string> transparencies, passivities;
  std::vector<Cell> cells;  ///< [transparency * passivities.size() + passivity]
  [[nodiscard]] const Cell& at(std::size_t transparency, std::size_t passivity) const {
    return cells[transparency * passivities.size() + passivity];
  }
};

/// Throws ConfigError for a scene that is invalid with its own layers, and for a name that is no layer's.
Matrix matrix(const MatrixOptions& options, const Heard& heard = {});

/// A row for each pair: the layers, verdict_kind (REFUSED where the pair makes no sense), compared_figures().
Table to_table(const Matrix& matrix);
/// For people; below the table why pairs were refused.
std::string to_text(const Matrix& matrix);

}  // namespace twoport::lab
