#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "lab/study/table.h"

namespace twoport::lab {

/// Trajectory of a run, tick by tick, for comparison with another.
struct Course {
  std::vector<double> t_s;
  std::vector<double> master_x, slave_x, force;  ///< three numbers a tick [m], [m], [N] of the environment
  std::vector<double> energy_j;  ///< at the master port; of a robot alone the energy stored in it and its environment
};

/// Differences of two courses at common times, at most a nanosecond apart.
struct Difference {
  double position_rms_m, force_rms_n, force_max_n, energy_max_j;
};
Difference difference(const Course& a, const Course& b);

/// One variant of a scene: its cost and its error.
struct Point {
  std::string name, group;   ///< the varied values; the group in the picture
  bool peer = false;         ///< result of another engine
  double ns_per_tick = 0.0;  ///< median of interleaved repetitions
  double cost = 0.0;         ///< seconds per simulated second
  Difference error{};
  std::optional<double> boundary;  ///< where the verdict changes, when asked for
  std::string impossible;          ///< why it was not run; empty when it was
  std::string dominated_by;        ///< a point that is cheaper and no less accurate; empty on the front
};

/// The same scene computed by another engine, on the same axes.
struct Peer {
  std::string name;
  std::function<Course()> course;   ///< empty if it cannot run the scene
  std::function<double()> seconds;  ///< one timed run, without set-up [s]
};

struct ChartOptions {
  std::string scene;
  std::vector<std::string> set, vary;
  std::string boundary;  ///< PATH=LO:HI: also find where the verdict changes, for each point
  int repetitions = 7;
  int reference_substeps = 1000;
};

struct Chart {
  std::vector<Point> points;
  Difference floor{};              ///< of the reference: with half as many substeps
  std::optional<double> boundary;  ///< of the scene as written
  double rate_hz = 0.0;
};

/// Every combination of the varied values (integrators and substeps where none are given) against the unchanged scene
/// with Runge-Kutta 4 in many substeps, not an exact map; its error is that of a contact detected half a step late.
/// `heard` is called with what is run next and how long it takes yet, and with the time so far [s].
Chart chart(const ChartOptions& options, const std::vector<Peer>& peers = {},
            const std::function<void(const std::string&, double)>& heard = {});

/// Fills in dominated_by: front of cost against position error.
void find_front(std::vector<Point>& points);
/// Cheapest point with a position error of at most `error_m`; null when there is none. An error below the uncertainty
/// of the reference, `floor_m`, counts as that uncertainty.
const Point* cheapest(const std::vector<Point>& points, double error_m, double floor_m = 0.0);

/// Of each other engine that ran: the cheapest of our points whose position error is no larger, null when there is none.
struct EqualError {
  const Point *engine, *own;
  /// Cost of the engine over that of our point, > 1 where we are ahead; 0 without a point.
  [[nodiscard]] double ahead() const { return own == nullptr ? 0.0 : engine->cost / own->cost; }
};
std::vector<EqualError> beside_engines(const Chart& chart);

std::string to_text(const Chart& chart);
Table to_table(const Chart& chart);
Table to_table(const Chart& chart, const std::vector<EqualError>& engines);

}  // namespace twoport::lab
