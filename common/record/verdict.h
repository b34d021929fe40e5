#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "common/record/trend.h"

namespace twoport {

/// Is a run stable? docs/reference/stability.md explains the criterion.
enum class VerdictKind : unsigned char {
  stable,     ///< the motion decays, or stays bounded and takes no energy from the network
  restless,   ///< bounded and passive, but a controller keeps it moving
  unstable,   ///< grows by itself, diverges, or is kept going by energy that the network creates
  undecided,  ///< not known; the text says why, and what would decide it
};
std::string_view to_string(VerdictKind kind);

struct Verdict {
  VerdictKind kind = VerdictKind::undecided;
  std::string text;  ///< the reason

  [[nodiscard]] bool stable() const { return kind == VerdictKind::stable || kind == VerdictKind::restless; }
};

/// What may make the energy that a hand is paid.
enum class EnergySource : unsigned char { unknown, rendering, network };

/// Motion of the handle that noise of the force sensor alone may cause, rms [m/s], [rad/s].
struct NoiseMotion {
  double translation = 0.0, rotation = 0.0;
};

/// How large the motion of a run was: what its tail is measured against. A signal is a coordinate's velocity; those of the
/// master come first, as many of the slave follow, translations before rotations on each side.
struct MotionScale {
  std::size_t dof = 1;  ///< coordinates of a side; with 6 rotations from the fourth on
  double rate_hz = 1000.0;
  EnergySource source = EnergySource::unknown;
  double reach_m = 0.0;       ///< largest distance of a side from the origin
  std::vector<double> speed;  ///< of each signal, largest [m/s], [rad/s]
  std::vector<double> early;  ///< the same within the first twentieth of the run
  NoiseMotion noise;          ///< in what is judged

  [[nodiscard]] bool rotates(std::size_t signal) const { return dof == 6 && signal % dof >= 3; }
  /// Largest speed of this kind of motion, translation or rotation, on either side.
  [[nodiscard]] double largest(bool rotation) const;
  [[nodiscard]] double largest_of_kind(std::size_t signal) const { return largest(rotates(signal)); }
  /// Velocity that rounding of positions alone makes: 16 ε · rate · reach [m/s], [rad/s].
  [[nodiscard]] double rounding(std::size_t signal) const;
};

/// What is known of a quiet tail: a stretch of time in which the loop moves from its initial state, with no excitation.
struct Tail {
  /// Signals: each coordinate's velocity y; then, where there is a twin, as many differences d of the twin's from it. The
  /// twin is the same run with every coordinate that moved kicked a little at the beginning of the tail.
  /// Energies: through the hand's port; through the hand's and the robot's coupling port together; E(0) in neither [J]. Then,
  /// where they are known: put into the robot's coupling through both its ports; taken by the robot from it, slave's units.
  TrendRecord record;
  bool has_twin = false;
  bool twin_parted = false;       ///< the twin has been given up (see twin_has_parted)
  bool has_controller = false;    ///< a passivity controller is there, and acts once the hand's credit is used up
  bool controller_acted = false;  ///< a passivity controller dissipated energy in it
  bool driven = false;            ///< a control force acted: on the hand, or of the coupling on the robot
  bool coarse = false;            ///< an encoder or Coulomb friction is in the loop: it is not linear however small
  bool diverged = false;          ///< not finite, or beyond a thousand times the reach or speed of the run
  double initial_energy_j = 0.0;
  double run_lengths = 1.0;  ///< length of the tail over that of the run
  bool last = false;         ///< there is no more tail to come
};

/// Judges a body without a controller by its mechanical energy, the record's energies. The energy of the model cannot grow;
/// if it does, the integrator adds to it: UNSTABLE.
Verdict judge_body(const Tail& tail);

/// Does the robot's own sampled coupling drive it, while the hand may move? `tail` holds both sides' motion. It then moves at three
/// times the speed at which it would follow the hand, or more.
bool is_driven_by_coupling(const Tail& tail, const MotionScale& run, double motion_scale);

/// Has the twin's difference become a part of the motion itself, and irregular, under a passivity controller? It then tells
/// no more than the motion does.
bool twin_has_parted(const Tail& tail, const MotionScale& run);

/// Judges a tail by the trends of each coordinate, y and d, and by the energies through the ports. Rules: docs/reference/stability.md.
/// UNDECIDED: a longer tail is needed.
Verdict judge(const Tail& tail, const MotionScale& run);

}  // namespace twoport
