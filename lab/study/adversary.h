#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "lab/study/table.h"

namespace twoport::lab {

/// One run against an adversary.
struct AdversaryRun {
  std::uint64_t seed = 0;
  int dof = 0;
  double rate_hz = 0.0;                           ///< of the master
  bool lies = false;                              ///< the reports that reach the master are not the slave's
  bool rests = false;                             ///< hand and environment come to rest; no energy is claimed
  int switches = 0;                               ///< of method
  double hand_least_j = 0.0, both_least_j = 0.0;  ///< with device damping where the claim counts it
  double hand_bound_j = 0.0, both_bound_j = 0.0;  ///< -infinity where nothing is claimed
  double initial_j = 0.0;                         ///< E(0) of a side
  double unforeseen_j = 0.0;                      ///< Σ |f·e| T
  double felt_max_n = 0.0;                        ///< largest force displayed
  double self_moved_m = 0.0;  ///< `rests`: way of the robot while the hand rests and nothing pushes it

  static constexpr double kRounding_j = 1e-9, kMoved_m = 1e-3;
  /// Is the hand's energy below -E(0)?
  [[nodiscard]] bool below() const { return hand_least_j < -initial_j - kRounding_j; }
  /// Is an energy below what is claimed (claim_of)?
  [[nodiscard]] bool broken() const {
    return hand_least_j < hand_bound_j - kRounding_j || both_least_j < both_bound_j - kRounding_j;
  }
  [[nodiscard]] bool moved_by_itself() const { return self_moved_m > kMoved_m; }
};

/// Everything is drawn from the seed: size, rate (250 to 4000 Hz), device, robot, coupling, delay, jitter, loss, bursts,
/// repeated and reordered packets, silences. A hand and a robot's environment that know the forces of both ports change
/// every 10 to 300 ms between pulling along the displayed force, resisting it, springs to a moving target, sines and rest;
/// forces rise within 5 to 50 ms. Every fourth run the master gets reports with wrong forces, positions, energies and
/// words. Positions, velocities and forces are read exactly. 1500 to 4000 ticks.
///
/// Every third run each: scales of force and motion from 0.1 to 10; another rate at each side, 125 to 4000 Hz; limits at the device, at
/// the robot; switches between pairs that claim the hand's port, where this method does. Every fourth: a clock of the slave that drifts; packets
/// that wait in a queue and then flow; packets that come a second time, up to hold_after_s later. Every fifth: clutch, locks and scales of the
/// operator. Every tenth: a direction that goes dead.
/// Every twentieth: observer RECTANGLE. `rests`, every fifth: hand and environment come to rest behind a queue that holds what the hand
/// did before and flows after both sides have released. A switch away from RANDOM counts no self-movement: the hand pushes
/// against what it displays, and the next layer may give the robot that push.
/// `set`: overrides of the scene. Throws ConfigError for an unknown method.
/// `joints`: ports of joints in place of the drawn size. Leader and follower are arms of `arms/` with drawn tools, friction, gains, hand, walls
/// and friction of walls; the hand is a spring and damper on the tool. What a claim that rests on a prediction leaves open is not measured
/// there, so such a claim is not checked.
AdversaryRun attack(const std::string& method, std::uint64_t seed, const std::vector<std::string>& set = {},
                    bool joints = false);

/// Every pair of layers and every method of one piece that claims a bound, but for a plug-in's.
std::vector<std::string> claiming_methods();

struct AdversaryOptions {
  std::vector<std::string> methods;  ///< empty: every method
  std::uint64_t seed = 1;            ///< of the first run
  int runs = 500;                    ///< per method, with seeds counted up
  int jobs = 1;
  bool joints = false;  ///< ports of joints
};
struct Adversary {
  std::vector<std::string> methods;
  std::vector<std::vector<AdversaryRun>> runs;  ///< of each method, by seed
  [[nodiscard]] int broken() const;
  [[nodiscard]] int moved_by_themselves() const;
};
Adversary attack_all(const AdversaryOptions& options, const Heard& heard = {});

/// A line for each method: claim, least energies and their seeds, runs that break the claim.
std::string to_text(const Adversary& all);
/// Of each run that breaks a claim: what it reached, and the command that runs it again.
std::string broken_runs(const Adversary& all);
/// The same of each run whose robot moves by itself.
std::string moved_runs(const Adversary& all);
Table to_table(const Adversary& all);

}  // namespace twoport::lab
