#include "common/passivity/controller.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <type_traits>

#include "common/passivity/observer.h"
#include "tests/support/sizes.h"

namespace twoport::controller_test {
namespace {

using namespace literals;

constexpr Seconds kPeriod{5e-4};
constexpr double kUncapped = std::numeric_limits<double>::infinity();

ControllerOptions options(Method method, double max_gain = kUncapped) {
  return {
      .method = method, .max_gain = max_gain, .max_mobility_m_per_n_s = max_gain, .unilateral = false, .predict = true};
}

template <int Size>
struct Impedance {
  using Out = Force<Size>;
  using In = Velocity<Size>;
  static constexpr const char* kName = "Impedance";
};
template <int Size>
struct Admittance {
  using Out = Velocity<Size>;
  using In = Force<Size>;
  static constexpr const char* kName = "Admittance";
};

template <class Case>
class Controller : public ::testing::Test {
 public:
  using Out = typename Case::Out;
  using In = typename Case::In;
  using Vector = typename Out::Vector;

  Vector random(double size = 1.0) {
    return size * Vector::NullaryExpr([this](Eigen::Index) { return normal_(rng_); });
  }
  double uniform(double from, double to) { return std::uniform_real_distribution<double>{from, to}(rng_); }
  /// What a correction takes out over the coming interval [J].
  static double work(const Corrected<Out>& c, const Out& wanted, const In& in) {
    return (c.out.vec() - wanted.vec()).dot(in.vec()) * kPeriod.si();
  }
  /// Unit vector along the first axis, and one across it; with one axis, both are along it.
  static Vector along() { return Vector::Unit(0); }
  static Vector across() { return Vector::Unit(Out::kSize - 1); }
  static constexpr bool kHasAcross = Out::kSize > 1;

