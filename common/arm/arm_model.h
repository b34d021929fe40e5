#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <iterator>
#include <vector>

#include "common/arm/parameters.h"

namespace twoport {

/// A rigid tool beyond the flange: mass, centre of mass and inertia about it, in tool axes.
struct ArmTool {
  double mass_kg = 0.0;
  Eigen::Vector3d center_m = Eigen::Vector3d::Zero();
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();  ///< [kg m²]
};

/// Kinematics and dynamics of a serial arm with 1 to 8 revolute and prismatic joints. Every formula in axes of the base, moments
/// about its origin, so that velocities, momenta and composite inertias of links add without rotations. Nothing allocates.
///
///     τ = M(q) q̈ + c(q, q̇) + g(q)           M includes the rotors' inertias, as a diagonal
///     V = J(q) q̇                             V of the tool's origin: translation first, axes of the base
///
/// Inverse dynamics by Newton-Euler, inertia matrix by composite bodies (R. Featherstone, Rigid Body Dynamics Algorithms,
/// 2008, chapters 5 and 6), forward dynamics by a Cholesky factorisation of M.
class ArmModel {
 public:
  static constexpr int kMost = kMostArmJoints;
  using Joints = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMost, 1>;
  using Inertia = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMost, kMost>;
  using Jacobian = Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, kMost>;
  using Vector6 = Eigen::Matrix<double, 6, 1>;

  /// Where everything is at q.
  struct Pose {
    std::array<Eigen::Matrix3d, kMost> rotation;  ///< base from link
    std::array<Eigen::Vector3d, kMost> origin;    ///< of the link's frame
    /// Velocity of the link against the one before, for a joint velocity of 1: angular, and of its point at the base's origin.
    std::array<Eigen::Vector3d, kMost> axis, moment;
    Eigen::Matrix3d tool_rotation;  ///< base from tool
    Eigen::Vector3d tool;           ///< the tool's origin [m]
  };

  /// The tool's frame is turned against the flange's by `tool_rotation` (flange from tool).
  explicit ArmModel(const ArmParameters& arm, const ArmTool& tool = {},
                    const Eigen::Matrix3d& tool_rotation = Eigen::Matrix3d::Identity());

  /// Is the last joint a gripper of two fingers, at ±q along its axis from the tool?
  [[nodiscard]] bool has_fingers() const noexcept { return fingers_; }
  /// Number of joints.
  [[nodiscard]] int size() const noexcept { return static_cast<int>(joints_); }
  /// Of the joints that move the tool.
  [[nodiscard]] int arm_joints() const noexcept { return size() - (fingers_ ? 1 : 0); }

  [[nodiscard]] Pose pose(const Joints& q) const noexcept;

  /// Of the tool's origin: [m/s] and [rad/s] per [rad/s]; of a prismatic joint per [m/s].
  [[nodiscard]] Jacobian jacobian(const Pose& p) const noexcept;
  /// J̇ q̇: acceleration of the tool's origin at q̈ = 0.
  [[nodiscard]] Vector6 bias_acceleration(const Pose& p, const Joints& v) const noexcept;

  /// τ for q̈ under gravity g [m/s²], an acceleration, in axes of the base.
  [[nodiscard]] Joints inverse_dynamics(const Pose& p, const Joints& v, const Joints& acceleration,
                                        const Eigen::Vector3d& gravity) const noexcept;
  /// c(q, q̇) + g(q), of which c is zero at rest.
  [[nodiscard]] Joints bias_torque(const Pose& p, const Joints& v, const Eigen::Vector3d& gravity) const noexcept {
    return inverse_dynamics(p, v, Joints::Zero(size()), gravity);
  }
  /// g(q): what holds the arm at rest.
  [[nodiscard]] Joints gravity_torque(const Pose& p, const Eigen::Vector3d& gravity) const noexcept;

  /// M(q), by composite bodies.
  [[nodiscard]] Inertia inertia(const Pose& p) const noexcept;

  /// q̈ under joint torques.
  [[nodiscard]] Joints forward_dynamics(const Pose& p, const Joints& v, const Joints& torque,
                                        const Eigen::Vector3d& gravity) const noexcept;

  /// ½ q̇ᵀ M q̇ - Σ m g·c [J]
  [[nodiscard]] double energy(const Pose& p, const Joints& v, const Eigen::Vector3d& gravity) const noexcept;

 private:
  struct Link {
    Eigen::Matrix3d rotation;  ///< link before from this one, at joint position 0
    Eigen::Vector3d origin;    ///< in axes of the link before, at joint position 0
    double mass;
    Eigen::Vector3d center;
    Eigen::Matrix3d inertia;  ///< about the centre, in its axes
    double rotor;
    bool slides;  ///< its joint is prismatic
  };

  std::size_t joints_;
  std::array<Link, kMost> links_;
  Eigen::Matrix3d tool_rotation_;  ///< last link from tool
  Eigen::Vector3d tool_;           ///< in axes of the last link, with fingers at joint position 0
  bool fingers_;
};

/// M = L D Lᵀ, L lower triangular with a diagonal of 1, D diagonal.
class InertiaFactors {
 public:
  InertiaFactors() = default;
  explicit InertiaFactors(const ArmModel::Inertia& M) noexcept;
  /// M⁻¹ b
  [[nodiscard]] ArmModel::Joints solve(const ArmModel::Joints& b) const noexcept;
  /// M⁻¹
  [[nodiscard]] ArmModel::Inertia inverse() const noexcept;
  /// J M⁻¹ Jᵀ
  [[nodiscard]] Eigen::Matrix<double, 6, 6> mobility(const ArmModel::Jacobian& J) const noexcept;

 private:
  ArmModel::Inertia lower_;   ///< L below the diagonal
  ArmModel::Joints inverse_;  ///< D⁻¹
};

/// Of numbers, one a joint.
inline ArmModel::Joints joint_vector(const std::vector<double>& numbers) noexcept {
  return ArmModel::Joints::Map(numbers.data(), std::ssize(numbers));
}

/// J M⁻¹ Jᵀ, the inverse of the inertia felt at the tool [1/kg], [1/(kg m²)].
Eigen::Matrix<double, 6, 6> tool_mobility(const ArmModel& arm, const ArmModel::Joints& q) noexcept;

/// Of a symmetric matrix.
inline double largest_eigenvalue(const Eigen::Matrix3d& symmetric) noexcept {
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>{symmetric, Eigen::EigenvaluesOnly}.eigenvalues()[2];
}

}  // namespace twoport
