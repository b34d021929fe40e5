#include "drivers/joint_velocity.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

// Velocities of a joint from encoder steps of 0.088 degrees, whose readings flutter by a quarter of a step.
namespace twoport::joint_velocity_test {
namespace {

constexpr double kStep = 2.0 * std::numbers::pi / 4096.0, kTurn = 2.0 * std::numbers::pi;

using Estimate = std::function<double(double x, double dt)>;
struct Estimator {
  std::string name;
  std::function<Estimate()> make;
};

/// Backward difference with a first-order low-pass.
Estimate low_pass(double cutoff_hz) {
  return [=, before = std::nan(""), v = 0.0](double x, double dt) mutable {
    if (!std::isnan(before)) v += -std::expm1(-kTurn * cutoff_hz * dt) * ((x - before) / dt - v);
    before = x;
    return v;
  };
}
/// Difference over `window_s` in steps of 0.229 rev/min, as a servo that differentiates by itself may state it.
Estimate of_servo(double window_s) {
  return [=, past = std::deque<double>{}](double x, double dt) mutable {
    past.push_front(x);
    if (static_cast<double>(past.size()) > window_s / dt + 1.5) past.pop_back();
    const double unit = 0.229 * kTurn / 60.0, span = static_cast<double>(past.size() - 1) * dt;
    return past.size() < 2 ? 0.0 : std::round((past.front() - past.back()) / span / unit) * unit;
  };
}
/// First-order adaptive windowing with the best fit (F. Janabi-Sharifi, V. Hayward, C.-S. J. Chen, IEEE Trans. Control Systems Technology
/// 8(6), 2000): the longest window, of at most `window_s`, whose regression line passes all readings within 1.5 steps.
Estimate adaptive_window(double window_s) {
  return [=, past = std::deque<double>{}](double x, double dt) mutable {
    past.push_front(x);
    if (static_cast<double>(past.size()) > window_s / dt + 1.5) past.pop_back();
    double v = 0.0;
    for (std::size_t n = 2; n <= past.size(); ++n) {
      const double middle = 0.5 * static_cast<double>(n - 1);
      double mean = 0.0, above = 0.0, below = 0.0;
      for (std::size_t i = 0; i < n; ++i) mean += past[i] / static_cast<double>(n);
      for (std::size_t i = 0; i < n; ++i) {
        const double t = middle - static_cast<double>(i);
        above += t * (past[i] - mean);
        below += t * t;
      }
      for (std::size_t i = 0; i < n; ++i)
        if (std::abs(mean + above / below * (middle - static_cast<double>(i)) - past[i]) > 1.5 * kStep) return v;
      v = above / below / dt;
    }
    return v;
  };
}
Estimate kalman(double acceleration) {
  return [filter = JointVelocity{kStep, acceleration}](double x, double dt) mutable { return filter.add(x, dt); };
}

class Encoder {
 public:
  double operator()(double x) { return std::round(x / kStep + flutter_(random_)) * kStep; }

