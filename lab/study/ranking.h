#pragma once

#include <atomic>
#include <cstddef>
#include <string>
#include <vector>

#include "common/record/summary.h"
#include "common/scene/scene.h"
#include "lab/study/table.h"

// Which method is best in one scene over one link: recommend, compare and map say it by best_of().

namespace twoport::lab {

struct HostedRobot;

/// The runs of one method in one scene over one link.
struct Standing {
  std::string method;
  int stable = 0, restless = 0, undecided = 0, unstable = 0;  ///< runs, by verdict; none: the method has not run
  double reference_n = 0.0;                                   ///< reference_force_n()
  double initial_energy_j = 0.0;                              ///< E(0), the same for every method
  /// Mean force of the environment over reference_n; of the stable runs. NaN, as error_n, where there is no reference.
  Spread pressed{};
  /// √(felt_force_error_rms² + (force missing at the environment)² + free_force_rms² + chatter_rms²) [N], of the stable
  /// runs: what is wrong with the hand's force, that nothing is pressed, drag, chatter.
  Spread error_n{};
  double drag_n = 0.0, held_force_ratio = 0.0;  ///< means over the runs
  double hand_min_energy_j = 0.0;               ///< least of the runs

  [[nodiscard]] int runs() const { return stable + restless + undecided + unstable; }
  /// Does the method work here: stable and quiet in every run, and at least half of the force is pressed?
  [[nodiscard]] bool holds() const { return stable == runs() && pressed.worst >= 0.5; }
  /// Does the hand also feel what is pressed? Holds, and the error of every run is below half of the force that is pressed without
  /// delay, loss and control. A method that displays nothing, or drags with that force, has an error of about all of it.
  [[nodiscard]] bool good() const { return holds() && error_n.worst < 0.5 * reference_n; }
  /// May it be named as the best? Holds, bounds the energy of a port, has never paid the hand more than E(0), and presses at most half too
  /// much.
  [[nodiscard]] bool may_be_best() const;
};
Standing standing_of(const std::string& method, const std::vector<Summary>& runs, double reference_n,
                     double initial_energy_j);

/// E(0) for every method: what the scene states, else that of the default's rule at this round trip.
Energy shared_initial_energy(const Scene& scene, Seconds round_trip);

/// Mean force of the environment over the run of `scene` without delay and loss; NaN where that run is unstable. `scene` is without
/// passivity control.
double reference_force_n(Scene scene, const std::atomic<bool>* stop = nullptr, const HostedRobot* robot = nullptr);

/// Of those that may be best the number of the one with the least error_n; the number of all where there is none.
std::size_t best_of(const std::vector<Standing>& all);

/// The best method, and why; "none" where there is none.
struct Recommendation {
  std::string method, why;
};
Recommendation recommend(const std::vector<Standing>& all);
/// "best: NAME: why" and the line's end.
std::string in_a_line(const Recommendation& best);

}  // namespace twoport::lab
