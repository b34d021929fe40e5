#pragma once

#include <string>
#include <vector>

#include "lab/study/sweep.h"

namespace twoport::lab {

/// Draws one column of a sweep into FOLDER/KEY.png and FOLDER/KEY.svg: one axis a curve, two a map (the first across),
/// three a map for each value of the third. Runs that are unstable are marked in a curve and grey in a map; `stable`
/// itself is drawn in two colours or, over seeds, as the share of stable seeds. Over seeds a curve of the mean has a band
/// of ± one standard deviation and a line of the worst. Scales of values with one sign begin at 0, so that a small spread
/// looks small. What gnuplot was given stays beside the pictures, as KEY.gp and KEY.dat. Returns one sentence: what was
/// drawn, or why nothing was. Throws ConfigError when the table has no such column.
std::string draw(const Table& table, const std::string& key, const std::string& folder);

/// The columns of a sweep, besides the varied paths, that the picture of `key` shows.
std::vector<std::string> columns_of_picture(const std::string& key);

}  // namespace twoport::lab
