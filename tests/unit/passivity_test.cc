#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <type_traits>
#include <vector>

#include "common/base/vector.h"
#include "common/passivity/observer.h"
#include "tests/support/sizes.h"

namespace twoport::passivity_test {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using namespace literals;

// --- ledger --------------------------------------------------------------------------------------

TEST(Ledger, StartsEmpty) {
  EXPECT_EQ(Ledger{}.absorbed(), 0.0_J);
  EXPECT_EQ(Ledger{}.returned(), 0.0_J);
  EXPECT_EQ(Ledger{}.net(), 0.0_J);
}

TEST(Ledger, KeepsWhatWentInApartFromWhatCameOut) {
  Ledger ledger;
  ledger.book(3.0_J);
  ledger.book(-1.0_J);
  ledger.book(0.5_J);
  EXPECT_EQ(ledger.absorbed(), 3.5_J);
  EXPECT_EQ(ledger.returned(), 1.0_J);
  EXPECT_EQ(ledger.net(), 2.5_J);
}

TEST(Ledger, IsNotSpoiledByANumberThatIsNone) {
  Ledger ledger;
  ledger.book(1.0_J);
  ledger.book(Energy{std::nan("")});
  EXPECT_EQ(ledger.net(), 1.0_J);
}

// --- observer ------------------------------------------------------------------------------------

TEST(Observer, SharesTheInitialEnergyEquallyAmongItsAccounts) {
  Observer<4> observer{0.6_J, 3};
  EXPECT_EQ(observer.accounts(), 3);
  for (int a = 0; a < 3; ++a) EXPECT_DOUBLE_EQ(observer.energy(a).si(), 0.2);
  EXPECT_DOUBLE_EQ(observer.total().si(), 0.6);
}

TEST(Observer, CountsWhatAnElementHoldsAtTheStartInItsOwnAccount) {
  Observer<2> observer{0.2_J};
  observer.store(1, 0.5_J);
  EXPECT_DOUBLE_EQ(observer.energy(0).si(), 0.1);
  EXPECT_DOUBLE_EQ(observer.energy(1).si(), 0.6);
  EXPECT_DOUBLE_EQ(observer.total().si(), 0.7);
  EXPECT_EQ(observer.ledger(1).absorbed(), 0.0_J);  // held, not put in through the port
}

TEST(Observer, KeepsItsAccountsApart) {
  Observer<3> observer{0.3_J};
  observer.book(0, 1.0_J);
  observer.book(1, -2.0_J);
  EXPECT_DOUBLE_EQ(observer.energy(0).si(), 1.1);
  EXPECT_DOUBLE_EQ(observer.energy(1).si(), -1.9);
  EXPECT_DOUBLE_EQ(observer.energy(2).si(), 0.1);
  EXPECT_DOUBLE_EQ(observer.total().si(), -0.7);
  EXPECT_EQ(observer.ledger(1).returned(), 2.0_J);
  EXPECT_EQ(observer.ledger(0).returned(), 0.0_J);
}

TEST(Observer, OfOneAccountHidesWhatTwoShow) {
  // Friction pays for what the wall makes: the total stays positive, the normal account does not.
  Observer<2> apart{Energy{}, 2};
  Observer<2> total{Energy{}, 1};
  for (int k = 0; k < 100; ++k) {
    apart.book(0, Energy{-0.01});
    apart.book(1, Energy{0.02});
    total.book(0, Energy{-0.01 + 0.02});
  }
  EXPECT_LT(apart.energy(0).si(), -0.99);
  EXPECT_GT(total.energy().si(), 0.99);
  EXPECT_NEAR(apart.total().si(), total.energy().si(), 1e-12);
}

// --- exact and rectangle rules on a sampled spring -----------------------------------------------

/// Energy into a spring f(k) = K x(k - lag) that is moved along x(0), x(1), ...; velocities are backward differences, 0
/// before the first.
template <int N, class Path>
double observe(ObserverRule rule, double stiffness, int steps, Seconds dt, Path x, int lag = 0) {
  Observer<1> observer;
  PortMotion<N> before{x(0), {}};
  for (int k = 1; k <= steps; ++k) {
    const PortMotion<N> now{x(k), (x(k) - x(k - 1)) / dt};
    const Force<N> held{stiffness * coordinates(x(k - 1 - lag))};
    observer.book(0, held_energy(rule, held, now - before, dt));
    before = now;
  }
  return observer.energy().si();
}

template <int N>
Position<N> along(double s) {
  const typename Force<N>::Vector d = Force<N>::Vector::LinSpaced(N, 0.5, 1.0).normalized();
  if constexpr (N == 6) {
    return Position<6>{s * d.template head<3>(), rotation(s * d.template tail<3>())};
  } else {
    return Position<N>{s * d};
  }
}
/// Without rotation: there x(k) - x(k-1) is the difference of the coordinates.
template <int N>
Position<N> shifted(const Vector3d& p) {
  if constexpr (N == 6) {
    return Position<6>{p, Quaterniond::Identity()};
  } else {
    return Position<N>{p.head<N>()};
  }
}

template <class Size>
class SampledSpring : public ::testing::Test {};
TYPED_TEST_SUITE(SampledSpring, test::Sizes, test::SizeName);

// Theory A2: with S = K/2 (x_n² - x_0²) and L = K/2 sum dx²,
//   exact      S - L      the spring always gives back more than it took
//   rectangle  S + L      of one period before: the leak with the wrong sign
TYPED_TEST(SampledSpring, LeaksHalfTheSumOfItsSquaredStepsAndTheExactRuleSeesIt) {
  constexpr int N = TypeParam::value;
  constexpr double kStiffness = 5000.0;
  constexpr int kSteps = 400;
  std::mt19937_64 rng{101};
  std::normal_distribution<double> step{0.0, 1e-4};
  std::vector<Vector3d> p{Vector3d{1e-3, -2e-3, 1e-3}};
  for (int k = 1; k <= kSteps; ++k) p.push_back(p.back() + Vector3d{step(rng), step(rng), step(rng)});

  constexpr int kAxes = N == 1 ? 1 : 3;
  double leak = 0.0;
  for (std::size_t k = 1; k <= kSteps; ++k)
    leak += 0.5 * kStiffness * (p[k] - p[k - 1]).template head<kAxes>().squaredNorm();
  const auto stored = [&](std::size_t k) { return 0.5 * kStiffness * p[k].template head<kAxes>().squaredNorm(); };
  const auto x = [&](int k) { return shifted<N>(p[static_cast<std::size_t>(k)]); };

  const double exact = observe<N>(ObserverRule::exact, kStiffness, kSteps, Seconds{5e-4}, x);
  EXPECT_NEAR(exact, stored(kSteps) - stored(0) - leak, 1e-12 * leak);

  // The rectangle rule books the interval that begins at k - 1 with the velocity of the one before.
  const double last = 0.5 * kStiffness * (p[kSteps] - p[kSteps - 1]).template head<kAxes>().squaredNorm();
  const double rectangle = observe<N>(ObserverRule::rectangle, kStiffness, kSteps, Seconds{5e-4}, x);
  EXPECT_NEAR(rectangle, stored(kSteps - 1) - stored(0) + (leak - last), 1e-12 * leak);
}

TYPED_TEST(SampledSpring, PressedAndReleasedAtConstantSpeedMakesKvTD) {
  constexpr int N = TypeParam::value;
  struct Row {
    double stiffness, period, speed, depth;
  };
  for (const Row& r :
       {Row{5000, 5e-4, 0.1, 1e-3}, Row{1000, 1e-3, 0.1, 5e-3}, Row{1000, 1e-3, 0.5, 1e-2}, Row{200, 1e-2, 0.1, 1e-2},
        Row{10000, 1e-4, 0.05, 1e-3}, Row{300, 2e-3, 0.3, 6e-2}, Row{2000, 5e-4, 1.0, 1e-2}}) {
    const int half = static_cast<int>(std::lround(r.depth / (r.speed * r.period)));
    const auto x = [&](int k) { return along<N>(r.depth * (1.0 - std::abs(k - half) / static_cast<double>(half))); };
    const double made = -observe<N>(ObserverRule::exact, r.stiffness, 2 * half, Seconds{r.period}, x);
    EXPECT_NEAR(made / (r.stiffness * r.speed * r.period * r.depth), 1.0, 1e-12) << r.stiffness << " N/m";
    // And the rectangle rule is as wrong as can be. Its velocity at the turn and its missing last step cost nothing
    // here: x(0) = x(2 half) = 0.
    const double seen = -observe<N>(ObserverRule::rectangle, r.stiffness, 2 * half + 1, Seconds{r.period},
                                    [&](int k) { return x(std::min(k, 2 * half)); });
    EXPECT_NEAR(seen / (r.stiffness * r.speed * r.period * r.depth), -1.0, 1e-12) << r.stiffness << " N/m";
  }
}

TYPED_TEST(SampledSpring, MovedInASineMakesTheClosedFormEachPeriod) {
  // E = (K A² N/2) [cos(d th) - cos((d+1) th)], th = 2 pi/N: N ticks per period, d ticks of delay.
  constexpr int N = TypeParam::value;
  struct Row {
    double stiffness, amplitude;
    int ticks, lag;
  };
  for (const Row& r :
       {Row{5000, 1e-3, 50, 0}, Row{5000, 1e-3, 200, 0}, Row{1000, 5e-3, 100, 0}, Row{1000, 5e-3, 100, 1},
        Row{1000, 5e-3, 100, 5}, Row{1000, 5e-3, 100, 20}, Row{2000, 2e-3, 12, 2}, Row{300, 2e-2, 1000, 3}}) {
    const double th = 2.0 * std::numbers::pi / r.ticks;
    const auto x = [&](int k) { return along<N>(r.amplitude * std::sin(th * k)); };
    const double made = -observe<N>(ObserverRule::exact, r.stiffness, r.ticks, Seconds{1e-3}, x, r.lag);
    const double closed =
        0.5 * r.stiffness * r.amplitude * r.amplitude * r.ticks * (std::cos(r.lag * th) - std::cos((r.lag + 1) * th));
    EXPECT_NEAR(made / closed, 1.0, 1e-12) << r.ticks << " ticks per period, delay " << r.lag;
  }
}

TEST(RectangleRule, WithTrueVelocitiesMissesTheLeakOfASine) {
  // f(k) v(k) summed over a period is a sum of sin cos: 0, where the spring made 1 mJ.
  constexpr int kTicks = 50;
  const double th = 2.0 * std::numbers::pi / kTicks;
  Observer<1> observer;
  const auto at = [&](int k) {
    return PortMotion<1>{along<1>(1e-3 * std::sin(th * k)),
                         Velocity<1>{Velocity<1>::Vector::Constant(1e-3 * th / 5e-4 * std::cos(th * k))}};
  };
  for (int k = 1; k <= kTicks; ++k) {
    const Force<1> held{5000.0 * coordinates(at(k - 1).x)};
    observer.book(0, held_energy(ObserverRule::rectangle, held, at(k) - at(k - 1), Seconds{5e-4}));
  }
  EXPECT_NEAR(observer.energy().si(), 0.0, 1e-15);  // against terms of 3e-4 J
}

TYPED_TEST(SampledSpring, ExactRuleDoesNotAskWhatHappenedBetweenTheTicks) {
  // Whatever velocities are reported: positions alone decide. (6 DoF: in translation.)
  constexpr int N = TypeParam::value;
  const Force<N> held{Force<N>::Vector::LinSpaced(N, 1.0, 2.0)};
  PortMotion<N> before{shifted<N>(Vector3d{0, 0, 0}), {}}, now{shifted<N>(Vector3d{1, 2, 3}), {}};
  const Energy quiet = held_energy(ObserverRule::exact, held, now - before, Seconds{1e-3});
  typename Force<N>::Vector loud = Force<N>::Vector::Zero();
  loud.template head<(N == 1 ? 1 : 3)>().setConstant(1e6);
  before.v = Velocity<N>{loud};
  now.v = Velocity<N>{-loud};
  EXPECT_EQ(held_energy(ObserverRule::exact, held, now - before, Seconds{1e-3}), quiet);
  EXPECT_EQ(quiet.si(), held.vec().template head<(N == 1 ? 1 : 3)>().dot(Vector3d{1, 2, 3}.head<(N == 1 ? 1 : 3)>()));
}

// --- a held wrench on a turning body -------------------------------------------------------------

/// A body whose angular velocity (world axes) goes linearly from w0 to w1 in T while a wrench is held in world axes.
struct Turning {
  Vector3d w0{4.0, -3.0, 5.0}, w1{-2.0, 6.0, 3.0};
  Vector3d v0{0.1, 0.2, -0.3}, v1{0.3, -0.1, 0.2};
  Force<6> held = [] {
    Force<6>::Vector f;
    f << 3, -1, 2, 0.5, 0.7, -0.4;
    return Force<6>{f};
  }();

