#pragma once

#include <string>
#include <vector>

#include "tests/theory/sampled_contact.h"

namespace twoport::test {

/// Corners of a box of 60 x 40 mm whose centre of mass is `h` above them and `x` beside their centre.
inline std::vector<Eigen::Vector3d> corners(double x, double h) {
  return {{x + 0.03, 0.02, -h}, {x + 0.03, -0.02, -h}, {x - 0.03, 0.02, -h}, {x - 0.03, -0.02, -h}};
}

struct ContactCase {
  std::string name;
  lab::SampledContact contact;
  double known_n_per_m;   ///< of each contact, at the boundary
  bool symmetric = true;  ///< about both horizontal axes
};

/// Published cases: m = 0.3 kg, J = (4, 5, 6)e-4 kg m², b = 1 N s/m, c = 2e-3 N m s, a press of 5 N at 2 kHz.
inline std::vector<ContactCase> contact_cases() {
  using lab::SampledContact;
  SampledContact a;
  a.points_m = corners(0.0, 0.01);
  const auto pitch_first = [](SampledContact c, double b) {
    c.damping_n_s_per_m = b;
    c.rotational_damping_n_m_s_per_rad = {2e-2, 2e-3, 2e-2};
    return c;
  };
  const auto roll_first = [](SampledContact c, double b) {
    c.damping_n_s_per_m = b;
    c.rotational_damping_n_m_s_per_rad = {2e-3, 2e-2, 2e-2};
    return c;
  };
  SampledContact eight = a;
  for (const Eigen::Vector3d& p : {Eigen::Vector3d{0.03, 0, -0.01}, Eigen::Vector3d{-0.03, 0, -0.01},
                                   Eigen::Vector3d{0, 0.02, -0.01}, Eigen::Vector3d{0, -0.02, -0.01}})
    eight.points_m.push_back(p);
  SampledContact damped = a;
  damped.contact_damping_n_s_per_m = 2.0;
  SampledContact aside = a;
  aside.points_m = corners(0.012, 0.01);
  SampledContact aside_damped = aside;
  aside_damped.contact_damping_n_s_per_m = 2.0;
  SampledContact tall = a;
  tall.points_m = corners(0.0, 0.06);
  tall.tangential_ratio = 0.5;
  SampledContact late = a;
  late.delay_ticks = 1;
  SampledContact light = pitch_first(damped, 50.0);
  light.inertia_kg_m2 *= 0.1;
  light.rotational_damping_n_m_s_per_rad.y() = 2e-4;
  return {{"A heave", a, 1000.28},
          {"A pitch first", pitch_first(a, 10.0), 2236.85},
          {"A roll first", roll_first(a, 10.0), 5033.33},
          {"B heave", eight, 500.14},
          {"B pitch first", pitch_first(eight, 10.0), 1491.23},
          {"C heave", damped, 8883.36},
          {"C pitch first", pitch_first(damped, 50.0), 10166.2},
          {"C roll first", roll_first(damped, 50.0), 12984.8},
          {"D heave and pitch coupled", aside, 901.90, false},
          {"E the same, damped", aside_damped, 8768.20, false},
          {"F tall tool that sticks", tall, 601.93},
          {"G heave, a tick late", late, 333.49},
          {"G pitch first, a tick late", pitch_first(late, 10.0), 755.04},
          {"H light wrist, pitch first", light, 7667.79}};
}

}  // namespace twoport::test
