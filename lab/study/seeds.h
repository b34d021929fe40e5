#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "common/record/figure.h"
#include "common/record/summary.h"

namespace twoport::lab {

/// Is the smallest value of a figure over several seeds the worst one? For these it is; of any other figure (errors,
/// deficits, chatter, forces, losses, delays) the largest is:
///
///     stable, min_*, *_min_energy_j, *_share but muted_share, held_force_ratio, contact_s, steps, duration_s,
///     environment_force_mean_n, packets.*.sent, packets.*.received
bool smallest_is_worst(std::string_view figure);

/// One figure over several seeds.
struct Spread {
  double mean;
  double sd;     ///< sample standard deviation, √(Σ (x - mean)² / (n - 1)); 0 for one seed
  double worst;  ///< see smallest_is_worst; NaN where one value is
};
/// All equal values give a mean equal to them and an sd of 0, to the bit.
Spread spread(std::string_view figure, std::span<const double> values);
Spread spread(const Figure& figure, std::span<const Summary> of_seeds);

/// Index of the worst seed, whose verdict is reported: an unstable seed before a stable one, then the smallest port
/// energy, then the first.
std::size_t worst_seed(const std::vector<Summary>& of_seeds);

}  // namespace twoport::lab
