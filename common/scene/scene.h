#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "common/base/vector.h"
#include "common/contact/contact_law.h"
#include "common/coupling/options.h"
#include "common/hardware/mount.h"
#include "common/hardware/servo.h"
#include "common/link/impairment.h"
#include "common/link/transmission.h"
#include "common/passivity/controller_options.h"
#include "common/passivity/observer.h"

namespace twoport {

/// Numbers as a scene writes them; empty means "not given".
using Numbers = std::vector<double>;

/// Coordinates as a scene writes them, zero where it does not.
template <int N>
Eigen::Matrix<double, N, 1> vector(const Numbers& n) {
  Eigen::Matrix<double, N, 1> v = Eigen::Matrix<double, N, 1>::Zero();
  for (int i = 0; i < N && i < static_cast<int>(n.size()); ++i) v[i] = n[static_cast<std::size_t>(i)];
  return v;
}

/// A position as a scene writes it: N numbers, or for N = 6 x y z with or without a quaternion w x y z. Empty: origin.
template <int N>
Position<N> position(const Numbers& n) {
  if constexpr (N == 6) {
    const Eigen::Vector3d p = vector<3>(n);
    Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
    if (n.size() == 7) q = Eigen::Quaterniond{n[3], n[4], n[5], n[6]}.normalized();
    return {p, q};
  } else {
    return Position<N>{vector<N>(n)};
  }
}

struct RecordedHand;
struct ArmParameters;
struct SceneSource;

// A scene as plain, validated values: the content of proto/scene.proto with all lengths, signs and ranges checked and
// all defaults filled in. Vectors have `axes()` entries (1 or 3) unless said otherwise. SI units.

struct HandSpec {
  double mass_kg, stiffness_n_per_m, damping_n_s_per_m;
  double inertia_kg_m2, rotational_stiffness_n_m_per_rad, rotational_damping_n_m_s_per_rad;
  Numbers force_n{};  ///< constant, on the handle
};
struct HoldSpec {
  double duration_s;
};
struct MoveToSpec {
  Numbers position_m;  ///< 1 or 3 numbers; dof 6: 3, or 7 with the attitude w x y z
  double duration_s;
};
struct SineSpec {
  int axis;
  double amplitude_m, frequency_hz, duration_s;
};
struct ScrewSpec {
  Numbers point_m, axis;  ///< axis of unit length
  double angle_rad, travel_m, frequency_hz, duration_s;
};
/// A sum of sinusoids along one direction, which a program asks for; no block of a scene does.
struct MultiSineSpec {
  struct Wave {
    double amplitude_m, frequency_hz, phase_rad;
  };
  Numbers direction;  ///< of unit length
  std::vector<Wave> waves;
  double duration_s;
};
/// The hand of operator.recording, at its recorded positions.
struct RecordedHandSpec {
  std::shared_ptr<const RecordedHand> hand;
  double duration_s;
};
using SegmentSpec = std::variant<HoldSpec, MoveToSpec, SineSpec, ScrewSpec, MultiSineSpec, RecordedHandSpec>;
struct TremorSpec {
  double rms_m, low_hz, high_hz;
};
/// On the leader's last joint.
struct FingerSpec {
  double stiffness_n_per_m, damping_n_s_per_m;
  std::vector<SegmentSpec> path;  ///< of the opening
};
struct OperatorSpec {
  std::optional<HandSpec> hand;
  std::vector<SegmentSpec> path;
  std::optional<TremorSpec> tremor;
};

/// A box that fingers take.
struct ObjectSpec {
  double mass_kg;
  Eigen::Vector3d position_m, half_size_m, target_m;
  Material material;
};

/// A serial arm in place of a rigid body.
struct ArmSpec {
  std::shared_ptr<const ArmParameters> parameters;  ///< common/arm/parameters.h
  Numbers joint_position_rad;                       ///< when the run begins
  double null_space_stiffness_n_m_per_rad, null_space_damping_n_m_s_per_rad, joint_damping_n_m_s_per_rad;
  double tool_mass_kg;
  Numbers tool_center_m;
  double force_feedback_gain = 0.0, force_feedback_torque_gain = 0.0;  ///< of translation and rotation
  double force_feedback_cutoff_hz = 0.0;                               ///< 0: none
  Numbers joint_coulomb_friction_n_m{};                                ///< of each joint; empty: none
};

enum class VelocityEstimate : std::uint8_t { true_velocity, backward_difference, filtered };
struct DeviceSpec {
  double mass_kg, damping_n_s_per_m;
  Numbers position_m, velocity_m_per_s;
  double coulomb_friction_n, position_resolution_m;
  std::optional<double> max_force_n;
  VelocityEstimate velocity_estimate;
  double velocity_filter_hz;
  double inertia_kg_m2, rotational_damping_n_m_s_per_rad;  ///< the smallest where three are given
  Numbers principal_inertia_kg_m2{}, principal_rotational_damping_n_m_s_per_rad{};  ///< three each, or none
  double force_latency_s = 0.0;
  /// Mass and inertia are then its smallest effective ones at the handle when the run begins.
  std::optional<ArmSpec> arm{};
  std::vector<int> motors{};  ///< axes that display a force; empty: all
};

struct ForceSensorSpec {
  double noise_n;
  Numbers bias_n;
  double latency_s;
};
struct RobotSpec {
  double mass_kg, damping_n_s_per_m;
  Numbers position_m, velocity_m_per_s;
  std::optional<ForceSensorSpec> force_sensor;
  Numbers inertia_kg_m2;  ///< dof 6: three principal moments
  double rotational_damping_n_m_s_per_rad;
  std::optional<ArmSpec>
      arm{};  ///< mass and inertia are then its smallest effective ones at the tool when the run begins
  std::optional<Servo> servo{};  ///< mass, inertia and damping are then those of the body between coupling and servo
};

/// How the simulated world is stepped between two ticks.
enum class Integrator : std::uint8_t {
  exact,
  exact_per_tick,
  symplectic_euler,
  trapezoidal,
  velocity_verlet,
  rk4,
  dormand_prince
};
struct SimulationSpec {
  Integrator integrator = Integrator::exact;
  int substeps = 1;
  double tolerance_m = 1e-10;
};

struct Bound {
  std::string key;
  double value;
};
/// The verdict_kind that a run with a method must have.
struct MethodVerdict {
  std::string method, verdict_kind;
};
struct ExpectSpec {
  std::optional<bool> stable;
  std::vector<Bound> at_least, at_most;
  std::vector<MethodVerdict> of_method{};
};

/// The slave's clock against the master's.
struct ClockSpec {
  double offset_s = 0.0, drift = 0.0;  ///< s, s/s
};

struct Scene {
  std::string name, description;
  int dof = 0;              ///< of a port; kJointPort where its coordinates are joints
  int joints = 0;           ///< number of those; 0: the ports are handle and tool
  double duration_s = 0.0;  ///< infinity: until somebody ends it; live runs only
  double rate_hz = 0.0, master_rate_hz = 0.0, slave_rate_hz = 0.0;
  std::uint64_t seed = 0;
  std::optional<OperatorSpec> operator_model;
  std::optional<DeviceSpec> device;
  ControlOptions control;
  std::vector<ScheduledControl> schedule{};
  ImpairmentOptions to_slave, to_master;
  TransmissionOptions transmission_to_slave{}, transmission_to_master{};
  ClockSpec slave_clock{};
  std::optional<RobotSpec> robot;
  std::vector<EnvironmentSpec> environment;
  std::vector<Eigen::Vector3d>
      tool;  ///< contact points in tool axes; dof 6 only, one at the origin where none is given
  SimulationSpec simulation;
  ExpectSpec expect;
  DeviceMount device_mount{};
  RobotMount robot_mount{};
  /// The gripper's coupling as a scene of its own, with dof 1 and this scene's rates, seed, network and clocks. Null: none.
  std::shared_ptr<const Scene> gripper{};
  /// The message that it was read from; null: a program has made it.
  std::shared_ptr<const SceneSource> source{};
  std::optional<FingerSpec> finger{};  ///< of the operator; ports of joints only
  std::optional<ObjectSpec> object{};  ///< the same

  // Compiled once: what a copy does is long.
  Scene();
  Scene(const Scene&);
  Scene(Scene&&) noexcept;
  Scene& operator=(const Scene&);
  Scene& operator=(Scene&&) noexcept;
  ~Scene();

  /// Coordinates of a port that there are.
  [[nodiscard]] int coordinates() const { return joints > 0 ? joints : dof; }
  [[nodiscard]] int axes() const { return dof == 1 ? 1 : 3; }
};

/// As a scene writes it, e.g. "POSITION_FORCE".
std::string to_string(Architecture architecture);

}  // namespace twoport
