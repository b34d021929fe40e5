#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/hardware/device.h"

namespace twoport {

/// One step of a probe: the reading along the first axis, and the push on the hand that it asks for [N].
struct ProbeTick {
  double t_s, x_m, v_m_per_s;
  double pushed_n;  ///< on the hand, held since the last tick
  HardwareStatus status;
};
/// Runs a phase: calls `step(tick)` once a period; it returns the push, or nothing to end the phase.
using ProbePhase = std::function<std::optional<double>(const ProbeTick&)>;
using ProbeRunner = std::function<void(const ProbePhase&)>;

struct ProbeOptions {
  double period_s = 1e-3;
  double push_n = 1.0;                                           ///< for mass and friction
  double most_push_n = std::numeric_limits<double>::infinity();  ///< of the device
  double kick_n = 0.5;                                           ///< before each wall
  double trial_s = 3.0;                                          ///< of a wall
  double quiet_s = 1.0;                                          ///< without force
  double most_speed_m_per_s = 1.0, most_way_m = 0.05;            ///< beyond it a phase is broken off
  double least_wall_n_per_m = 10.0, most_wall_n_per_m = 1e5, wall_tolerance = 0.05;
};

struct ProbeFigures {
  double rate_hz = 0.0;       ///< of new readings, in the loop's time; 0: fewer than two came
  double resolution_m = 0.0;  ///< 0: no step is seen
  // Only where the device may move; NaN: not measured.
  double latency_s = NAN;  ///< from a push to the first reading that has moved
  double mass_kg = NAN, damping_n_s_per_m = NAN, coulomb_friction_n = NAN;
  double fit = NAN;            ///< share of the impulse that these three explain
  double wall_n_per_m = NAN;   ///< stiffest spring that comes to rest after a kick
  bool wall_is_bound = false;  ///< the stiffest or softest one tried
  std::string broken_off;      ///< why a phase ended early; empty: none did
};

/// Measures a device along its first axis. Nobody holds it.
///
/// Mass m, damping b, friction c: constant pushes of changing sign; over windows of 10 ms in which push and direction of motion stay,
///
///     m Δv + b Δx + c sgn(v) W T = u W T      u: push on the hand, W: ticks of a window, T: period
///
/// by least squares with b, c >= 0. v: central difference over 10 ms; its error, (5 ms b/m)²/6 of v, is below 1e-3 for m/b above
/// 65 ms. Wall: the spring K (x - x0), held over a tick, without damping; K is bisected between walls that come to rest after a kick
/// and walls that do not. In theory K < 2 b/T (Colgate and Brown 1994).
class Probe {
 public:
  Probe(ProbeRunner run, const ProbeOptions& options) : run_{std::move(run)}, o_{options} {}

  /// Without force. Somebody may move the handle, which shows its resolution.
  void listen() {
    // Between the first and the last new reading: where the loop leaves ticks out, time goes on.
    int fresh = 0;
    double first_s = 0.0, last_s = 0.0;
    phase(o_.quiet_s, [&](const ProbeTick& t) {
      if (t.status != HardwareStatus::ok) return 0.0;
      if (fresh++ == 0) first_s = t.t_s;
      last_s = t.t_s;
      return 0.0;
    });
    if (fresh > 1) f_.rate_hz = (fresh - 1) / (last_s - first_s);
    judge_resolution();
  }

  /// With a quarter of the push, and so on, where it is too much.
  void push() {
    for (int trial = 0; trial < 3; ++trial, o_.push_n *= 0.25, o_.kick_n *= 0.25) {
      f_.broken_off.clear();
      push_once();
      if (f_.broken_off.empty() || f_.broken_off == kFault) return;
      const std::string why = std::exchange(f_.broken_off, {});
      settle();
      f_.broken_off = why;
    }
  }

  void wall() {
    double low = o_.least_wall_n_per_m, high = o_.most_wall_n_per_m;
    if (!f_.broken_off.empty()) return;
    if (const bool soft = !holds(low); soft || holds(high)) {
      f_.wall_n_per_m = soft ? low : high;
      f_.wall_is_bound = true;
      return;
    }
    while (high / low > 1.0 + o_.wall_tolerance) {
      const double middle = std::sqrt(low * high);
      (holds(middle) ? low : high) = middle;
    }
    f_.wall_n_per_m = low;
  }

  [[nodiscard]] const ProbeFigures& figures() const { return f_; }

 private:
  static constexpr const char* kFault = "the device reports a fault";

  void push_once() {
    std::vector<ProbeTick> record;
    const int pieces = 8;
    const double piece_s = 0.05;
    phase(pieces * piece_s, [&](const ProbeTick& t) {
      record.push_back(t);
      const auto piece = static_cast<int>(t.t_s / piece_s);
      // + - - + + - - +: it comes back to where it was. Every second pair with half of the push.
      const double sign = piece % 4 == 0 || piece % 4 == 3 ? 1.0 : -1.0;
      return sign * (piece < 4 ? 1.0 : 0.5) * o_.push_n;
    });
    fit(record);
    latency(record);
    judge_resolution();
  }

