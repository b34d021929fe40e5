#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "lab/study/table.h"

namespace twoport::lab {

/// What a method promises of the energies [J] since the start, for any hand, robot and network:
///
///     hand   Σ f·Δx at the master port              >= -E(0) - slack
///     both   hand less what leaves at the slave      >= -E(0) of both sides - slack
///     slack  = Σ |f·e| T + K δ²/2
///     e(k+1) = e(k) - e(k-1)/4 + a(k+1) - a(k)         a(k+1) = v(k+1) - v(k) + C (f(k) + f(k+1)),   v = Δx/T, C = T/(2m)
///
/// At the slave Σ f·v_d T leaves the link, with `robot_port` Σ f·Δx of the robot. a: what all but the displayed force f adds to the
/// handle's velocity in a tick; e: the error that this makes in the velocity which the controller predicts
/// (common/passivity/velocity_predictor.h), counted where `predicts`. K: the coupling's stiffness where `tick_of_spring`, else 0;
/// δ: largest motion in a tick.
struct EnergyClaim {
  bool hand = false, both = false;
  bool any_packets = false;     ///< of the hand: whatever the slave reports
  bool device_damping = false;  ///< Σ b Δx²/T of the device counts with the hand's energy
  bool robot_port = false;
  bool tick_of_spring = false;
  bool shares_initial = false;  ///< E(0) is of both ports together, not of each
  bool predicts = false;        ///< as the handle has moved, not for the worst that a hand can do
};
EnergyClaim energy_claim(const std::string& method);

/// One run against an adversary.
struct AdversaryRun {
  std::uint64_t seed = 0;
  int dof = 0;
  double rate_hz = 0.0;
  bool lies = false;                              ///< the reports that reach the master are not the slave's
  double hand_least_j = 0.0, both_least_j = 0.0;  ///< with device damping where the claim counts it
  double hand_bound_j = 0.0, both_bound_j = 0.0;  ///< -infinity where nothing is claimed
  double initial_j = 0.0;                         ///< E(0) of a side
  double unforeseen_j = 0.0;                      ///< Σ |f·e| T
  double felt_max_n = 0.0;                        ///< largest force displayed

  static constexpr double kRounding_j = 1e-9;
  /// Is the hand's energy below -E(0)?
  [[nodiscard]] bool below() const { return hand_least_j < -initial_j - kRounding_j; }
  /// Is an energy below what the method claims?
  [[nodiscard]] bool broken() const {
    return hand_least_j < hand_bound_j - kRounding_j || both_least_j < both_bound_j - kRounding_j;
  }
};

/// Everything is drawn from the seed: size, rate (250 to 4000 Hz), device, robot, coupling, delay, jitter, loss, bursts,
/// repeated and reordered packets, silences. A hand and a robot's environment that know the forces of both ports change
/// every 10 to 300 ms between pulling along the displayed force, resisting it, springs to a moving target, sines and rest;
/// forces rise within 5 to 50 ms. Every fourth run the master gets reports with wrong forces, positions, energies and
/// words. Positions, velocities and forces are read exactly. 1500 to 4000 ticks.
/// `set`: overrides of the scene. Throws ConfigError for an unknown method.
AdversaryRun attack(const std::string& method, std::uint64_t seed, const std::vector<std::string>& set = {});

struct AdversaryOptions {
  std::vector<std::string> methods;  ///< empty: every method
  std::uint64_t seed = 1;            ///< of the first run
  int runs = 500;                    ///< per method, with seeds counted up
  int jobs = 1;
};
struct Adversary {
  std::vector<std::string> methods;
  std::vector<std::vector<AdversaryRun>> runs;  ///< of each method, by seed
  [[nodiscard]] int broken() const;
};
Adversary attack_all(const AdversaryOptions& options, const Heard& heard = {});

/// A line for each method: claim, least energies and their seeds, runs that break the claim.
std::string to_text(const Adversary& all);
/// Of each run that breaks a claim: what it reached, and the command that runs it again.
std::string broken_runs(const Adversary& all);
Table to_table(const Adversary& all);

}  // namespace twoport::lab