 private:
  std::mt19937 random_{7};
  std::normal_distribution<double> flutter_{0.0, 0.25};
};

/// rms error over 10 s, at a speed.
double error(const Estimator& e, double rate_hz, double speed) {
  Estimate estimate = e.make();
  Encoder encoder;
  double squares = 0.0;
  const int ticks = static_cast<int>(10.5 * rate_hz), settled = static_cast<int>(0.5 * rate_hz);
  for (int k = 0; k < ticks; ++k) {
    const double v = estimate(encoder(0.3 * kStep + speed * k / rate_hz), 1.0 / rate_hz);
    if (k >= settled) squares += (v - speed) * (v - speed);
  }
  return std::sqrt(squares / (ticks - settled));
}
/// Lag of a sine of 2 Hz and 1 rad/s [s].
double lag(const Estimator& e, double rate_hz) {
  Estimate estimate = e.make();
  Encoder encoder;
  const double w = kTurn * 2.0;
  double sine = 0.0, cosine = 0.0;
  for (int k = 0; k < static_cast<int>(10.5 * rate_hz); ++k) {
    const double t = k / rate_hz, v = estimate(encoder(std::sin(w * t) / w), 1.0 / rate_hz);
    if (t < 0.5) continue;
    sine += v * std::sin(w * t);
    cosine += v * std::cos(w * t);
  }
  return std::atan2(sine, cosine) / w;
}
struct Coupled {
  double chatter, speed_at_rest;  ///< [rad/s²], [rad/s]
};
/// A joint of 1 kg m² at a virtual spring of 1000 N m/rad and `damping` [N m s/rad], whose torque is held and comes one period late, as over a
/// bus. The spring's end moves at 0.1 rad/s for 3 s and rests. Chatter: rms of the torque above 30 Hz.
Coupled coupled(const Estimator& e, double rate_hz, double damping) {
  constexpr int kParts = 20;
  Estimate estimate = e.make();
  Encoder encoder;
  const double T = 1.0 / rate_hz;
  double x = 0.01, v = 0.0, held = 0.0, next = 0.0, slow = 0.0, squares = 0.0, fastest = 0.0;
  int counted = 0;
  for (int k = 0; k < static_cast<int>(6.0 * rate_hz); ++k) {
    const double t = k * T, z = encoder(x), end = 0.1 * std::min(t, 3.0), end_v = t < 3.0 ? 0.1 : 0.0;
    held = next;
    next = -1000.0 * (z - end) - damping * (estimate(z, T) - end_v);
    for (int i = 0; i < kParts; ++i) x += T / kParts * (v += T / kParts * held);
    if (!(std::abs(v) < 50.0)) return {1e9, 1e9};
    slow += -std::expm1(-kTurn * 30.0 * T) * (held - slow);
    if (t > 1.0) squares += (held - slow) * (held - slow), ++counted;
    if (t > 4.0) fastest = std::max(fastest, std::abs(v));
  }
  return {std::sqrt(squares / counted), fastest};
}
/// Largest damping, in that of the coupling, at which the joint comes to rest.
double margin(const Estimator& e, double rate_hz) {
  double most = 0.0;
  for (double factor = 0.5; factor < 40.0 && coupled(e, rate_hz, 40.0 * factor).speed_at_rest < 0.1; factor *= 1.05)
    most = factor;
  return most;
}

const std::vector<Estimator> kAll{{"difference, low-pass 20 Hz", [] { return low_pass(20.0); }},
                                  {"difference, low-pass 80 Hz", [] { return low_pass(80.0); }},
                                  {"servo, over 16 ms", [] { return of_servo(0.016); }},
                                  {"adaptive window, 16 ms", [] { return adaptive_window(0.016); }},
                                  {"adaptive window, 32 ms", [] { return adaptive_window(0.032); }},
                                  {"Kalman, 3 rad/s2", [] { return kalman(3.0); }},
                                  {"Kalman, 10 rad/s2", [] { return kalman(10.0); }},
                                  {"Kalman, 30 rad/s2", [] { return kalman(30.0); }}};

/// The table of docs/guides/low-cost-arms.md. What the drivers use chatters least of those that let the joint come to rest with the coupling's
/// damping at every rate.
TEST(JointVelocity, ChattersLeastOfWhatHoldsTheCoupling) {
  const std::vector<double> rates{200.0, 500.0, 1000.0};
  std::vector<double> chatter_of(kAll.size());
  std::vector<bool> holds(kAll.size(), true);
  for (const double rate_hz : rates) {
    std::printf("%4.0f Hz                     rest  0.1  1 rad/s [mrad/s]  lag [ms]  chatter [rad/s2]  damping <=\n",
                rate_hz);
    for (std::size_t i = 0; i < kAll.size(); ++i) {
      const double chatter = coupled(kAll[i], rate_hz, 40.0).chatter, most = margin(kAll[i], rate_hz);
      std::printf("%-27s %5.0f %5.0f %5.0f %18.1f %14.2f %14.2f\n", kAll[i].name.c_str(),
                  1e3 * error(kAll[i], rate_hz, 0.0), 1e3 * error(kAll[i], rate_hz, 0.1),
                  1e3 * error(kAll[i], rate_hz, 1.0), 1e3 * lag(kAll[i], rate_hz), chatter, most);
      chatter_of[i] = std::max(chatter_of[i], chatter);
      if (most < 1.0) holds[i] = false;
    }
  }
  std::size_t best = kAll.size();
  for (std::size_t i = 0; i < kAll.size(); ++i)
    if (holds[i] && (best == kAll.size() || chatter_of[i] < chatter_of[best])) best = i;
  ASSERT_LT(best, kAll.size());
  EXPECT_EQ(kAll[best].name, "Kalman, 10 rad/s2");
  EXPECT_EQ(JointVelocity::kAcceleration, 10.0);
}

TEST(JointVelocity, IsExactOnARampAndZeroAtRest) {
  JointVelocity v{kStep};
  for (int k = 0; k < 1000; ++k) v.add(0.5 + 0.002 * k, 0.002);
  EXPECT_NEAR(v.add(0.5 + 0.002 * 1000, 0.002), 1.0, 1e-9);
  double rest = 1.0;
  for (int k = 0; k < 1000; ++k) rest = v.add(2.5, 0.002);
  EXPECT_NEAR(rest, 0.0, 1e-9);
  EXPECT_EQ(v.add(9.0, 0.0), rest) << "without time nothing is learnt";
}

}  // namespace
}  // namespace twoport::joint_velocity_test
