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

/// Calls see(column, value) for each column of trace.csv, in order; `value` is a number or an Eigen vector of N numbers.
/// This is the only list of columns; docs/reference/summary-and-trace.md explains them.
template <int N, class See>
void for_each_column(const Row<N>& row, See&& see) {
  see(Column{"t_s", "s", ""}, row.t_s);
  see(Column{"master_x", "m", "rad"}, coordinates(row.master_x));
  see(Column{"master_v", "m/s", "rad/s"}, row.master_v.vec());
  see(Column{"master_f", "N", "N m"}, row.master_f.vec());
  see(Column{"master_f_wanted", "N", "N m"}, row.master_f_wanted.vec());
  see(Column{"slave_x", "m", "rad"}, coordinates(row.slave_x));
  see(Column{"slave_v", "m/s", "rad/s"}, row.slave_v.vec());
  see(Column{"slave_f", "N", "N m"}, row.slave_f.vec());
  see(Column{"env_f", "N", "N m"}, row.env_f.vec());
  see(Column{"master_energy_j", "J", ""}, row.master_energy_j);
  see(Column{"slave_energy_j", "J", ""}, row.slave_energy_j);
  see(Column{"observed_energy_j", "J", ""}, row.observed_energy_j);
  see(Column{"undissipated_j", "J", ""}, row.undissipated_j);
  see(Column{"dissipated_j", "J", ""}, row.dissipated_j);
  see(Column{"position_error", "m", "rad"}, row.position_error.vec());
  see(Column{"mode", "", ""}, static_cast<double>(row.mode));
  for (std::size_t i = 0; i < kLayerFigures.size(); ++i)
    if (N >= kLayerFigures[i].least_dof) see(Column{kLayerFigures[i].name, kLayerFigures[i].unit, ""}, row.figures[i]);
}

}  // namespace twoport
