#pragma once

#include <Eigen/Core>
#include <vector>

namespace twoport::lab {

// Stability of a rigid body in contact at several points, rendered at the ticks: eigenvalues of the exactly discretised loop,
// linear about its equilibrium, which may be tilted; computed without the laboratory's code. SI units; the body's principal axes,
// which are the world's where it is not displaced; wrenches and twists at its centre of mass, translation first.

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// A body whose points touch a plane with normal n, each with a spring and damper on the backward difference, while a constant
/// force presses it on the plane; force and torque are held for a tick, d ticks late:
///
///     M v̇ = w - D v,   w(k) = -(K6 + B6/T) ξ(k-d) + (B6/T) ξ(k-d-1)
///     G_i = [1, -[r_i]x]
///     K6  = Σ G_iᵀ (K n nᵀ + k_t K (1 - n nᵀ)) G_i + K_geo        B6 = Σ G_iᵀ B n nᵀ G_i
///     K_geo (rotation, rotation) = Σ (f_i·r_i) 1 - r_i f_iᵀ       f_i: force of point i at the equilibrium
///
/// K_geo is what turning the forces' points of attack costs: for a patch a height h below the centre of mass under a press F0 it is
/// -F0 h, so that tilting needs K Σ x² > F0 h.
struct SampledContact {
  double mass_kg = 0.3;
  Eigen::Vector3d inertia_kg_m2 = {4e-4, 5e-4, 6e-4};
  double damping_n_s_per_m = 1.0;
  Eigen::Vector3d rotational_damping_n_m_s_per_rad = Eigen::Vector3d::Constant(2e-3);
  std::vector<Eigen::Vector3d> points_m;  ///< r_i, from the centre of mass, all on the plane
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double stiffness_n_per_m = 0.0;          ///< K of each point
  double contact_damping_n_s_per_m = 0.0;  ///< B of each point
  double tangential_ratio = 0.0;           ///< k_t; 0: frictionless
  double press_n = 5.0;                    ///< F0 at the centre of mass, against n
  double period_s = 5e-4;
  int delay_ticks = 0;
};

/// Force of each point at the equilibrium along n [N], and how far the body is displaced there: at no displacement all points are
/// just on the plane. Needs points that are not all on one line, unless the press acts between them.
struct ContactEquilibrium {
  std::vector<double> forces_n;
  Vector6 displacement;  ///< translation [m], rotation vector [rad]
};
ContactEquilibrium equilibrium(const SampledContact& contact);

/// K6, with K_geo of the equilibrium, and B6.
Matrix6 contact_stiffness(const SampledContact& contact);
Matrix6 contact_damping(const SampledContact& contact);

/// Largest |eigenvalue| from tick to tick. Directions that nothing holds (sliding, turning about the normal) have an eigenvalue 1,
/// which is left out.
double spectral_radius(const SampledContact& contact);

/// Largest stiffness of each point up to which the loop is stable, above the range in which the press tips the body over [N/m]; 0
/// if there is none. stiffness_n_per_m is ignored.
double critical_contact_stiffness(SampledContact contact);

/// Rule of small gains for each mode φ, good for small damping; the smallest of the modes' stiffnesses [N/m]:
///
///     φᵀ (D + B6) φ = (T/2 + d T) φᵀ K6 φ
double rule_contact_stiffness(const SampledContact& contact);

/// For B = 0, d = 0 and one mode of inertia J and damping c: the largest modal stiffness, exactly.
///
///     κ = c (1-e) / ((1-e) J/c - e T),   e = exp(-c T/J)
double critical_modal_stiffness(double inertia, double damping, double period_s);

/// A mode of the body on the contact without sampling.
struct ContactMode {
  Vector6 shape;               ///< φ, with φᵀ M φ = 1
  double frequency_rad_per_s;  ///< √(φᵀ K6 φ); 0: neutral; negative: tips over
};
std::vector<ContactMode> contact_modes(const SampledContact& contact);

}  // namespace twoport::lab