 private:
  std::mt19937_64 rng_{31415};
  std::normal_distribution<double> normal_;
};
struct CaseName {
  template <class Case>
  static std::string GetName(int) {
    return Case::kName + std::to_string(Case::Out::kSize) + "Dof";
  }
};
using Cases = ::testing::Types<Impedance<1>, Impedance<3>, Impedance<6>, Admittance<1>, Admittance<3>, Admittance<6>>;
TYPED_TEST_SUITE(Controller, Cases, CaseName);

constexpr std::array kActing{Method::classic, Method::force_projected};

// --- what is corrected ---------------------------------------------------------------------------

TYPED_TEST(Controller, LeavesTheOutputToTheBitWhileTheAccountCanPay) {
  for (Method method : kActing) {
    for (int i = 0; i < 1000; ++i) {
      const typename TestFixture::Out wanted{this->random()};
      const typename TestFixture::In in{this->random()};
      const Energy cost = dot(wanted, in) * kPeriod;
      const Budget budget{positive_part(-cost), Energy{}};  // just enough
      const auto c = passivity_controller(wanted, in, budget, options(method), kPeriod);
      ASSERT_EQ(c.out.vec(), wanted.vec());
      ASSERT_EQ(c.dissipated, 0.0_J);
      ASSERT_EQ(c.undissipated, 0.0_J);
    }
  }
}

TYPED_TEST(Controller, OfMethodNoneOnlyLooks) {
  const typename TestFixture::Out wanted{this->random()};
  const auto c = passivity_controller(wanted, typename TestFixture::In{this->random()}, Budget{-1.0_J, 1.0_J},
                                      options(Method::none), kPeriod);
  EXPECT_EQ(c.out.vec(), wanted.vec());
  EXPECT_EQ(c.dissipated, 0.0_J);
}

// Theory A1. With f(k) v(k) T for the energy of a tick, what the classic controller lets through adds up to exactly 0
// wherever it acts, and its output is that of the original five steps.
TYPED_TEST(Controller, MakesTheDiscreteEnergyExactlyZeroWhereverItActs) {
  for (Method method : kActing) {
    Energy energy;
    double scale = 0.0;  // of the terms: what 1e-12 is relative to
    int acted = 0;
    for (int k = 0; k < 2000; ++k) {
      const typename TestFixture::Out wanted{this->random()};
      const typename TestFixture::In in{this->random()};
      const auto c = passivity_controller(wanted, in, Budget{energy, Energy{}}, options(method), kPeriod);
      energy += dot(c.out, in) * kPeriod;
      scale = std::max(scale, std::abs((dot(wanted, in) * kPeriod).si()));
      if (c.dissipated > 1e-12 * Energy{scale}) {
        ++acted;
        ASSERT_NEAR(energy.si(), 0.0, 1e-12 * scale) << "tick " << k;
      }
      ASSERT_GE(energy.si(), -1e-12 * scale) << "tick " << k;
    }
    EXPECT_GT(acted, 10);
  }
}

TYPED_TEST(Controller, IsTheOriginalOneWhenClassicAndUncapped) {
  Energy energy;
  double w = 0.0, gain_before = 0.0, in2_before = 0.0;  // W(n-1), alpha(n-1), v(n-1)²
  int acted = 0;
  for (int k = 0; k < 2000; ++k) {
    const typename TestFixture::Out wanted{this->random()};
    const typename TestFixture::In in{this->random()};
    // Hannaford & Ryu, steps 3 to 5, in units of T.
    const double in2 = in.squared_norm();
    w += wanted.vec().dot(in.vec()) + gain_before * in2_before;
    const double gain = w < 0.0 ? -w / in2 : 0.0;
    const typename TestFixture::Vector original = wanted.vec() + gain * in.vec();
    gain_before = gain;
    in2_before = in2;

    const auto c = passivity_controller(wanted, in, Budget{energy, Energy{}}, options(Method::classic), kPeriod);
    energy += dot(c.out, in) * kPeriod;
    acted += gain > 0.0;
    // Both sum 2000 terms of order one in their own order; the rest is divided by |in|.
    ASSERT_LT((c.out.vec() - original).norm(), 1e-12 * (1.0 + 1.0 / std::sqrt(in2))) << "tick " << k;
  }
  EXPECT_GT(acted, 10);
}

TYPED_TEST(Controller, ProjectedIsEquationEight) {
  // Eqs. (6) and (7) with v replaced by v_p of eq. (8). The paper's E_obs is a sum of powers, E / T.
  ControllerOptions o = options(Method::force_projected);
  o.predict = false;
  for (int i = 0; i < 10'000; ++i) {
    const typename TestFixture::Out f{this->random()};
    const typename TestFixture::In v{this->random()};
    const Energy energy{-this->uniform(1e-6, 1e-3)};

    const typename TestFixture::Vector v_p = f.vec().dot(v.vec()) / f.squared_norm() * f.vec();
    const double alpha = -(energy.si() / kPeriod.si()) / v_p.dot(v_p);
    const typename TestFixture::Vector paper = f.vec() + alpha * v_p;

    const auto c = passivity_controller(f, v, Budget{energy, Energy{}}, o, kPeriod);
    // Relative to the larger of the two parts that are added.
    ASSERT_LT((c.out.vec() - paper).norm(), 1e-12 * std::max(f.vec().norm(), (alpha * v_p).norm())) << i;
  }
}

TYPED_TEST(Controller, ClassicIsEquationsSixAndSeven) {
  ControllerOptions o = options(Method::classic);
  o.predict = false;
  for (int i = 0; i < 10'000; ++i) {
    const typename TestFixture::Out f{this->random()};
    const typename TestFixture::In v{this->random()};
    const Energy energy{-this->uniform(1e-6, 1e-3)};
    const double alpha = -(energy.si() / kPeriod.si()) / v.vec().dot(v.vec());
    const typename TestFixture::Vector paper = f.vec() + alpha * v.vec();
    const auto c = passivity_controller(f, v, Budget{energy, Energy{}}, o, kPeriod);
    ASSERT_LT((c.out.vec() - paper).norm(), 1e-12 * std::max(f.vec().norm(), alpha * v.vec().norm())) << i;
  }
}

TYPED_TEST(Controller, ProjectedDissipatesAsMuchAsClassicWithALargerCorrection) {
  // The classic correction is the one of least norm; the ratio is 1/|cos(f, v)|.
  for (int i = 0; i < 1000; ++i) {
    const typename TestFixture::Out f{this->random()};
    const typename TestFixture::In v{this->random()};
    const Budget budget{Energy{-1e-3}, Energy{}};
    const auto classic = passivity_controller(f, v, budget, options(Method::classic), kPeriod);
    const auto projected = passivity_controller(f, v, budget, options(Method::force_projected), kPeriod);
    ASSERT_NEAR(projected.dissipated / classic.dissipated, 1.0, 1e-9);
    const double cosine = std::abs(f.vec().normalized().dot(v.vec().normalized()));
    const double ratio = (projected.out.vec() - f.vec()).norm() / (classic.out.vec() - f.vec()).norm();
    ASSERT_NEAR(ratio * cosine, 1.0, 1e-9);  // differences of outputs that may be 1e3 times larger
  }
}

// --- new and accumulated deficit ---------------------------------------------------------------------

TYPED_TEST(Controller, CapsTheRepaymentOfArrearsOnly) {
  // Along one axis, where classic and projected are the same: in = 2, out = -3, so P = -6 and the new deficit is 6 T.
  constexpr double kGain = 0.5, kAccumulated = 1.0;
  const typename TestFixture::Out wanted{-3.0 * this->along()};
  const typename TestFixture::In in{2.0 * this->along()};
  for (Method method : kActing) {
    const auto c =
        passivity_controller(wanted, in, Budget{Energy{-kAccumulated}, Energy{}}, options(method, kGain), kPeriod);
    const double new_deficit = 6.0 * kPeriod.si(), repaid = kGain * 4.0 * kPeriod.si();
    EXPECT_DOUBLE_EQ(c.out[0], -3.0 + 3.0 + kGain * 2.0);
    EXPECT_NEAR(c.dissipated.si(), new_deficit + repaid, 1e-15);
    EXPECT_NEAR(c.undissipated.si(), kAccumulated - repaid, 1e-15);
  }
}

TYPED_TEST(Controller, WithAGainOfZeroStillStopsTheNewDeficit) {
  for (Method method : kActing) {
    for (int i = 0; i < 1000; ++i) {
      const typename TestFixture::Out wanted{this->random()};
      const typename TestFixture::In in{this->random()};
      const double power = dot(wanted, in).si();
      const auto c = passivity_controller(wanted, in, Budget{-1.0_J, Energy{}}, options(method, 0.0), kPeriod);
      // Never more than what the element itself would give: 1e-12 of |out| |in|.
      ASSERT_NEAR(dot(c.out, in).si(), std::max(power, 0.0), 1e-12 * wanted.vec().norm() * in.vec().norm());
      ASSERT_NEAR(c.undissipated.si(), 1.0, 1e-12);
    }
  }
}

TYPED_TEST(Controller, ArrearsAreRepaidAtNoMoreThanTheCapAlongTheDirectionOfTheCorrection) {
  constexpr double kGain = 3.0;
  for (int i = 0; i < 1000; ++i) {
    const typename TestFixture::Out wanted{this->random()};
    const typename TestFixture::In in{this->random()};
    const double power = dot(wanted, in).si(), new_deficit = std::max(0.0, -power * kPeriod.si());
    const auto classic =
        passivity_controller(wanted, in, Budget{-1.0_J, Energy{}}, options(Method::classic, kGain), kPeriod);
    ASSERT_NEAR(classic.dissipated.si() - new_deficit, kGain * in.squared_norm() * kPeriod.si(), 1e-14);
    const auto projected =
        passivity_controller(wanted, in, Budget{-1.0_J, Energy{}}, options(Method::force_projected, kGain), kPeriod);
    const double v_p2 = power * power / wanted.squared_norm();  // |v_p|²
    ASSERT_NEAR(projected.dissipated.si() - new_deficit, kGain * v_p2 * kPeriod.si(), 1e-14);
  }
}

TYPED_TEST(Controller, TheNewDeficitBoundsItself) {
  for (Method method : kActing) {
    for (int i = 0; i < 10'000; ++i) {
      const typename TestFixture::Out wanted{this->random()};
      const typename TestFixture::In in{this->random()};
      const double power = dot(wanted, in).si(), rise = this->uniform(-1e-3, 1e-3);
      const Budget budget{Energy{this->uniform(0.0, 1e-3)}, Energy{rise}};
      const auto c = passivity_controller(wanted, in, budget, options(method), kPeriod);
      ASSERT_LE(c.dissipated.si(), (std::abs(power) * kPeriod.si() + std::max(rise, 0.0)) * (1.0 + 1e-9));
    }
  }
}

// Where the power passes 0 the scale 1 + D/(T P) has no bound.
TYPED_TEST(Controller, ProjectedAddsNoMoreThanTheOutputAgainOrWhatTheGainAdds) {
  ControllerOptions o = options(Method::force_projected, 2.0);
  int limited = 0;
  for (int i = 0; i < 10'000; ++i) {
    const typename TestFixture::Vector f = this->random(), v = this->random();
    // Almost across each other, to either side; along one axis slow.
    const double cosine = std::pow(10.0, -this->uniform(0.0, 8.0)) * (i % 2 == 0 ? 1 : -1);
    const typename TestFixture::Out wanted{f};
    const typename TestFixture::In in{TestFixture::kHasAcross
                                          ? typename TestFixture::Vector{v - (1.0 - cosine) * f.dot(v) / f.dot(f) * f}
                                          : typename TestFixture::Vector{cosine * v}};
    const Budget budget{Energy{this->uniform(-1e-3, 1e-3)}, Energy{this->uniform(0.0, 1e-2)}};
    const auto c = passivity_controller(wanted, in, budget, o, kPeriod);
    const double force = std::sqrt(squared_norm_in_metric(wanted, o.radius_of_gyration_m));
    const double along = std::abs(dot(wanted, in).si()) / force;  // |v_p|
    const double added = std::sqrt(
        squared_norm_in_metric(typename TestFixture::Out{c.out.vec() - wanted.vec()}, o.radius_of_gyration_m));
    ASSERT_LE(added, (std::max(force, o.max_gain * along) + o.max_gain * along) * (1.0 + 1e-9)) << i;
    limited += c.undissipated.si() > 0.0 && added > 0.9 * force;
    // Nothing of the deficit is lost.
    const double due =
        std::max(0.0, -budget.available.si()) +
        std::max(0.0, budget.rise.si() - std::max(budget.available.si(), 0.0) - (dot(wanted, in) * kPeriod).si());
    ASSERT_NEAR(c.dissipated.si() + c.undissipated.si(), due, 1e-12 * (due + std::abs(force * along)));
  }
  EXPECT_GT(limited, 100);
}

TYPED_TEST(Controller, WithoutPredictionRepaysArrearsOnly) {
  for (Method method : kActing) {
    ControllerOptions o = options(method);
    o.predict = false;
    const typename TestFixture::Out wanted{-3.0 * this->along()};
    const typename TestFixture::In in{2.0 * this->along()};
    EXPECT_EQ(passivity_controller(wanted, in, Budget{Energy{}, 1.0_J}, o, kPeriod).out.vec(), wanted.vec());
    EXPECT_NEAR(passivity_controller(wanted, in, Budget{Energy{-1e-3}, 1.0_J}, o, kPeriod).dissipated.si(), 1e-3,
                1e-15);
  }
}

TYPED_TEST(Controller, WhatIsDissipatedAndWhatIsOwedIsWhatWasDue) {
  for (Method method : kActing) {
    for (bool unilateral : {false, true}) {
      for (double gain : {0.0, 1.0, kUncapped}) {
        ControllerOptions o = options(method, gain);
        o.unilateral = unilateral;
        for (int i = 0; i < 2000; ++i) {
          const typename TestFixture::Out wanted{this->random()};
          const typename TestFixture::In in{this->random()};
          const Budget budget{Energy{this->uniform(-1e-3, 1e-3)}, Energy{this->uniform(-1e-4, 1e-4)}};
          const double cost = (dot(wanted, in) * kPeriod).si();
          const double due = std::max(0.0, -budget.available.si()) +
                             std::max(0.0, budget.rise.si() - std::max(budget.available.si(), 0.0) - cost);
          const auto c = passivity_controller(wanted, in, budget, o, kPeriod);
          // The scale s = 1 + due/(P T) is rounded at 1: 1e-12 of P T.
          ASSERT_NEAR(c.dissipated.si() + c.undissipated.si(), due, 1e-12 * (due + std::abs(cost)));
          ASSERT_GE(c.undissipated.si(), 0.0);
          // And the output does what the numbers say: 1e-12 of |out'| |in| T.
          ASSERT_NEAR(this->work(c, wanted, in), c.dissipated.si(),
                      1e-12 * (c.out.vec().norm() + wanted.vec().norm()) * in.vec().norm() * kPeriod.si());
        }
      }
    }
  }
}

TYPED_TEST(Controller, NeverLetsAWallPull) {
  ControllerOptions o = options(Method::force_projected);
  o.unilateral = true;
  int clamped = 0;
  for (int i = 0; i < 10'000; ++i) {
    const typename TestFixture::Out wanted{this->random()};
    const typename TestFixture::In in{this->random()};
    const auto c = passivity_controller(wanted, in, Budget{Energy{-1e-3}, Energy{}}, o, kPeriod);
    ASSERT_GE(c.out.vec().dot(wanted.vec()), 0.0);
    if (c.out.squared_norm() > 0.0) continue;
    ++clamped;
    ASSERT_GT(c.undissipated.si(), 0.0);
    // All that the element would have given is withheld, and not a joule more.
    ASSERT_NEAR(c.dissipated.si(), -(dot(wanted, in) * kPeriod).si(), 1e-18);
  }
  EXPECT_GT(clamped, 1000);
}

TYPED_TEST(Controller, WithoutTheClampDissipatesTheWholeDeficit) {
  const typename TestFixture::Out wanted{-1.0 * this->along()};
  const typename TestFixture::In in{this->along()};
  const auto c = passivity_controller(wanted, in, Budget{-1.0_J, Energy{}}, options(Method::force_projected), kPeriod);
  EXPECT_DOUBLE_EQ(c.out[0], 1.0 / kPeriod.si());
  EXPECT_EQ(c.undissipated, 0.0_J);
}

// --- where there is no answer --------------------------------------------------------------------

TYPED_TEST(Controller, AtRestWaits) {
  for (Method method : kActing) {
    for (double speed : {0.0, 5e-324, 1e-160, 1e-13}) {
      const typename TestFixture::Out wanted{this->random()};
      const typename TestFixture::In in{speed * this->along()};
      const auto c = passivity_controller(wanted, in, Budget{Energy{-1e-3}, Energy{}}, options(method), kPeriod);
      EXPECT_EQ(c.out.vec(), wanted.vec());
      EXPECT_EQ(c.dissipated, 0.0_J);
      EXPECT_NEAR(c.undissipated.si(), 1e-3, 1e-15);
    }
  }
}

TYPED_TEST(Controller, ProjectedWithNothingToActAlongWaits) {
  for (double size : {0.0, 5e-324, 1e-160, 1e-13}) {
    const typename TestFixture::Out wanted{size * this->along()};
    const typename TestFixture::In in{this->random()};
    const auto c =
        passivity_controller(wanted, in, Budget{Energy{-1e-3}, Energy{}}, options(Method::force_projected), kPeriod);
    EXPECT_EQ(c.out.vec(), wanted.vec());
    EXPECT_EQ(c.dissipated, 0.0_J);
    EXPECT_NEAR(c.undissipated.si(), 1e-3, 1e-15);
  }
}

TYPED_TEST(Controller, ClassicActsEvenWithoutAnOutput) {
  const typename TestFixture::In in{2.0 * this->along()};
  const auto c = passivity_controller(typename TestFixture::Out{}, in, Budget{Energy{-1e-3}, Energy{}},
                                      options(Method::classic), kPeriod);
  EXPECT_EQ(c.undissipated, 0.0_J);
  EXPECT_DOUBLE_EQ(dot(c.out, in).si() * kPeriod.si(), 1e-3);
}

TYPED_TEST(Controller, ProjectedAcrossTheMotionWaits) {
  if constexpr (TestFixture::kHasAcross) {
    for (double slope : {0.0, 1e-300, 1e-11, -1e-11}) {
      const typename TestFixture::Out wanted{5.0 * this->across() + 5.0 * slope * this->along()};
      const typename TestFixture::In in{0.1 * this->along()};
      const auto c =
          passivity_controller(wanted, in, Budget{Energy{-1e-3}, Energy{}}, options(Method::force_projected), kPeriod);
      EXPECT_EQ(c.out.vec(), wanted.vec());
      EXPECT_EQ(c.dissipated, 0.0_J);
      EXPECT_NEAR(c.undissipated.si(), 1e-3, 1e-12);
    }
  }
}

TYPED_TEST(Controller, IsFiniteWhateverTheSizesAndDirections) {
  const std::array sizes{0.0, 5e-324, 1e-310, 1e-160, 1e-30, 9e-13, 2e-12, 1e-6, 1.0, 1e6};
  const std::array slopes{1.0, -1.0, 0.0, 1e-9, -1e-9, 1e-300};
  for (Method method : kActing)
    for (bool unilateral : {false, true})
      for (bool predict : {false, true})
        for (double gain : {0.0, 5e-324, 10.0, 1e308, kUncapped})
          for (double available : {-1.0, -5e-324, 0.0, 5e-324, 1e-3})
            for (double rise : {-1e-3, 0.0, 5e-324, 1e-3})
              for (double a : sizes)
                for (double b : sizes)
                  for (double slope : slopes) {
                    const typename TestFixture::Out wanted{
                        a * (slope * this->along() + this->across() * (1.0 - std::abs(slope)))};
                    const typename TestFixture::In in{b * this->along()};
                    const Budget budget{Energy{available}, Energy{rise}};
                    const auto c = passivity_controller(wanted, in, budget,
                                                        {.method = method,
                                                         .max_gain = gain,
                                                         .max_mobility_m_per_n_s = gain,
                                                         .unilateral = unilateral,
                                                         .predict = predict},
                                                        kPeriod);
                    const bool good = c.out.finite() && std::isfinite(c.dissipated.si()) &&
                                      std::isfinite(c.undissipated.si()) && c.undissipated.si() >= 0.0 &&
                                      c.dissipated.si() >= 0.0;
                    ASSERT_TRUE(good) << "gain " << gain << " available " << available << " rise " << rise << " |out| "
                                      << a << " |in| " << b << " slope " << slope;
                  }
}

// --- in the metric of the handle's inertia -------------------------------------------------------------

/// A mass with inertia, pushed by a held force for one period: displacement = (V - T M⁻¹F/2) T.
template <int N>
struct Handle {
  double mass_kg, radius_m;
  typename Force<N>::Vector displacement(const Velocity<N>& v, const typename Force<N>::Vector& f) const {
    const typename Force<N>::Vector acceleration = dual_in_metric(Force<N>{f}, radius_m) / mass_kg;
    return (v.vec() - 0.5 * kPeriod.si() * acceleration) * kPeriod.si();
  }
  double kinetic(const Velocity<N>& v) const { return 0.5 * mass_kg * squared_norm_in_metric(v, radius_m); }
};

template <class Size>
class InMetric : public Controller<Impedance<Size::value>> {
 public:
  static constexpr int kDof = Size::value;
  const Handle<kDof> handle{0.2, kDof == 6 ? 0.02 : 1.0};
  ControllerOptions options(Method method, double turn_rad = 0.0) const {
    return {.method = method,
            .max_gain = kUncapped,
            .mass_kg = 0.2,
            .radius_of_gyration_m = handle.radius_m,
            .max_turn_rad = turn_rad};
  }
  /// Energy that `correction` alone takes out of the handle in one period.
  double taken(const Velocity<kDof>& v, const typename Force<kDof>::Vector& correction) const {
    return correction.dot(handle.displacement(v, correction));
  }
  double angle(const Force<kDof>& a, const Force<kDof>& b) const {
    const auto inner = [&](const Force<kDof>& p, const Force<kDof>& q) {
      return p.vec().dot(dual_in_metric(q, handle.radius_m));
    };
    return std::acos(std::clamp(inner(a, b) / std::sqrt(inner(a, a) * inner(b, b)), -1.0, 1.0));
  }
};
TYPED_TEST_SUITE(InMetric, test::Sizes, test::SizeName);

TYPED_TEST(InMetric, DampingTakesTheEnergyDueOrTheKineticEnergy) {
  constexpr int kN = TestFixture::kDof;
  int all = 0;
  for (int i = 0; i < 2000; ++i) {
    const Force<kN> wanted{this->random()};
    const Velocity<kN> v{this->random(0.1)};
    const double due = this->uniform(0.0, 2.0) * this->handle.kinetic(v);
    const auto c = passivity_controller(wanted, v, Budget{Energy{-due}, (dot(wanted, v) * kPeriod)},
                                        this->options(Method::metric_damping), kPeriod);
    const double expected = std::min(due, this->handle.kinetic(v));
    all += due > expected;
    // 1e-12 of the kinetic energy: one square root.
    ASSERT_NEAR(this->taken(v, c.out.vec() - wanted.vec()), expected, 1e-12 * this->handle.kinetic(v));
  }
  EXPECT_GT(all, 500);
}

TYPED_TEST(InMetric, AConeTurnsTheForceByNoMoreThanItsAngle) {
  constexpr int kN = TestFixture::kDof;
  int cut = 0;
  for (int i = 0; i < 5000; ++i) {
    const Force<kN> wanted{this->random()};
    const Velocity<kN> v{this->random(0.1)};
    const double turn = this->uniform(0.01, 1.0);
    const Budget budget{Energy{-this->uniform(0.0, 1e-3)}, Energy{}};
    const auto metric = passivity_controller(wanted, v, budget, this->options(Method::metric_damping), kPeriod);
    const auto cone = passivity_controller(wanted, v, budget, this->options(Method::force_cone, turn), kPeriod);
    if (cone.out.squared_norm() < 1e-12) continue;
    // acos resolves 1.5e-8 rad near zero.
    ASSERT_LE(this->angle(cone.out, wanted), turn + 1e-7);
    if (this->angle(metric.out, wanted) < turn - 1e-7) {
      ASSERT_LE((cone.out.vec() - metric.out.vec()).norm(), 1e-12 * metric.out.vec().norm());
    } else {
      ++cut;
    }
  }
  EXPECT_EQ(cut > 100, kN > 1) << cut;
}

// At a right angle a projected force does no work; the cone's edge does, as far as its angle goes.
TYPED_TEST(InMetric, AConeTakesEnergyWhereForceIsAcrossVelocity) {
  constexpr int kN = TestFixture::kDof;
  if constexpr (kN > 1) {
    const Force<kN> wanted{10.0 * this->along()};
    const Velocity<kN> v{0.1 * TestFixture::Vector::Unit(1)};
    const Budget budget{Energy{-1e-5}, Energy{}};
    const auto projected = passivity_controller(wanted, v, budget, this->options(Method::force_projected), kPeriod);
    EXPECT_EQ(projected.out.vec(), wanted.vec());
    const auto wide = passivity_controller(wanted, v, budget, this->options(Method::force_cone, 0.1), kPeriod);
    EXPECT_NEAR(this->taken(v, wide.out.vec() - wanted.vec()), 1e-5, 1e-12);
    const auto narrow = passivity_controller(wanted, v, budget, this->options(Method::force_cone, 0.001), kPeriod);
    EXPECT_NEAR(this->angle(narrow.out, wanted), 0.001, 1e-7);
    EXPECT_GT(this->taken(v, narrow.out.vec() - wanted.vec()), 0.0);
  }
}

// Millimetres for metres: v and f/m grow by 1000, forces of mass x length too; torque and energy by 1e6, ρ by 1000.
TEST(InTheMetric, NothingDependsOnTheUnitOfLength) {
  constexpr double kUnit = 1000.0;
  std::mt19937_64 rng{7};
  std::normal_distribution<double> normal;
  const auto random = [&] {
    return Eigen::Matrix<double, 6, 1>::NullaryExpr([&](Eigen::Index) { return normal(rng); }).eval();
  };
  const auto scaled = [](Eigen::Matrix<double, 6, 1> x, double linear, double angular) {
    x.head<3>() *= linear, x.tail<3>() *= angular;
    return x;
  };
  for (const Method method : {Method::classic, Method::force_projected, Method::metric_damping, Method::force_cone})
    for (int i = 0; i < 200; ++i) {
      const Eigen::Matrix<double, 6, 1> f = random(), v = random();
      const Energy owed{-1e-3 * std::abs(normal(rng))};
      ControllerOptions o{.method = method, .mass_kg = 0.2, .radius_of_gyration_m = 0.02, .max_turn_rad = 0.1};
      const auto metres = passivity_controller(Force<6>{f}, Velocity<6>{v}, Budget{owed, Energy{}}, o, kPeriod);
      o.radius_of_gyration_m *= kUnit;
      const auto millimetres =
          passivity_controller(Force<6>{scaled(f, kUnit, kUnit * kUnit)}, Velocity<6>{scaled(v, kUnit, 1.0)},
                               Budget{kUnit * kUnit * owed, Energy{}}, o, kPeriod);
      ASSERT_LE((scaled(metres.out.vec(), kUnit, kUnit * kUnit) - millimetres.out.vec()).norm(),
                1e-9 * millimetres.out.vec().norm())
          << static_cast<int>(method);
    }
}

// --- the limit at an admittance --------------------------------------------------------------------------

/// A 50 g admittance with a constant push, held by a grip of 5 kN/m: a mobility of 10 m/(N s) at 2 kHz is 25 times
/// what the sampled grip can hold, 2/(K T).
TEST(LimitAtAnAdmittance, KeepsAStiffGripStable) {
  const auto largest = [](double max_mobility) {
    constexpr double kGrip_n_per_m = 5000.0, kMass_kg = 0.05;
    ControllerOptions o{.method = Method::classic, .max_mobility_m_per_n_s = max_mobility};
    double v = 0.3, x = 0.0, most = 0.0;
    Observer<1> observer{Energy{-1e6}};  // a deficit that lasts
    for (int k = 0; k < 4000; ++k) {
      const Force<1> f{Eigen::Matrix<double, 1, 1>{-kGrip_n_per_m * x}};  // of the grip on the element
      v += f[0] / kMass_kg * kPeriod.si();
      const auto c = passivity_controller(Velocity<1>{Eigen::Matrix<double, 1, 1>{v}}, f,
                                          Budget{observer.energy(), Energy{}}, o, kPeriod);
      x += c.out[0] * kPeriod.si();
      observer.book(0, dot(c.out, f) * kPeriod);
      most = std::max(most, std::abs(x));
      if (!(most < 1e3)) break;
    }
    return most;
  };
  EXPECT_LT(largest(ControllerOptions{}.max_mobility_m_per_n_s), 0.01);
  EXPECT_GT(largest(10.0), 1.0);
}

// --- reference energy ----------------------------------------------------------------------------

template <class Size>
class ReferenceEnergy : public ::testing::Test {};
TYPED_TEST_SUITE(ReferenceEnergy, test::Sizes, test::SizeName);

// Theory A3: prediction and a spring's reference energy K x²/2 damp a sampled spring by K T/2, the deficit of Colgate,
// at every tick, pressing and releasing alike.
TYPED_TEST(ReferenceEnergy, OfASpringIsDampingByHalfOfStiffnessTimesPeriod) {
  constexpr int N = TypeParam::value;
  constexpr double kStiffness = 5000.0;
  std::mt19937_64 rng{2718};
  std::normal_distribution<double> normal;
  const auto random = [&](double size) {
    return (size * Velocity<N>::Vector::NullaryExpr([&](Eigen::Index) { return normal(rng); })).eval();
  };
  for (int i = 0; i < 1000; ++i) {
    const auto x = random(1e-3);
    const Velocity<N> v{random(0.1)};
    const Force<N> f{kStiffness * x};
    const Energy rise{0.5 * kStiffness * ((x + kPeriod.si() * v.vec()).squaredNorm() - x.squaredNorm())};
    const auto c = passivity_controller(f, v, Budget{Energy{}, rise}, options(Method::classic), kPeriod);
    // The rise is a difference of two energies and is only as good as their rounding; so is the force made from it.
    const double speed = v.vec().norm(), rounding = 1e-15 * kStiffness * std::pow(x.norm() + kPeriod.si() * speed, 2);
    ASSERT_NEAR(c.dissipated.si(), 0.5 * kStiffness * std::pow(kPeriod.si() * speed, 2), rounding);
    ASSERT_LT((c.out.vec() - (f.vec() + 0.5 * kStiffness * kPeriod.si() * v.vec())).norm(),
              rounding / (kPeriod.si() * speed) + 1e-15 * f.vec().norm());
  }
}

TYPED_TEST(ReferenceEnergy, OfAWallIsThatDampingAlongItsNormalWhenProjected) {
  constexpr int N = TypeParam::value;
  constexpr double kStiffness = 5000.0;
  std::mt19937_64 rng{1618};
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> depth{1e-3, 3e-3};
  typename Force<N>::Vector n = Force<N>::Vector::Zero();  // into the wall
  n.template head<(N == 1 ? 1 : 3)>() = Eigen::Vector3d{2, -1, 2}.template head<(N == 1 ? 1 : 3)>().normalized();
  for (int i = 0; i < 1000; ++i) {
    const double d = depth(rng);
    const Velocity<N> v{(0.1 * Velocity<N>::Vector::NullaryExpr([&](Eigen::Index) { return normal(rng); })).eval()};
    const double v_n = v.vec().dot(n);
    if (std::abs(v_n) < 1e-3) continue;
    const Force<N> f{kStiffness * d * n};
    const double after = d + kPeriod.si() * v_n;
    const Energy rise{0.5 * kStiffness * (after * after - d * d)};
    const auto c = passivity_controller(f, v, Budget{Energy{}, rise}, options(Method::force_projected), kPeriod);
    const double rounding = 1e-15 * kStiffness * std::max(after * after, d * d);
    ASSERT_NEAR(c.out.vec().dot(n), kStiffness * d + 0.5 * kStiffness * kPeriod.si() * v_n,
                (rounding + 1e-15 * f.vec().norm() * v.vec().norm() * kPeriod.si()) / (kPeriod.si() * std::abs(v_n)));
    ASSERT_LT((c.out.vec() - c.out.vec().dot(n) * n).norm(), 1e-14 * c.out.vec().norm());
  }
}

TEST(ReferenceEnergyThatFalls, MayBeGivenBack) {
  // The reference sinks by 1 mJ, the element gives back 1 mJ: nothing to do. At 0.5 mJ, half of it must stay.
  const Force<1> f{Force<1>::Vector::Constant(-2.0)};
  const Velocity<1> v{Velocity<1>::Vector::Constant(1.0)};
  const auto enough =
      passivity_controller(f, v, Budget{Energy{}, Energy{-1e-3}}, options(Method::force_projected), kPeriod);
  EXPECT_EQ(enough.out[0], -2.0);
  const auto half =
      passivity_controller(f, v, Budget{Energy{}, Energy{-5e-4}}, options(Method::force_projected), kPeriod);
  EXPECT_DOUBLE_EQ(half.out[0], -1.0);
}

}  // namespace
}  // namespace twoport::controller_test
