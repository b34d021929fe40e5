#pragma once

#include <string_view>

#include "common/record/row.h"

namespace twoport {

/// A quantity of a recording: one column NAME, or for a vector one column for each coordinate, NAME_0, NAME_1, ...
struct Column {
  std::string_view name;
  std::string_view unit;             ///< of a number, or of the translational coordinates of a vector; empty: none
  std::string_view rotational_unit;  ///< of coordinates 3 to 5 of a vector with dof 6; empty: not a vector
};

/// Calls see(column, value) for each column of trace.csv, in order; `value` is a number or an Eigen vector of N numbers, of joints of as
/// many as there are: `size`.
/// This is the only list of columns; docs/reference/summary-and-trace.md explains them.
template <int N, class See>
void for_each_column(const Row<N>& row, See&& see, [[maybe_unused]] int size = N) {
  // Of joints the unit is that of those that turn; prismatic ones are in m, m/s and N.
  const auto vector = [](std::string_view name, std::string_view linear, std::string_view angular) {
    return Column{name, N == kJointPort ? angular : linear, angular};
  };
  const auto all = [&](const auto& v) {
    if constexpr (N == kJointPort) {
      return Eigen::Matrix<double, Eigen::Dynamic, 1, 0, N, 1>{v.head(size)};
    } else {
      return v;
    }
  };
  see(Column{"t_s", "s", ""}, row.t_s);
  see(vector("master_x", "m", "rad"), all(coordinates(row.master_x)));
  see(vector("master_v", "m/s", "rad/s"), all(row.master_v.vec()));
  see(vector("master_f", "N", "N m"), all(row.master_f.vec()));
  see(vector("master_f_wanted", "N", "N m"), all(row.master_f_wanted.vec()));
  see(vector("slave_x", "m", "rad"), all(coordinates(row.slave_x)));
  see(vector("slave_v", "m/s", "rad/s"), all(row.slave_v.vec()));
  see(vector("slave_f", "N", "N m"), all(row.slave_f.vec()));
  see(vector("env_f", "N", "N m"), all(row.env_f.vec()));
  see(Column{"master_energy_j", "J", ""}, row.master_energy_j);
  see(Column{"slave_energy_j", "J", ""}, row.slave_energy_j);
  see(Column{"observed_energy_j", "J", ""}, row.observed_energy_j);
  see(Column{"undissipated_j", "J", ""}, row.undissipated_j);
  see(Column{"dissipated_j", "J", ""}, row.dissipated_j);
  see(vector("position_error", "m", "rad"), all(row.position_error.vec()));
  see(Column{"mode", "", ""}, static_cast<double>(row.mode));
  if constexpr (N == kJointPort) see(Column{"object_x", "m", ""}, row.object.x);
  for (std::size_t i = 0; i < kLayerFigures.size(); ++i)
    if (N >= kLayerFigures[i].least_dof) see(Column{kLayerFigures[i].name, kLayerFigures[i].unit, ""}, row.figures[i]);
}

}  // namespace twoport
