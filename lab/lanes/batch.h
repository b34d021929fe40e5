#pragma once

#include <cstdint>

#include "common/record/sums.h"

// The border between the laboratory and the lane units (loop_sse42.cc and its like), which are compiled for other instruction
// sets: plain structs only. A unit must not instantiate an inline function that another translation unit may share, so it
// includes no header of the standard library or of Eigen.

namespace twoport::lab::lanes {

inline constexpr int kMostLanes = 8, kMostSprings = 2;

/// As many as there are axes.
template <class S, int N>
struct Array {
  S e[N];
  S& operator[](int i) { return e[i]; }
  const S& operator[](int i) const { return e[i]; }
};

/// Numbers of a cell that do not change during a run, but for the last three. S: a double, or as many as a unit has lanes.
template <class S, int N>
struct Parameters {
  S dt, period_ns;
  // Handle and hand: sim/plant/handle.h, sim/operator/hand.h.
  S handle_xv, handle_xu, handle_xw, handle_vv, handle_vu, handle_vw;
  S hand_stiffness, hand_damping;
  Array<S, N> held_at;  ///< tail: intended position
  // Robot: sim/plant/exact_wall.h; [0]: free, [1]: in contact.
  S map_x[2][2], map_v[2][2], map_u[2][2], load[2], in_parts[2];
  S along_stiffness[2], along_xv[2], along_xu[2], along_vv[2], along_vu[2];
  S offset, wall_stiffness, wall_damping, wall_viscous;
  Array<S, N> normal, pull;
  S spring_stiffness[kMostSprings], spring_damping[kMostSprings];
  Array<S, N> spring_anchor[kMostSprings];
  Array<S, N> sensor_bias;
  // A plant in Runge-Kutta steps: sim/plant/make_body_plant.h, sim/plant/handle.h.
  S step_s, robot_mass, robot_damping, wall_friction, handle_inverse_mass, handle_damping;
  // Coupling and registration.
  S stiffness, damping, mobility, catch_up;
  S motion_scale, force_scale, energy_to_slave, energy_to_master;
  // Nodes.
  S most_silence_ns, ramp_by, most_force;
  // Method.
  S initial_energy, most_gain, response, worst_of_hand;
  // Network: [0]: to the slave, [1]: to the master.
  S lag[2], loss[2], burst_p[2], burst_r[2], burst_good[2], burst_bad[2];
  // InternalModelMaster, InternalModelSlave: R, K_c, masses, and T/τ of every low pass (weight_ms: of so many).
  S round_trip_s, coupling, quarter_handle, robot_kg, robot_quarter_per_dt, brake, to_master_stiffness, inverse_motion;
  S yields, spring, dt2, most_damping, weight_3ms, weight_10ms, weight_20ms, weight_30ms, weight_50ms, weight_100ms,
      weight_500ms, weight_along, weight_residual, weight_outside, weight_offset_normal, ramp_in_100ms;
  // Metrics.
  S filter_b0, filter_a1, filter_a2, most_speed2, window;
  // Change at stops.
  S late, at_rest;
};

/// SurfacePatch.
template <class S, int N>
struct Patch {
  S stiffness, friction, curvature;
  Array<S, N> point, normal;
};

/// State of InternalModelMaster and InternalModelSlave, by their members' names.
template <class S, int N>
struct InternalModel {
  // Slave: SurfaceEstimator, SensorBias, yield; what the master has said.
  Patch<S, N> found;
  S contact, quiet_s, age_s, damping, xx, xv, vv, xf, vf, variance, covariance;
  Array<S, N> f_contact, x_slow, v_slow, f_slow, v_surface, f_surface, x_mean, n_mean;
  S learned_s, yield_m;
  Array<S, N> bias, yield_normal, shift;
  S informed;
  Array<S, N> offset_rx, felt_rx;
  // Master: SurfaceModel, StickSpring, EnergySpring, DamperAccount; what the slave has said.
  S heard, contact_rx;
  Array<S, N> echo_rx, robot_rx;
  Patch<S, N> found_rx, model;
  S exists, model_ramp, sticks, sticks_at_echo;
  Array<S, N> anchor, anchor_at_echo;
  S offset_m, scale_slow, shown;
  Array<S, N> r, r_along, offset_normal, felt, slow_v, commanded;
  S energy, net, level;
  Array<S, N> g;
};

/// State of a simulation between two ticks: both plants, both nodes, both halves of the method, what is known of the network.
template <class S, int N>
struct State {
  S k;  ///< number of the next tick
  // Device.
  S master_energy;
  Array<S, N> master_x, master_v, held, intended;
  // Robot.
  S across[2], in_contact, into_robot;
  Array<S, N> slave_x, slave_v, command;
  // Master's node and half.
  S master_absorbed, master_returned, ramp, master_mode;
  S slave_known, slave_heard_at, slave_energy;
  Array<S, N> f_rx, f_coupling_rx;
  S base_absorbed, base_returned, absorbed_before;
  S predicted_error, predicted_worst;
  Array<S, N> predicted_u, predicted_d, predicted_applied, predicted_w, predicted_before;
  S command_absorbed, command_returned;
  Array<S, N> command_force;
  // Slave's node and half.
  S slave_absorbed, slave_returned, slave_mode;
  S master_known, master_heard_at, known_energy;
  Array<S, N> x_rx, v_rx;
  S shifted;
  Array<S, N> origin, x_sd, x_d, target;
  S coupling_absorbed, coupling_returned, coupling_worst, energy_sent;
  Array<S, N> coupling_f, x_before;
  // The laboratory's loop.
  S force_lag;
  Array<S, N> delayed_force, hand_origin;
  // Packets, by direction: received, and the tick at which the first one came.
  S received[2], first_at[2];
  S random[2];  ///< bits of an unsigned integer
  S bad_state[2];
  S silent;  ///< not 0: a side has heard nothing for so long that the age of reports counts (ReportAge)
  InternalModel<S, N> model;  ///< the last member: copied for that method only
};

/// Sums of a run, and what HeldForce and Contacts keep.
template <class S, int N>
struct Sums : MetricsSums<S, N>, ContactSums<S>, JudgeSums<S, N> {
  Array<S, N> filter_1, filter_2;
  S held_next, held_ticks;
  S pressed, late_ticks, touched;
};

/// `nodes`: both nodes, their halves and the link are the laboratory's own, stepped lane by lane.
enum class LaneMethod : int { none, one_port, predictive, internal_model, nodes };

inline constexpr int words_to_slave(int dof, LaneMethod method) {
  // x, v, energy; o, f_m, whether they are there
  return 2 * dof + 1 + (method == LaneMethod::internal_model ? 2 * dof + 1 : 0);
}
inline constexpr int words_to_master(int dof, LaneMethod method) {
  // f, f_environment, energy, f_coupling; contact, K*, μ, κ, n, p, x_sd, x_s, whether they are there
  return 3 * dof + 1 + (method == LaneMethod::internal_model ? 4 * dof + 5 : 0);
}
inline constexpr int words_of_record(int dof) {
  return 2 * dof + 5;  // velocities, energies (Tail::record), events
}
enum Event : unsigned { kTouching = 1, kLimited = 2, kActed = 4, kDriven = 8, kSilent = 16 };

/// Of what nodes are given and give, lane by lane: numbers of a tick, [field][lane].
inline constexpr int numbers_of_slave(int dof) {
  return 6 * dof +
         3;  // x, v, force of the environment; command, position error, origin of the hand, energy, mode, dissipated
}
inline constexpr int numbers_of_master(int dof) {
  return 5 * dof + 4;  // x, v; force in and out, wanted, reference, energy, mode, dissipated, undissipated
}

/// As many simulations as the unit has lanes. Arrays are [field][lane], rings [slot][field][lane], aligned to 64 bytes.
struct Batch {
  double *parameters, *state, *sums;
  double *to_slave, *to_master, *window, *record;
  std::int64_t slots, window_slots;  ///< of the rings; powers of two
  std::int64_t clock;                ///< number of the next tick, since the batch began
  std::int64_t record_row;           ///< of the next tick
  bool records;                      ///< run: ticks are recorded too
  const double* path[kMostLanes];    ///< run: intended position at each tick, N numbers each
  void* plant[kMostLanes];           ///< for plant_step
  // The same in every lane.
  LaneMethod method;
  bool projected, unilateral, predict;  ///< one_port
  bool keeps_deficit;                   ///< not as published
  bool measured, drift_compensation, hand, wall;
  int substeps;       ///< Runge-Kutta steps of a tick; 0: exact maps
  bool keeps_states;  ///< run: states in contact are wanted
  int springs;
  // Made from the parameters whenever a lane has been filled.
  bool lossy[2], bursts[2], one_lag[2], together;
  /// One tick of a lane's plant in which contact changes: x, v, across, in_contact, force.
  void (*plant_step)(void* plant, double* numbers);
  /// Square of the angle between two vectors [rad²], as common/record/angle.h: u, f, |u|², |f|².
  double (*squared_angle)(const double* u, const double* f, double u2, double f2);
  /// LaneMethod::nodes: a tick of all lanes.
  void (*slave_nodes)(Batch& batch, double* numbers);
  void (*master_nodes)(Batch& batch, double* numbers);
  /// The lane's window of held force has ended.
  void (*window_ended)(Batch& batch, int lane);
  void* owner;
  unsigned diverged;  ///< lanes, set when run() returns
};

/// Runs up to `ticks` ticks; ends after one in which a lane has diverged. Returns the number of ticks.
using Run = std::int64_t (*)(Batch&, std::int64_t ticks);
struct Unit {
  const char* name;
  int lanes;
  Run run[2], tail[2];  ///< N = 1, 3
};

extern const Unit kBase, kAvx2, kAvx512;

}  // namespace twoport::lab::lanes
