#include "common/passivity/velocity_predictor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "common/passivity/controller.h"

namespace twoport::velocity_predictor_test {
namespace {

constexpr Seconds kPeriod{5e-4};
constexpr double kT = kPeriod.si();

template <class Size>
class PortVelocity : public ::testing::Test {
 public:
  static constexpr int kN = Size::value;
  using Vector = typename Force<kN>::Vector;
  Vector random(double size) {
    return size * Vector::NullaryExpr([this](Eigen::Index) { return normal_(rng_); });
  }
  double uniform(double from, double to) { return std::uniform_real_distribution<double>{from, to}(rng_); }
  static Vector mobility(double mass, double inertia) {
    Vector m = Vector::Constant(1.0 / mass);
    if constexpr (kN == 6) m.template tail<3>().setConstant(1.0 / inertia);
    return m;
  }
  /// M⁻¹; of joints one that couples them.
  AxisMatrix<kN> inverse_mass() {
    if constexpr (kN == kJointPort) {
      AxisMatrix<kN> m;
      for (int i = 0; i < kN; ++i) m.col(i) = random(1.0);
      return m * m.transpose() + AxisMatrix<kN>::Identity();
    } else {
      return axis_matrix<kN>(mobility(0.1, 1e-3));
    }
  }
  /// A prediction of any kind.
  VelocityPrediction<kN> prediction(double error_bound) {
    return {axis_matrix<kN>(mobility(0.1, 1e-3) * (0.5 * kT)), Velocity<kN>{random(0.1)}, uniform(0.0, error_bound),
            kN == 6 ? uniform(0.0, error_bound) : 0.0};
  }
  /// What comes in over an interval that goes as predicted, but for an error of w [J].
  static double taken_in(const Force<kN>& f, const VelocityPrediction<kN>& h, const Vector& error) {
    return f.vec().dot(h.w.vec() + error - Vector{h.mobility * f.vec()}) * kT;
  }

