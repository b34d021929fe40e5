#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/link/link_trace.h"
#include "common/scene/scene.h"
#include "lab/run.h"
#include "lab/study/grid.h"
#include "lab/study/link_parts.h"
#include "lab/study/many_runs.h"
#include "lab/study/ranking.h"
#include "lab/study/table.h"

namespace twoport::lab {

/// The network and the wall of one cell. Both directions are alike.
struct MapPlace {
  double round_trip_ms = 0.0;
  double loss = 0.0;               ///< probability, each way
  double burst_packets = 1.0;      ///< mean number of packets lost in a row; 1: each is lost independently
  double stiffness_n_per_m = 0.0;  ///< 0: the scene's own
  bool recorded = false;           ///< a link's packets go over it
};

struct Map;

struct MapOptions {
  std::string scene;                 ///< file; empty: scenes/map.textproto, which is built in
  std::vector<std::string> set;      ///< overrides, applied before those of the cell
  std::vector<std::string> methods;  ///< empty: every method
  std::vector<double> round_trips_ms{0, 10, 20, 50, 100, 200, 400, 700, 1000, 2000};
  std::vector<double> losses{0, 0.05, 0.1, 0.2, 0.5};
  std::vector<double> bursts_packets{1, 20};
  std::vector<double> stiffnesses_n_per_m{200, 300, 500, 700, 1000, 1500, 2300, 3500, 5500, 8500, 13000, 20000};
  /// Given: the worst parts of its packets, each a run, in place of the network of each place; a stiffness may be 0.
  const LinkTrace* link = nullptr;
  int seeds = 3;  ///< the scene's seed, seed + 1, …
  VerdictFrom verdict = VerdictFrom::lean;
  const HostedRobot* robot = nullptr;  ///< as RunOptions::robot; the stiffness must then be 0
  int jobs = 1;
  int lanes = 0;                             ///< as ManyRuns::lanes
  const std::atomic<bool>* stop = nullptr;   ///< as RunOptions::stop; the map then has the finished cells
  std::function<void(const Map&)> coarse{};  ///< hears now and then of what is known, as of a map that was stopped
};

/// One method in one place.
struct MapCell : Standing {
  MapPlace place;
  std::vector<Spread> figures;  ///< as map_figures(), over all runs; NaN where a figure is absent
};

struct Map {
  std::string scene;                     ///< its name
  std::vector<std::string> methods;      ///< in the order of cells
  std::vector<MapPlace> places;          ///< in the order of cells
  std::vector<double> reference_n;       ///< of each place: reference_force_n()
  std::vector<LinkPart> parts;           ///< of the link that were played; none without a link
  std::vector<double> initial_energy_j;  ///< of each place: E(0), the same for every method
  std::vector<MapCell> cells;            ///< [method * places.size() + place]
  LaneUse use;
  bool stopped = false;                   ///< not all cells have run
  std::vector<Refinement::Side> sides{};  ///< of the grid of cells
  [[nodiscard]] const MapCell& at(std::size_t method, std::size_t place) const {
    return cells[method * places.size() + place];
  }
};

/// An interval for a probability after k of n trials, by Wilson's score at 95 % (z = 1.96).
struct ConfidenceInterval {
  double low, high;
};
ConfidenceInterval wilson(int k, int n);

/// Figures of the summary that the table holds.
const std::vector<Figure>& map_figures();

/// Every controller that a rendered scene can name.
std::vector<std::string> rendering_methods();

/// Throws ConfigError, which begins with `option`, for a name that is not in `allowed`, or is there twice.
void check_names(const char* option, const std::vector<std::string>& names, const std::vector<std::string>& allowed);
/// The same for `--methods`, which may also name pairs TRANSPARENCY+PASSIVITY.
void check_methods(const std::vector<std::string>& methods, const std::vector<std::string>& allowed);
/// The overrides that give a scene this method: a name, or TRANSPARENCY+PASSIVITY.
std::vector<std::string> method_overrides(const std::string& method);

/// The overrides that make the map's scene the run of one method in one place. Each rest is longer by what the round trip exceeds the
/// scene's own by: at its own the scene runs as it is.
std::vector<std::string> map_overrides(const Scene& scene, const std::string& method, const MapPlace& place,
                                       std::uint64_t seed);

/// Runs every method in every place with every seed. A loss of 0 is run once, not for every burst length.
/// Throws ConfigError when an option or the scene is invalid. Places run from coarse to fine (Refinement), those first where the answer
/// changes.
Map make_map(const MapOptions& options, const Heard& heard = {});

/// How the methods stand in a place, for best_of() and recommend().
std::vector<Standing> standings(const Map& map, std::size_t place);

/// A map that was stopped, to draw it: a place that has not run has the cells of the one that stands for it. None where one has none.
std::optional<Map> filled(const Map& some);

/// A row for each cell that has run.
Table to_table(const Map& map);
/// For people, of the places where every method has run: one line a method, in how many places it holds, is best or within 5 % of the best, and its worst figures;
/// of one place which method is best, and why.
std::string to_text(const Map& map);

}  // namespace twoport::lab
