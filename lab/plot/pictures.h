#pragma once

#include <string>
#include <vector>

#include "common/record/summary.h"

namespace twoport {
class TraceTable;
}

namespace twoport::lab {

struct BlockCost;
struct BoundaryCurve;
struct Chart;
struct Comparison;
struct DisplayedImpedance;
struct Map;
struct Matrix;
struct Table;
struct ZWidth;

// The pictures of the laboratory's studies (picture.h). Each returns one sentence for a picture: what was drawn, or why nothing was.

/// run: of the axis or joint that is loaded most the position of both sides and the force felt and pressed, and the energy that the hand
/// has put in, over time.
std::string draw(const TraceTable& trace, const Summary& summary, const std::string& folder);

/// Draws one column of a sweep into FOLDER/KEY.png and .svg: one axis a curve, two a map (the first across), three a map for
/// each value of the third. Runs that are unstable are marked in a curve and grey in a map; `stable` itself is drawn in two
/// colours or, over seeds, as the share of stable seeds. Over seeds a curve of the mean has a band of ± one standard
/// deviation and a line of the worst. Scales of values with one sign begin at 0, so that a small spread looks small. Throws
/// ConfigError when the table has no such column.
std::string draw(const Table& sweep, const std::string& key, const std::string& folder);
/// The columns of a sweep, besides the varied paths, that the picture of `key` shows.
std::vector<std::string> columns_of_picture(const std::string& key);

/// boundary: at each value of the second axis the part of LO to HI in which the run is stable, and the boundary as a line.
std::string draw(const BoundaryCurve& curve, const std::string& folder);
/// zwidth: for each method a dot at every damping and stiffness that was run, and theory's border.
std::string draw(const ZWidth& z, const std::string& folder);
/// map: a panel for each method; round trip to the right, stiffness upwards, the colour is the share of the losses at which the
/// method holds (Standing::holds). map_best: a panel for each loss, the colour is the best method (best_of).
std::string draw(const Map& map, const std::string& folder);
/// matrix: rows are transparency layers, columns passivity layers; the colour is the error of the felt force, strokes say where a claim of
/// energy is broken and where the run is not stable.
std::string draw(const Matrix& matrix, const std::string& folder);
/// compare: force at the environment and at the hand, of ports of joints at the arms' tools, a panel for each method, from
/// FOLDER/METHOD/trace.csv.
std::string draw(const Comparison& all, const std::string& folder);
/// impedance: size and phase of force against motion, displayed and true, and coherence.
std::string draw(const std::vector<DisplayedImpedance>& all, const std::string& scene, const std::string& folder);
/// blocks: a bar for each model.
std::string draw(const std::vector<BlockCost>& costs, const std::string& title, const std::string& folder);
/// chart: error against cost, in a colour for each group, and the front.
std::string draw(const Chart& chart, const std::string& title, const std::string& folder);

}  // namespace twoport::lab
