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
#include "lab/study/many_runs.h"
#include "lab/study/table.h"

namespace twoport::lab {

/// The network and the wall of one cell. Both directions are alike.
struct MapPlace {
  double round_trip_ms = 0.0;
  double loss = 0.0;               ///< probability, each way
  double burst_packets = 1.0;      ///< mean number of packets lost in a row; 1: each is lost independently
  double stiffness_n_per_m = 0.0;  ///< 0: the scene's own
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
  const LinkTrace* link =
      nullptr;    ///< given: its packets in place of the network of each place, and a stiffness may be 0
  int seeds = 3;  ///< the scene's seed, seed + 1, …
  VerdictFrom verdict = VerdictFrom::lean;
  const HostedRobot* robot = nullptr;  ///< as RunOptions::robot; the stiffness must then be 0
  int jobs = 1;
  int lanes = 0;                             ///< as ManyRuns::lanes
  const std::atomic<bool>* stop = nullptr;   ///< as RunOptions::stop; the map then has the finished cells
  std::function<void(const Map&)> coarse{};  ///< hears now and then of what is known, as of a map that was stopped
};

/// One method in one place.
struct MapCell {
  std::string method;
  MapPlace place;
  int stable = 0, restless = 0, undecided = 0, unstable = 0;  ///< seeds, by verdict; none: the cell has not run
  /// Mean force of the environment over that of the same scene without delay, loss and control; of the stable seeds.
  Spread pressed{};
  /// √(felt_force_error_rms² + (force missing at the environment)² + free_force_rms² + chatter_rms²) [N], of the stable
  /// seeds: what is wrong with the hand's force, that nothing is pressed, drag, chatter.
  Spread error_n{};
  std::vector<Spread> figures;  ///< as map_figures(), over all seeds; NaN where a figure is absent

  [[nodiscard]] int seeds() const { return stable + restless + undecided + unstable; }
  /// Does the method work here: stable and quiet with every seed, and at least half of the force is pressed?
  [[nodiscard]] bool holds() const { return stable == seeds() && pressed.worst >= 0.5; }
  double reference_n = 0.0;  ///< of the place
  /// Does the hand also feel what is pressed? Holds, and the error of every seed is below half of the force that is pressed without
  /// delay, loss and control. A method that displays nothing, or drags with that force, has an error of about all of it.
  [[nodiscard]] bool good() const { return holds() && error_n.worst < 0.5 * reference_n; }
};

struct Map {
  std::string scene;                     ///< its name
  std::vector<std::string> methods;      ///< in the order of cells
  std::vector<MapPlace> places;          ///< in the order of cells
  std::vector<double> reference_n;       ///< of each place: environment's mean force without delay, loss and control
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

/// The overrides that make the map's scene the run of one method in one place.
std::vector<std::string> map_overrides(const Scene& scene, const std::string& method, const MapPlace& place,
                                       std::uint64_t seed);

/// Runs every method in every place with every seed. A loss of 0 is run once, not for every burst length.
/// Throws ConfigError when an option or the scene is invalid. Places run from coarse to fine (Refinement), those first where the answer
/// changes.
Map make_map(const MapOptions& options, const Heard& heard = {});

/// Of the methods that hold in a place, the number of the one with the least error_n; the number of methods where none does.
std::size_t best_method(const Map& map, std::size_t place);

/// The same in the first place, of those that bound the energy of the hand's port, have never paid it more than E(0), and press at most half
/// too much.
std::size_t advised_method(const Map& map);

/// A map that was stopped, to draw it: a place that has not run has the cells of the one that stands for it. None where one has none.
std::optional<Map> filled(const Map& some);

/// A row for each cell that has run.
Table to_table(const Map& map);
/// For people, of the places where every method has run: one line a method, in how many places it holds, is best or within 5 % of the best, and its worst figures.
std::string to_text(const Map& map);

/// The method for one network and wall, and why: by advised_method(); "none" where there is none.
struct Recommendation {
  std::string method, why;
};
Recommendation recommend(const Map& of_one_place);

}  // namespace twoport::lab
