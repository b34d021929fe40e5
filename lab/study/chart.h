#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "lab/study/table.h"

namespace twoport::lab {

struct HostedRobot;
enum class VerdictFrom : unsigned char;

/// Trajectory of a run, tick by tick, for comparison with another.
struct Course {
  std::vector<double> t_s;
  std::vector<double> master_x, slave_x, force;  ///< three numbers a tick [m], [m], [N] of the environment
  std::vector<double> felt;      ///< three numbers a tick [N], at the hand; of a robot alone the environment's
  std::vector<double> energy_j;  ///< at the master port; of a robot alone the energy stored in it and its environment
};

/// Differences of two courses at common times, at most a nanosecond apart.
struct Difference {
  double position_rms_m, force_rms_n, force_max_n, energy_max_j, felt_rms_n;
};
Difference difference(const Course& a, const Course& b);

/// What a person asks a run for: the verdict, the force felt and, where one is searched for, the boundary; beside the reference's.
struct Answer {
  std::string verdict;           ///< its kind
  bool same_verdict = false;     ///< as the reference's
  double felt = 0.0;             ///< rms of the difference of the force felt, as a share of the rms of the reference's
  std::optional<double> beside;  ///< of the boundary, as a share of the reference's

  /// The largest share; infinite with another verdict.
  [[nodiscard]] double off() const;
};

/// One variant of a scene: its cost and its error.
struct ChartPoint {
  std::string name, group;   ///< the varied values; the group in the picture
  std::string from{};        ///< what the verdict is made from, where that is varied: tail, lean or plain
  bool peer = false;         ///< result of another engine
  double ns_per_tick = 0.0;  ///< median of interleaved repetitions
  double cost = 0.0;         ///< seconds per simulated second; of an answer the processor time for all of it [s]
  double off = 0.0;          ///< what is charted over it: the position error [m]; of an answer Answer::off()
  Difference error{};
  std::optional<Answer> answer;    ///< when asked for
  std::optional<double> boundary;  ///< where the verdict changes, when asked for
  std::string impossible;          ///< why it was not run; empty when it was
  std::string dominated_by;        ///< a point that is cheaper and no less accurate; empty on the front

  /// It ran, and what it answers is not wrong.
  [[nodiscard]] bool counts() const;
};

/// The same scene computed by another engine, on the same axes.
struct Peer {
  std::string name;
  std::function<Course()> course{};   ///< empty if it cannot run the scene
  std::function<double()> seconds{};  ///< one timed run, without set-up [s]
  /// One run with set-up, and on for its verdict as our runs: the kind.
  std::function<std::string(VerdictFrom)> verdict{};
  /// Not null: this is the robot of the scene and its world, in the loop of the laboratory, and none of the functions is called.
  std::shared_ptr<const HostedRobot> robot{};
};

struct ChartOptions {
  std::string scene;
  std::vector<std::string> set, vary;  ///< with `answer` an axis of `vary` may be verdict=tail,lean,plain
  std::string boundary;                ///< PATH=LO:HI: also find where the verdict changes, for each point
  bool answer = false;                 ///< compare whole answers
  int repetitions = 7;
  int reference_substeps = 1000;
};

struct Chart {
  std::vector<ChartPoint> points;
  Difference floor{};              ///< of the reference: with half as many substeps
  double floor_off = 0.0;          ///< the same of what is charted
  std::string verdict;             ///< of the reference, where answers are compared
  double felt_n = 0.0;             ///< rms of the reference's force felt
  std::optional<double> boundary;  ///< of the reference where answers are compared, else of the scene as written
  double rate_hz = 0.0;
};

/// Every combination of the varied values (integrators and substeps where none are given) against the unchanged scene
/// with Runge-Kutta 4 in many substeps, not an exact map; its error is that of a contact detected half a step late.
/// With `answer` cost and error are those of the whole answer: a run that is as far as its verdict, and the search for the boundary.
/// `heard` is called with what is run next and how long it takes yet, and with the time so far [s].
Chart chart(const ChartOptions& options, const std::vector<Peer>& peers = {},
            const std::function<void(const std::string&, double)>& heard = {});

/// Fills in dominated_by: front of cost against error. A point that does not count is neither on it nor before it. An error below the
/// uncertainty of the reference, `floor`, counts as that uncertainty, here and below.
void find_front(std::vector<ChartPoint>& points, double floor = 0.0);
/// Cheapest point of those that `may` with an error of at most `error`; null when there is none.
const ChartPoint* cheapest(const std::vector<ChartPoint>& points, double error, double floor = 0.0,
                           const std::function<bool(const ChartPoint&)>& may = {});

/// Of each other engine that ran: the cheapest of our points with a verdict made alike whose error is no larger, null when there is none.
struct EqualError {
  const ChartPoint *engine, *own;
  /// Cost of the engine over that of our point, > 1 where we are ahead; 0 without a point.
  [[nodiscard]] double ahead() const { return own == nullptr ? 0.0 : engine->cost / own->cost; }
};
std::vector<EqualError> beside_engines(const Chart& chart);

/// "RK4, 1 substep, 44.9 ns a tick, 4.3e-07 m"; of an answer "EXACT, 0.31 ms, STABLE, off by 2.1e-05".
std::string told(const Chart& chart, const ChartPoint& point);
std::string to_text(const Chart& chart);
Table to_table(const Chart& chart);
Table to_table(const Chart& chart, const std::vector<EqualError>& engines);

}  // namespace twoport::lab
