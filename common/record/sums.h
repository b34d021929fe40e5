#pragma once

// What a summary is made of besides counts of rows: sums and extremes of a run's rows. S: double, or a vector with a run in each lane
// (lab/lanes/). Numbers of rows are whole.

namespace twoport {

/// Of Metrics.
template <class S, int N>
struct MetricsSums {
  S min_energy, min_observed, min_two_port, min_robot;  ///< [J]
  S robot_force2, robot_speed2;                         ///< largest squares
  S owed, dissipated, corrected_ticks;                  ///< [J], [J], rows
  S drift2, position_error2, apart_rows, last_apart_row;
  S force_error2, correction2, force2, chatter2;  ///< sum, largest, largest, sum
  S wanted_rows, turned_rows, turn2_max, turn2;
};

/// Of ContactFigures.
template <class S>
struct ContactSums {
  S uncoupled, touching, free, quiet, muted, compared;  ///< rows
  S environment_force, error2, contact_turn2, free_force2, penetration2;
};

/// Of RunJudge: largest values.
template <class S, int N>
struct JudgeSums {
  S reach2, speed[2 * N], was_coupled;  ///< speeds of both sides, the master's first; 1: was
  S apart_at_end;                       ///< rows at the end in which the sides were not coupled
};

}  // namespace twoport
