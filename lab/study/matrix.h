#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "common/record/summary.h"
#include "lab/study/table.h"

namespace twoport::lab {

struct MatrixOptions {
  std::string scene;
  std::vector<std::string> set;
  std::vector<std::string> transparencies, passivities;  ///< empty: every layer that some pair can run with
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
