#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <random>
#include <string>

#include "sim/plant/integrators.h"

namespace twoport::sim::linear_test {
namespace {

// The yardstick is the closed form in 80-bit numbers: what cancels in it still leaves 1e-15 of the state.
using Real = long double;
using Complex = std::complex<Real>;

struct Load {
  double u0, u1;
};
struct Exact {
  Real x, v;
};

/// m ẍ = u0 + u1 h - c ẋ - k x, as the textbook solves it: a particular solution and the roots of m r² + c r + k.
Exact closed_form(const Oscillator& o, AxisState s, Load u, double h) {
  const Real m = o.mass_kg, c = o.damping_n_s_per_m, k = o.stiffness_n_per_m, t = h, x0 = s.x, v0 = s.v, u0 = u.u0,
             u1 = u.u1;
  if (k == 0 && c == 0)
    return {x0 + v0 * t + u0 * t * t / (2 * m) + u1 * t * t * t / (6 * m), v0 + u0 * t / m + u1 * t * t / (2 * m)};
  if (k == 0) {
    const Real a = c / m, gone = -std::expm1(-a * t);  // 1 - exp(-a t)
    const Real v_inf = u0 / c - u1 / (a * c);          // v = v_inf + u1 t / c + (v0 - v_inf) exp(-a t)
    return {x0 + v_inf * t + u1 * t * t / (2 * c) + (v0 - v_inf) * gone / a,
            v_inf + u1 * t / c + (v0 - v_inf) * (1 - gone)};
  }
  const auto particular = [&](Real at) { return (u0 + u1 * at) / k - c * u1 / (k * k); };
  const Real y0 = x0 - particular(0), w0 = v0 - u1 / k;
  const Real square = c * c - 4 * m * k;
  if (square == 0) {
    const Real r = -c / (2 * m), e = std::exp(r * t), slope = w0 - r * y0;
    return {particular(t) + (y0 + slope * t) * e, u1 / k + (slope + r * (y0 + slope * t)) * e};
  }
  const Complex root = std::sqrt(Complex{square});
  const Complex r1 = (-c + root) / (2 * m), r2 = (-c - root) / (2 * m);
  const Complex a = (w0 - r2 * y0) / (r1 - r2), b = (r1 * y0 - w0) / (r1 - r2);
  const Complex e1 = std::exp(r1 * t), e2 = std::exp(r2 * t);
  return {particular(t) + (a * e1 + b * e2).real(), u1 / k + (r1 * a * e1 + r2 * b * e2).real()};
}

/// Each of x and v against the closed form, relative to itself or, where it passes through zero, to what it swings by
/// within h.
void expect_equal(const AxisState& is, const Exact& should_be, double h, double relative, const std::string& what) {
  const double x = static_cast<double>(should_be.x), v = static_cast<double>(should_be.v);
  EXPECT_NEAR(is.x, x, relative * std::max(std::abs(x), std::abs(v) * h)) << what;
  EXPECT_NEAR(is.v, v, relative * std::max(std::abs(v), std::abs(x) / h)) << what;
}

constexpr double kRelative = 1e-12;  // 3e-14 is reached; the yardstick itself cancels at c T/m = 20
constexpr double kPeriod = 5e-4;

struct Case {
  const char* name;
  Oscillator o;
  double h;
};
void PrintTo(const Case& c, std::ostream* out) {
  *out << c.name;
}

class Propagate : public ::testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Of, Propagate,
                         ::testing::Values(Case{"AFreeMass", {0.075, 0, 0}, kPeriod},          //
                                           Case{"ADampedMass", {0.075, 0.5, 0}, kPeriod},      //
                                           Case{"AnUndampedSpring", {0.1, 0, 5000}, kPeriod},  //
                                           Case{"AnUndampedSpringThatTurnsThrice", {0.1, 0, 4e6}, 3e-3},
                                           Case{"AnUnderdampedSpring", {0.1, 3, 300}, kPeriod},  //
                                           Case{"ACriticallyDampedSpring", {0.25, 2, 4}, 0.1},   //
                                           Case{"ACriticallyDampedStiffSpring", {0.25, 512, 262144}, kPeriod},
                                           Case{"AnOverdampedSpring", {0.075, 40, 1000}, kPeriod},  //
                                           Case{"AStiffDamper", {0.075, 3000, 0}, kPeriod},         // c T / m = 20
                                           Case{"AStiffDamperOnASpring", {0.075, 3000, 5000}, kPeriod},
                                           Case{"ALongStep", {0.5, 1, 50}, 1.0}),
                         [](const auto& instance) { return std::string{instance.param.name}; });

TEST_P(Propagate, EqualsTheClosedForm) {
  const auto& [name, o, h] = GetParam();
  std::mt19937_64 random{20240611};
  std::uniform_real_distribution<double> unit{-1.0, 1.0};
  for (int i = 0; i < 1000 && !HasFailure(); ++i) {
    const AxisState s{0.05 * unit(random), unit(random)};
    const Load u{10.0 * unit(random), 5.0 * unit(random) / h};
    expect_equal(propagate(o, s, u.u0, u.u1, h), closed_form(o, s, u, h), h, kRelative, "sample " + std::to_string(i));
  }
}

TEST_P(Propagate, TwiceIsOnceForTheSum) {
  const auto& [name, o, h] = GetParam();
  std::mt19937_64 random{20240612};
  std::uniform_real_distribution<double> unit{-1.0, 1.0};
  for (int i = 0; i < 1000 && !HasFailure(); ++i) {
    const AxisState s{0.05 * unit(random), unit(random)};
    const Load u{10.0 * unit(random), 5.0 * unit(random) / h};
    const double first = h * 0.5 * (1.0 + unit(random));
    const AxisState middle = propagate(o, s, u.u0, u.u1, first);
    const AxisState whole = propagate(o, s, u.u0, u.u1, h),
                    parts = propagate(o, middle, u.u0 + u.u1 * first, u.u1, h - first);
    // A part that is fast and dies away, as of a stiff damper, leaves its rounding in what is slow.
    const double scale_x = std::max({std::abs(s.x), std::abs(middle.x), std::abs(whole.x), std::abs(s.v) * h});
    const double scale_v = std::max({std::abs(s.v), std::abs(middle.v), std::abs(whole.v), std::abs(s.x) / h});
    EXPECT_NEAR(parts.x, whole.x, kRelative * scale_x) << "sample " << i;
    EXPECT_NEAR(parts.v, whole.v, kRelative * scale_v) << "sample " << i;
  }
}

TEST_P(Propagate, BackwardsUndoesForwards) {
  const auto& [name, o, h] = GetParam();
  const double growth = std::exp(o.damping_n_s_per_m / o.mass_kg * h);  // of errors, on the way back
  const AxisState s{0.01, -0.3};
  const double u0 = 4.0, u1 = 3.0 / h;
  const AxisState there = propagate(o, s, u0, u1, h), back = propagate(o, there, u0 + u1 * h, u1, -h);
  const double scale = std::max({std::abs(s.v), std::abs(there.v), std::abs(there.x) / h});
  EXPECT_NEAR(back.x, s.x, kRelative * growth * scale * h);
  EXPECT_NEAR(back.v, s.v, kRelative * growth * scale);
}

TEST_P(Propagate, IsWhatTheSixNumbersOfAResponseSay) {
  const Oscillator o = GetParam().o;
  const double h = GetParam().h;
  const Response r{o, h};
  const auto column = [&](AxisState s, Load u, double x, double v, const char* which) {
    expect_equal({x, v}, closed_form(o, s, u, h), h, kRelative, which);
  };
  column({0, 1}, {0, 0}, r.xv, r.vv, "per initial velocity");
  column({0, 0}, {1, 0}, r.xu, r.vu, "per held force");
  column({0, 0}, {0, 1}, r.xw, r.vw, "per slope of force");

  // From anywhere, in displacement from there.
  const AxisState s{0.03, 0.2};
  const Load u{2.0, -1.0 / h};
  const double u0 = u.u0 - o.stiffness_n_per_m * s.x;
  expect_equal({s.x + r.xv * s.v + r.xu * u0 + r.xw * u.u1, r.vv * s.v + r.vu * u0 + r.vw * u.u1},
               closed_form(o, s, u, h), h, kRelative, "together");
}

TEST(PropagateForAMoment, KeepsItsLeadingTerms) {
  // Where contact begins: any closed form with exponentials has lost all digits here.
  const Oscillator o{0.1, 3.0, 5000.0};
  const double h = 1e-12, a = o.damping_n_s_per_m / o.mass_kg * h;  // the spring is felt at (ωh)² = 5e-20
  const Response r{o, h};
  const auto same = [](double is, double should_be) { EXPECT_NEAR(is, should_be, kRelative * should_be); };
  same(r.xv, h * (1.0 - a / 2));
  same(r.vv, 1.0 - a);
  same(r.xu, h * h / (2 * o.mass_kg) * (1.0 - a / 3));
  same(r.vu, h / o.mass_kg * (1.0 - a / 2));
  same(r.xw, h * h * h / (6 * o.mass_kg) * (1.0 - a / 4));
  same(r.vw, h * h / (2 * o.mass_kg) * (1.0 - a / 3));
}

TEST(PropagateForLong, KeepsTheEnergyOfAnUndampedSpring) {
  // A million steps of 0.11 rad. A symplectic step would keep it to 1e-3, and lose the phase.
  const Oscillator o{0.1, 0.0, 5000.0};
  const Response r{o, kPeriod};
  AxisState s{0.004, 0.0};
  const auto energy = [&] { return 0.5 * o.mass_kg * s.v * s.v + 0.5 * o.stiffness_n_per_m * s.x * s.x; };
  const double before = energy();
  for (int k = 0; k < 1'000'000; ++k) {
    const double u = -o.stiffness_n_per_m * s.x;
    s = {s.x + r.xv * s.v + r.xu * u, r.vv * s.v + r.vu * u};
  }
  // The map's six numbers are rounded once, each step adds that much again: 1e6 times 1e-16.
  EXPECT_NEAR(energy(), before, 2e-10 * before);
  const double phase = std::sqrt(o.stiffness_n_per_m / o.mass_kg) * 1e6 * kPeriod;
  EXPECT_NEAR(s.x, 0.004 * std::cos(phase), 1e-9);  // the phase itself, 1e5 rad, is known to 1e-11
}

}  // namespace
}  // namespace twoport::sim::linear_test