  /// ∫ (f·v + tau·w) dt by Simpson on 2000 panels; the integrand is a straight line in time.
  [[nodiscard]] double quadrature(double period) const {
    constexpr int kPanels = 2000;
    const double h = period / kPanels;
    const auto power = [&](double s) {
      Velocity<6>::Vector v;
      v << v0 + s * (v1 - v0), w0 + s * (w1 - w0);
      return dot(held, Velocity<6>{v}).si();
    };
    double sum = 0.0;
    for (int i = 0; i < kPanels; ++i) {
      const double s = static_cast<double>(i) / kPanels, ds = 1.0 / kPanels;
      sum += h / 6.0 * (power(s) + 4.0 * power(s + 0.5 * ds) + power(s + ds));
    }
    return sum;
  }
  /// Where the body is after T: dR/dt = [w]x R by the fourth-order Magnus rule on 2000 panels, whose own error here is
  /// 2000^-4 of one panel's.
  [[nodiscard]] PortMotion<6> end(double period, const PortMotion<6>& start) const {
    constexpr int kPanels = 2000;
    const double h = period / kPanels;
    Quaterniond q = start.x.attitude();
    for (int i = 0; i < kPanels; ++i) {
      const Vector3d a = w0 + (w1 - w0) * (static_cast<double>(i) / kPanels);
      const Vector3d b = w0 + (w1 - w0) * ((i + 1.0) / kPanels);
      q = rotation(0.5 * h * (a + b) - h * h / 12.0 * a.cross(b)) * q;
    }
    return {Position<6>{start.x.translation() + 0.5 * period * (v0 + v1), q.normalized()}, twist(v1, w1)};
  }
  static Velocity<6> twist(const Vector3d& v, const Vector3d& w) {
    Velocity<6>::Vector both;
    both << v, w;
    return Velocity<6>{both};
  }
  [[nodiscard]] PortMotion<6> start() const {
    return {Position<6>{Vector3d{1, 2, 3}, rotation(Vector3d{0.4, -0.9, 0.2})}, twist(v0, w0)};
  }
  [[nodiscard]] double error(double period) const {
    const PortMotion<6> before = start(), now = end(period, before);
    return held_energy(ObserverRule::exact, held, now - before, Seconds{period}).si() - quadrature(period);
  }
  [[nodiscard]] double error_of_log_alone(double period) const {
    const PortMotion<6> before = start(), now = end(period, before);
    return dot(held, now.x - before.x).si() - quadrature(period);
  }
};

/// At 7 rad/s, with 110 rad/s² of angular acceleration.
Turning over(double period) {
  Turning t;
  t.w1 = t.w0 + period * Vector3d{-60.0, 90.0, -20.0};
  return t;
}

TEST(HeldWrench, DoesTheWorkOfTorqueTimesAngularVelocity) {
  // The remainder for w linear in time is of order T⁵: |tau| |w| |w'| (|w'|/240 + |w|²/720) T⁵, here at most 4e-13 J,
  // where T²/12 tau·(w0 x w1) is 4e-8 J.
  const Turning turning = over(1e-3);
  EXPECT_GT(std::abs(turning.quadrature(1e-3)), 1e-3);
  EXPECT_NEAR(turning.error(1e-3), 0.0, 4e-13);
}

TEST(HeldWrench, NeedsTheTermThatTheRotationVectorLeavesOut) {
  // Without it the error is T²/12 tau·(w0 x w1), to the same fifth order.
  const Turning turning = over(1e-2);
  const double term = 1e-4 / 12.0 * turning.held.vec().tail<3>().dot(turning.w0.cross(turning.w1));
  ASSERT_GT(std::abs(term), 1e-5);
  EXPECT_NEAR(turning.error_of_log_alone(1e-2) / -term, 1.0, 1e-2);
}

TEST(HeldWrench, LeavesTheFifthOrderTermOfMagnusSeries) {
  // With m = T (w0 + w1)/2 and d = T (w1 - w0):  (m x d) x d / 240 + m x (m x (m x d)) / 720.
  const double period = 1e-2;
  const Turning t = over(period);
  const Vector3d m = 0.5 * period * (t.w0 + t.w1), d = period * (t.w1 - t.w0);
  const Vector3d rest = m.cross(d).cross(d) / 240.0 + m.cross(m.cross(m.cross(d))) / 720.0;
  const double predicted = t.held.vec().tail<3>().dot(rest);
  ASSERT_GT(std::abs(predicted), 1e-10);
  EXPECT_NEAR(t.error(period) / predicted, 1.0, 0.05);  // the next order is |m| = 0.07 of it
}

TEST(HeldWrench, HasARemainderOfFifthOrderWhereTheRotationVectorHasOneOfThird) {
  // Half the period: 1/32 of the error; without the term 1/8.
  EXPECT_NEAR(std::log2(over(1e-2).error(1e-2) / over(5e-3).error(5e-3)), 5.0, 0.2);
  EXPECT_NEAR(std::log2(over(1e-2).error_of_log_alone(1e-2) / over(5e-3).error_of_log_alone(5e-3)), 3.0, 0.2);
}

TEST(HeldWrench, IsCountedInTranslationByItsDisplacement) {
  Turning turning;
  turning.w0 = turning.w1 = Vector3d::Zero();
  EXPECT_NEAR(turning.error(1e-2), 0.0, 3e-15);  // positions of order one, 4 N
}

}  // namespace
}  // namespace twoport::passivity_test