  /// Calls push(tick) for `seconds`, t_s counted from the begin.
  template <class Push>
  void phase(double seconds, Push push, bool limited = true) {
    std::optional<ProbeTick> first;
    double before = NAN;
    run_([&](const ProbeTick& now) -> std::optional<double> {
      if (!first) first = now;
      ProbeTick t = now;
      t.t_s -= first->t_s;
      if (t.status == HardwareStatus::fault) f_.broken_off = kFault;
      if (limited && !(std::abs(t.v_m_per_s) <= o_.most_speed_m_per_s)) f_.broken_off = "it was faster than allowed";
      if (limited && !(std::abs(t.x_m - first->x_m) <= o_.most_way_m)) f_.broken_off = "it left the way allowed";
      if (!f_.broken_off.empty() || t.t_s >= seconds - 0.5 * o_.period_s) return {};
      if (const double step = std::abs(t.x_m - before); step > 0.0 && std::isfinite(step)) steps_.push_back(step);
      before = t.x_m;
      return push(t);
    });
  }

  /// A step that all changes of position are multiples of.
  void judge_resolution() {
    if (steps_.size() < 20) return;
    const double least = *std::min_element(steps_.begin(), steps_.end());
    const bool all = std::all_of(steps_.begin(), steps_.end(), [&](double step) {
      const double multiple = step / least;
      return std::abs(multiple - std::round(multiple)) < 0.01 * std::max(1.0, 1e-3 * multiple);
    });
    f_.resolution_m = all ? least : 0.0;
  }

  void fit(const std::vector<ProbeTick>& record) {
    // Velocities from positions 5 ms before and after, which no filter of the device delays; the push stays meanwhile.
    const auto half = static_cast<std::size_t>(std::max(3L, std::lround(5e-3 / o_.period_s)));
    const std::size_t window = 2 * half;
    const auto velocity = [&](std::size_t k) {
      return (record[k + half].x_m - record[k - half].x_m) / (record[k + half].t_s - record[k - half].t_s);
    };
    std::vector<Eigen::Vector4d> rows;
    for (std::size_t i = half; i + window + half < record.size(); ++i) {
      const double moved = record[i + window].x_m - record[i].x_m, way = moved > 0.0 ? 1.0 : -1.0;
      bool one_way = moved != 0.0;
      for (std::size_t k = i - half + 1; k <= i + window + half; ++k)
        one_way = one_way && way * (record[k].x_m - record[k - 1].x_m) >= 0.0 &&
                  (k == i - half + 1 || record[k].pushed_n == record[k - 1].pushed_n);
      const double time = record[i + window].t_s - record[i].t_s;
      if (one_way)
        rows.push_back({velocity(i + window) - velocity(i), moved, way * time, record[i + 1].pushed_n * time});
    }
    if (rows.size() < 6) return;
    Eigen::MatrixXd system(rows.size(), 3);
    Eigen::VectorXd impulse(rows.size());
    for (std::size_t i = 0; i < rows.size(); ++i) {
      system.row(static_cast<Eigen::Index>(i)) = rows[i].head<3>().transpose();
      impulse[static_cast<Eigen::Index>(i)] = rows[i][3];
    }
    // Friction and damping take energy: what noise would make negative is none.
    Eigen::Vector3d found = system.colPivHouseholderQr().solve(impulse);
    for (const int i : {2, 1})
      if (found[i] < 0.0) {
        found.setZero();
        found.head(i) = system.leftCols(i).colPivHouseholderQr().solve(impulse);
      }
    f_.mass_kg = found[0];
    f_.damping_n_s_per_m = found[1];
    f_.coulomb_friction_n = found[2];
    f_.fit = 1.0 - (system * found - impulse).squaredNorm() / impulse.squaredNorm();
  }

  void latency(const std::vector<ProbeTick>& record) {
    if (record.size() < 2) return;
    for (const ProbeTick& t : record)
      if (std::abs(t.x_m - record.front().x_m) > 0.0) {
        f_.latency_s = t.t_s;
        return;
      }
  }

  /// Does the spring come to rest?
  bool holds(double stiffness) {
    if (!f_.broken_off.empty()) return false;
    const double kick_s = std::min(0.02, 0.1 * o_.trial_s);
    double origin = NAN, early = 0.0, late = 0.0;
    bool gone = false;
    phase(o_.trial_s, [&](const ProbeTick& t) {
      if (std::isnan(origin)) origin = t.x_m;
      const double x = t.x_m - origin;
      const double share = t.t_s / o_.trial_s;
      if (share > 0.1 && share < 0.4) early = std::max(early, std::abs(x));
      if (share > 0.7) late = std::max(late, std::abs(x));
      // Growing beyond anything that the kick can have done: let go.
      if (share > 0.4 && std::abs(x) > 4.0 * early + 1e-4) gone = true;
      if (gone) return -damper() * t.v_m_per_s;
      const double push = (t.t_s < kick_s ? o_.kick_n : 0.0) - stiffness * x;
      // An unstable wall that the device's largest force bounds neither rests nor grows.
      if (share > 0.4 && std::abs(push) > o_.most_push_n) gone = true;
      return std::clamp(push, -o_.most_push_n, o_.most_push_n);
    });
    const bool holds = !gone && f_.broken_off.empty() && (late < early || late == 0.0);
    // Of a wall that did not hold, the handle may still move: that is no reason to end.
    if (f_.broken_off != kFault) f_.broken_off.clear();
    settle();
    return holds;
  }
  /// Until it rests: a damper that every device holds.
  void settle() {
    phase(
        0.5, [&](const ProbeTick& t) { return -damper() * t.v_m_per_s; }, false);
  }

  [[nodiscard]] double damper() const {
    return std::min(0.2 * (f_.mass_kg > 0.0 ? f_.mass_kg : 0.05) / o_.period_s, 5.0);
  }

  ProbeRunner run_;
  ProbeOptions o_;
  ProbeFigures f_;
  std::vector<double> steps_;
};

}  // namespace twoport
