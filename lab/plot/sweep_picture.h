#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "lab/study/sweep.h"

namespace twoport::lab {

/// A line over every map, in its coordinates.
struct Line {
  std::string title;
  std::vector<std::pair<double, double>> points;
};

/// Draws one column of a sweep into FOLDER/KEY.png and FOLDER/KEY.svg: one axis a curve, two a map (the first across),
/// three a map for each value of the third, with `lines` over it. Cells that are unstable are hatched out of a curve
/// and grey in a map, unless the column is `stable` itself. What gnuplot was given stays beside the pictures, as KEY.gp
/// and KEY.dat. Returns one sentence: what was drawn, or why nothing was. Throws ConfigError when the table has no such
/// column.
std::string draw(const Table& table, const std::string& key, const std::string& folder,
                 const std::vector<Line>& lines = {});

/// Throws ConfigError, naming what there is, unless a summary has this number.
void check_key(const std::string& key);

}  // namespace twoport::lab
