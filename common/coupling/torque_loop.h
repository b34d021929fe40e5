#pragma once

#include <cmath>
#include <numbers>

namespace twoport {

/// The master's local spring of full rank (CONTACT_SPRING): t K_r about the axes, beside the delayed wrench through the low pass LP_a.
struct LocalSpring {
  static constexpr double kTurn = 0.1;  ///< t
  /// a = 0.1 s + R/2 [s]
  static constexpr double filter_s(double round_trip_s) { return 0.1 + 0.5 * round_trip_s; }
};

/// A tool on a surface, about one axis: stiffnesses [N m/rad] and inertia [kg m²].
struct TorqueLoop {
  double contact;   ///< K_t, the surface's at the tool's points
  double coupling;  ///< K_r, the slave's, in the master's units
  double hand;      ///< K_h
  double inertia;   ///< J, of hand and handle

  /// Does the delayed torque die out by itself over a round trip of R seconds? Where the loop's phase is that of a growing swing,
  ///
  ///     (K* - t K_r) |LP_a(jω)| < K_h + t K_r - J ω²,    ω R + atan(ω a) = π,    K* = K_t K_r/(K_t + K_r)
  ///
  /// R = 0: yes.
  [[nodiscard]] bool dies_out(double round_trip_s) const {
    if (!(round_trip_s > 0.0)) return true;
    const double a = LocalSpring::filter_s(round_trip_s);
    double low = 0.0, high = std::numbers::pi / round_trip_s;
    for (int i = 0; i < 60; ++i) {
      const double middle = 0.5 * (low + high);
      (middle * round_trip_s + std::atan(middle * a) < std::numbers::pi ? low : high) = middle;
    }
    const double local = LocalSpring::kTurn * coupling, both = contact * coupling / (contact + coupling);
    return (both - local) / std::hypot(1.0, low * a) < hand + local - inertia * low * low;
  }
};

}  // namespace twoport