 private:
  std::mt19937_64 rng_{20240917};
  std::normal_distribution<double> normal_;
};
template <int Size>
using Axes = std::integral_constant<int, Size>;
using Sizes = ::testing::Types<Axes<1>, Axes<3>, Axes<6>, Axes<kJointPort>>;
TYPED_TEST_SUITE(PortVelocity, Sizes);

ControllerOptions options(double max_gain = 10.0) {
  return {.method = Method::force_projected, .max_gain = max_gain, .unilateral = true, .predict = true};
}

TYPED_TEST(PortVelocity, UnderAConstantForceOfTheHandIsPredictedExactly) {
  constexpr int N = TestFixture::kN;
  using V = typename TestFixture::Vector;
  const V push = this->random(0.3);
  const AxisMatrix<N> inverse_mass = this->inverse_mass();
  PortVelocityPredictor<N> handle{0.1, 1e-3};
  handle.take_inertia({inverse_mass, 1.0});
  V v = this->random(0.1), moved = V::Zero(), f = V::Zero();
  for (int k = 0; k < 200; ++k) {
    handle.step(Displacement<N>{moved}, Force<N>{f}, kPeriod, kPeriod);
    f = this->random(2.0);
    // A mass under a held force, exactly.
    const V a = inverse_mass * (push - f);
    moved = v * kT + 0.5 * kT * kT * a;
    v += a * kT;
    // The start is forgotten by a factor of four per tick.
    if (k < 40) continue;
    const V expected = handle.prediction().w.vec() - handle.prediction().mobility * f;
    EXPECT_LT((expected - moved / kT).norm(), 1e-11 * (1.0 + v.norm())) << "tick " << k;
  }
}

TYPED_TEST(PortVelocity, IsForeseenAsWellAfterTicksThatWereLeftOut) {
  constexpr int N = TestFixture::kN;
  using V = typename TestFixture::Vector;
  const V push = this->random(0.3);
  const AxisMatrix<N> inverse_mass = this->inverse_mass();
  PortVelocityPredictor<N> handle{0.1, 1e-3};
  handle.take_inertia({inverse_mass, 1.0});
  V v = this->random(0.1), moved = V::Zero(), f = V::Zero();
  double ended = kT;
  for (int k = 0; k < 200; ++k) {
    handle.step(Displacement<N>{moved}, Force<N>{f}, Seconds{ended}, kPeriod);
    const V next = handle.prediction().w.vec();
    f = this->random(2.0);
    ended = k % 10 == 9 ? 4 * kT : kT;
    const V a = inverse_mass * (push - f);
    if (k >= 40) {
      EXPECT_LT((next - handle.prediction().mobility * f - (v + 0.5 * kT * a)).norm(), 1e-10 * (1.0 + v.norm()))
          << "tick " << k;
    }
    moved = v * ended + 0.5 * ended * ended * a;
    v += a * ended;
  }
}

TYPED_TEST(PortVelocity, IsDoubtedByHowMuchItErredAndThenLess) {
  constexpr int N = TestFixture::kN;
  using V = typename TestFixture::Vector;
  PortVelocityPredictor<N> handle{0.1, 1e-3};
  for (int k = 0; k < 10; ++k) handle.step(Displacement<N>{}, Force<N>{}, kPeriod, kPeriod);
  EXPECT_EQ(handle.prediction().error_bound, 0.0);
  const V jump = this->random(1e-4);
  handle.step(Displacement<N>{jump}, Force<N>{}, kPeriod, kPeriod);
  const double linear = jump.template head<(N == 6 ? 3 : N)>().norm() / kT;
  EXPECT_NEAR(handle.prediction().error_bound, linear, 1e-12);
  if constexpr (N == 6) {
    EXPECT_NEAR(handle.prediction().rotation_error_bound, jump.template tail<3>().norm() / kT, 1e-12);
  }
  for (int k = 0; k < 200; ++k) handle.step(Displacement<N>{}, Force<N>{}, kPeriod, kPeriod);
  EXPECT_LT(handle.prediction().error_bound, 1e-3 * linear);
  EXPECT_LT(handle.prediction().rotation_error_bound, 1e-3 * jump.norm() / kT);
}

TYPED_TEST(PortVelocity, IsGivenNoMoreThanThereIsWhateverTheDoubt) {
  constexpr int N = TestFixture::kN;
  using V = typename TestFixture::Vector;
  int cut = 0, whole = 0;
  for (int i = 0; i < 20'000; ++i) {
    const Force<N> wanted{this->random(3.0)};
    const VelocityPrediction<N> h = this->prediction(i % 2 == 0 ? 0.0 : 0.02);
    const Energy available{this->uniform(0.0, 1e-4)};
    const Corrected<Force<N>> c = predictive_impedance_controller(wanted, h, available, options(), kPeriod);
    const double s = c.out.vec().dot(wanted.vec()) / wanted.squared_norm();
    ASSERT_GE(s, 0.0);
    ASSERT_LE(s, 1.0 + 1e-15);
    ASSERT_LT((c.out.vec() - s * wanted.vec()).norm(), 1e-14 * wanted.vec().norm());  // along the wanted force
    // The worst within the error bound.
    V worst = V::Zero();
    constexpr int kAxes = N == 6 ? 3 : N;
    worst.template head<kAxes>() = -h.error_bound * wanted.vec().template head<kAxes>().normalized();
    if constexpr (N == 6)
      worst.template tail<3>() = -h.rotation_error_bound * wanted.vec().template tail<3>().normalized();
    const double in = this->taken_in(c.out, h, worst);
    ASSERT_GE(in, -available.si() - 1e-15) << "s " << s;
    // No less than fits: the whole force, or all that is available is given.
    if (s < 1.0 - 1e-9) {
      ++cut;
      ASSERT_NEAR(in, -available.si(), 1e-12);
    } else {
      ++whole;
    }
    ASSERT_EQ(c.undissipated.si(), 0.0);
  }
  EXPECT_GT(cut, 1000);
  EXPECT_GT(whole, 200);
}

TYPED_TEST(PortVelocity, WithADeficitTakesInWhatItCanAndGivesNothing) {
  constexpr int N = TestFixture::kN;
  int paid = 0, silent = 0, all = 0;
  for (int i = 0; i < 20'000; ++i) {
    const Force<N> wanted{this->random(3.0)};
    const VelocityPrediction<N> h = this->prediction(0.0);
    const Energy available{-this->uniform(0.0, 1e-4)};
    const ControllerOptions o = options(i % 2 == 0 ? 10.0 : 1e9);
    const Corrected<Force<N>> c = predictive_impedance_controller(wanted, h, available, o, kPeriod);
    const double in = this->taken_in(c.out, h, TestFixture::Vector::Zero()), deficit = -available.si();
    ASSERT_GE(in, -1e-15);
    ASSERT_NEAR(c.undissipated.si(), std::max(0.0, deficit - in), 1e-15);
    const double p = wanted.vec().dot(h.w.vec());
    if (p <= 0.0) {
      ASSERT_EQ(c.out.vec().norm(), 0.0);
      ++silent;
      continue;
    }
    ++paid;
    // As much as is due, or as the cap allows, or as the handle can give: at most P²T/4Q for s in [0, 1].
    const double q = wanted.vec().dot(typename TestFixture::Vector{h.mobility * wanted.vec()});
    const double most = (p >= 2.0 * q ? p - q : p * p / (4.0 * q)) * kT;
    const double due = std::min(deficit, o.max_gain * kT * p * p / wanted.squared_norm());
    ASSERT_GE(in, std::min(due, most) - 1e-15);
    all += in >= deficit;
  }
  EXPECT_GT(paid, 1000);
  EXPECT_GT(silent, 1000);
  EXPECT_GT(all, 100);
}

TYPED_TEST(PortVelocity, AtRestAgainstAHandTheForceStaysWithAnEmptyAccount) {
  constexpr int N = TestFixture::kN;
  const Force<N> wanted{this->random(3.0)};
  VelocityPrediction<N> h = this->prediction(0.0);
  h.w = Velocity<N>{h.mobility * wanted.vec()};  // the hand pushes just as hard
  const Corrected<Force<N>> c = predictive_impedance_controller(wanted, h, Energy{1e-15}, options(), kPeriod);
  EXPECT_LT((c.out.vec() - wanted.vec()).norm(), 1e-12);
  EXPECT_EQ(c.undissipated.si(), 0.0);
}

TYPED_TEST(PortVelocity, WithoutAWantedForceNothingIsCorrected) {
  constexpr int N = TestFixture::kN;
  for (const double available : {-1e-3, 0.0, 1e-3}) {
    const Corrected<Force<N>> c =
        predictive_impedance_controller(Force<N>{}, this->prediction(0.01), Energy{available}, options(), kPeriod);
    EXPECT_EQ(c.out.vec().norm(), 0.0);
    EXPECT_EQ(c.undissipated.si(), std::max(0.0, -available));
  }
}

}  // namespace
}  // namespace twoport::velocity_predictor_test
