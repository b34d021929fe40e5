#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <string>
#include <type_traits>

#include "common/base/vector.h"
#include "common/passivity/controller.h"
#include "common/passivity/observer.h"
#include "common/passivity/passivated.h"
#include "tests/support/sizes.h"

namespace twoport::energy_test {
namespace {

using Eigen::Vector3d;

constexpr Seconds kPeriod{5e-4};
constexpr double kFloor = -1e-9;  // [J]: rounding of some 1e5 terms of up to 1e-2 J, and what a force at 90 deg leaves

class Source {
 public:
  explicit Source(std::uint64_t seed) : rng_{seed} {}
  double uniform(double from, double to) { return std::uniform_real_distribution<double>{from, to}(rng_); }
  template <int N>
  Eigen::Matrix<double, N, 1> vector() {
    return Eigen::Matrix<double, N, 1>::NullaryExpr([this](Eigen::Index) { return normal_(rng_); });
  }

 private:
  std::mt19937_64 rng_;
  std::normal_distribution<double> normal_;
};

/// Where a pose puts the point that touches, and what a force there is at the port. With six axes the point sits
/// 2 cm off the tool's, so that it turns with it.
template <int N>
struct Touch {
  using Point = Eigen::Matrix<double, (N == 1 ? 1 : 3), 1>;
  static Vector3d arm(const Position<N>& x) {
    if constexpr (N == 6) return x.attitude() * Vector3d{0.012, -0.016, 0.0};
    return Vector3d::Zero();
  }
  static Point point(const Position<N>& x) {
    if constexpr (N == 6) {
      return x.translation() + arm(x);
    } else {
      return x.translation();
    }
  }
  static Force<N> wrench(const Position<N>& x, const Point& f) {
    if constexpr (N == 6) {
      Force<6>::Vector w;
      w << f, arm(x).cross(f);
      return Force<6>{w};
    } else {
      return Force<N>{f};
    }
  }
};

template <class Size>
class EnergyOf : public ::testing::Test {};
TYPED_TEST_SUITE(EnergyOf, test::Sizes, test::SizeName);

// --- closed loops --------------------------------------------------------------------------------

/// A light device pushed by a noisy hand against two sampled walls. It gets its momentum at the ticks, so the
/// velocity of the coming interval is known and constant: the prediction is exact, the displacement too.
template <int N>
class Loop {
 public:
  using Vector = typename Force<N>::Vector;

  explicit Loop(std::uint64_t seed) : source_{seed} {
    for (Wall& w : walls_) {
      w.normal = source_.template vector<Touch<N>::Point::SizeAtCompileTime>().normalized();
      w.offset = source_.uniform(-2e-3, 2e-3);
      w.stiffness = source_.uniform(1000.0, 4000.0);
    }
    pull_ = source_.uniform(100.0, 400.0);
  }

  /// Least exact energy over the run [J].
  double least_energy(const ControllerOptions& options, int ticks) {
    Observer<1> observer;
    Position<N> x;
    Velocity<N> v;
    double least = 0.0;
    for (int k = 0; k < ticks; ++k) {
      const Force<N> wanted = wall_force(x);
      const auto c = passivity_controller(wanted, v, Budget{observer.energy(), Energy{}}, options, kPeriod);
      const Position<N> next = x + v * kPeriod;
      observer.book(0, held_energy(ObserverRule::exact, c.out, Interval<N>{next - x, v, v}, kPeriod));
      least = std::min(least, observer.energy().si());
      x = next;
      v = Velocity<N>{v.vec() + kPeriod.si() * (hand(x, v) - c.out.vec()).cwiseQuotient(inertia())};
    }
    return least;
  }

 private:
  struct Wall {
    typename Touch<N>::Point normal;  ///< into the wall
    double offset = 0.0, stiffness = 0.0;
  };
  static Vector inertia() {
    Vector m = Vector::Constant(0.1);
    if constexpr (N == 6) m.template tail<3>().setConstant(1e-4);
    return m;
  }
  Vector hand(const Position<N>& x, const Velocity<N>& v) {
    Vector f = source_.template vector<N>() - pull_ * coordinates(x) - 0.5 * v.vec();
    if constexpr (N == 6) f.template tail<3>() *= 1e-3;
    return f;
  }
  Force<N> wall_force(const Position<N>& x) const {
    typename Touch<N>::Point f = Touch<N>::Point::Zero();
    for (const Wall& w : walls_)
      f += w.stiffness * std::max(0.0, w.normal.dot(Touch<N>::point(x)) - w.offset) * w.normal;
    return Touch<N>::wrench(x, f);
  }

  Source source_;
  std::array<Wall, 2> walls_;
  double pull_ = 0.0;
};

constexpr int kLoops = 40, kTicks = 2000;

TYPED_TEST(EnergyOf, AClosedLoopWithoutControlGoesBelowZero) {
  // The loops that follow are worth controlling.
  double least = 0.0;
  for (std::uint64_t seed = 0; seed < kLoops; ++seed)
    least = std::min(least, Loop<TypeParam::value>{seed}.least_energy({.method = Method::none}, kTicks));
  EXPECT_LT(least, -1e-3);
}

TYPED_TEST(EnergyOf, AClosedLoopNeverGoesBelowZeroWhereTheMotionIsPredictedExactly) {
  // Whatever the cap: prediction leaves no accumulated deficit, and the new deficit has none.
  for (Method method : {Method::classic, Method::force_projected})
    for (double gain : {0.0, 10.0, std::numeric_limits<double>::infinity()})
      for (std::uint64_t seed = 0; seed < kLoops; ++seed) {
        const ControllerOptions options{.method = method, .max_gain = gain, .unilateral = true, .predict = true};
        ASSERT_GE(Loop<TypeParam::value>{seed}.least_energy(options, kTicks), kFloor)
            << "method " << static_cast<int>(method) << " gain " << gain << " seed " << seed;
      }
}

TYPED_TEST(EnergyOf, AClosedLoopWithoutPredictionPaysLate) {
  // Without prediction each deficit is there for a tick. Better than nothing, and below the floor.
  for (Method method : {Method::classic, Method::force_projected}) {
    double none = 0.0, late = 0.0;
    for (std::uint64_t seed = 0; seed < kLoops; ++seed) {
      const ControllerOptions options{.method = method, .max_gain = 20.0, .unilateral = true, .predict = false};
      none = std::min(none, Loop<TypeParam::value>{seed}.least_energy({.method = Method::none}, kTicks));
      late = std::min(late, Loop<TypeParam::value>{seed}.least_energy(options, kTicks));
    }
    EXPECT_LT(late, 1e3 * kFloor);
    EXPECT_GT(late, 0.2 * none);
  }
}

// --- Passivated ----------------------------------------------------------------------------------

/// Impedance. A sampled ball of radius 1 cm that pushes out along its radius with K (R - |p|). Its position is the sum
/// of what it is told: at constant velocity, the mean of the interval that has ended is the velocity of the next.
template <int N>
class Ball {
 public:
  using In = Velocity<N>;
  using Out = Force<N>;
  static constexpr double kRadius = 0.01;
  Ball(Position<N> start, double stiffness) : x_{start}, k_{stiffness} {}

  Out step(const In& v, Seconds dt) noexcept {
    x_ = x_ + v * dt;
    const auto p = Touch<N>::point(x_);
    const double r = p.norm();
    // Into the element: against the push on the hand.
    if (r >= kRadius || r == 0.0) return Force<N>{};
    return Touch<N>::wrench(x_, -k_ * (kRadius - r) / r * p);
  }
  [[nodiscard]] const Position<N>& at() const { return x_; }

 private:
  Position<N> x_;
  double k_;
};

/// Straight through the ball, 200 times, turning some 6 cm away where no force is held.
template <int N>
struct Chords {
  double least_told = 0.0, least_exact = 0.0, apart = 0.0;

  template <class Options>
  Chords(const Options& options, std::uint64_t seed) {
    Source source{seed};
    using Point = typename Touch<N>::Point;
    const auto pose = [](const Point& p) {
      if constexpr (N == 6) {
        return Position<6>{p, Eigen::Quaterniond::Identity()};
      } else {
        return Position<N>{p};
      }
    };
    constexpr int kAxes = Point::SizeAtCompileTime;
    Point from = 0.06 * source.vector<kAxes>().normalized();
    Passivated ball{Ball<N>{pose(from), source.uniform(500.0, 5000.0)}, options};
    Observer<1> exact{ball.energy()};
    Force<N> held;
    for (int chord = 0; chord < 200; ++chord) {
      // Past a place where the ball is touched, and on.
      const Point touching =
          0.3 * Ball<N>::kRadius * source.vector<kAxes>() - Touch<N>::arm(ball.element().at()).template head<kAxes>();
      const Point to = touching + 0.06 * (touching - from).normalized();
      const int ticks = static_cast<int>(source.uniform(20.0, 400.0));
      typename Velocity<N>::Vector v = Velocity<N>::Vector::Zero();
      v.template head<kAxes>() = (to - from) / (ticks * kPeriod.si());
      if constexpr (N == 6) v.template tail<3>() = 2.0 * source.vector<3>();
      for (int k = 0; k < ticks; ++k) {
        const Position<N> before = ball.element().at();
        const Velocity<N> now{v};
        const Force<N> out = ball.step(now, kPeriod);
        exact.book(
            0, held_energy(ObserverRule::exact, held, Interval<N>{ball.element().at() - before, now, now}, kPeriod));
        held = out;
        least_told = std::min(least_told, ball.energy().si());
        least_exact = std::min(least_exact, exact.energy().si());
        apart = std::max(apart, std::abs((ball.energy() - exact.energy()).si()));
      }
      from = to;
    }
  }
};

TYPED_TEST(EnergyOf, APassivatedBallIsWhatTheExactObserverSees) {
  // Positions of order 0.1 m are rounded at 1e-17 m, forces are up to 50 N, 4e4 ticks.
  for (std::uint64_t seed = 0; seed < 5; ++seed)
    EXPECT_LT((Chords<TypeParam::value>{ControllerOptions{.method = Method::force_projected}, seed}.apart), 1e-12);
}

TYPED_TEST(EnergyOf, ABallThatIsOnlyWatchedGoesBelowZero) {
  double least = 0.0;
  for (std::uint64_t seed = 0; seed < 5; ++seed)
    least = std::min(least, Chords<TypeParam::value>{ControllerOptions{.method = Method::none}, seed}.least_exact);
  EXPECT_LT(least, -1e-3);
}

TYPED_TEST(EnergyOf, APassivatedBallNeverGoesBelowZero) {
  for (Method method : {Method::classic, Method::force_projected})
    for (double gain : {0.0, 10.0})
      for (std::uint64_t seed = 0; seed < 5; ++seed) {
        const Chords<TypeParam::value> chords{ControllerOptions{.method = method, .max_gain = gain}, seed};
        EXPECT_GE(chords.least_told, kFloor) << "method " << static_cast<int>(method) << " seed " << seed;
        EXPECT_GE(chords.least_exact, kFloor) << "method " << static_cast<int>(method) << " seed " << seed;
      }
}

// The hand's path is imposed, so its mass is not known: the bound holds where no tick moves the port twice as fast as lately, and
// it turns where no force is held.
TYPED_TEST(EnergyOf, ABallBehindTheEnergySpringReturnsNoMoreThanItsInitialEnergy) {
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    const Chords<TypeParam::value> chords{
        EnergySpringOptions{
            .stiffness_n_per_m = 5000.0, .rotational_stiffness_n_m_per_rad = 50.0, .initial = Energy{1e-4}},
        seed};
    EXPECT_LT(chords.apart, 1e-12) << seed;
    EXPECT_GE(chords.least_exact, kFloor) << seed;
  }
}

// --- reference energy and ledger -----------------------------------------------------------------

TYPED_TEST(EnergyOf, ASpringFollowsItsReferenceFromAbove) {
  // E >= K x²/2 at every tick, not only E >= 0; classic, because at x = 0 there is no force to act along.
  constexpr int N = TypeParam::value;
  constexpr int kAxes = N == 1 ? 1 : 3;
  constexpr double kStiffness = 3000.0;
  Source source{77};
  Observer<1> observer;
  const auto stored = [](const auto& x) { return 0.5 * kStiffness * x.squaredNorm(); };
  Position<N> x;
  Velocity<N> v;
  double above = 0.0;
  for (int k = 0; k < 5000; ++k) {
    typename Velocity<N>::Vector kick = v.vec();  // along the translational axes
    kick.template head<kAxes>() = 0.95 * kick.template head<kAxes>() + 0.02 * source.vector<kAxes>();
    v = Velocity<N>{kick};
    const Position<N> next = x + v * kPeriod;
    const Energy rise{stored(coordinates(next)) - stored(coordinates(x))};
    const auto c = passivity_controller(Force<N>{kStiffness * coordinates(x)}, v,
                                        Budget{observer.energy() - Energy{stored(coordinates(x))}, rise},
                                        {.method = Method::classic, .max_gain = 0.0}, kPeriod);
    observer.book(0, held_energy(ObserverRule::exact, c.out, Interval<N>{next - x, v, v}, kPeriod));
    x = next;
    ASSERT_GE(observer.energy().si() - stored(coordinates(x)), kFloor) << "tick " << k;
    above = std::max(above, observer.energy().si() - stored(coordinates(x)));
  }
  EXPECT_LT(above, -kFloor);  // and no credit is saved up
}

TEST(LedgerOfAnyMotion, TotalsNeverFall) {
  Source source{99};
  Ledger ledger;
  Energy absorbed, returned;
  double sum = 0.0, size = 0.0;
  for (int k = 0; k < 100'000; ++k) {
    const double e = k % 10 == 0 ? 0.0 : source.vector<1>()[0] * std::pow(10.0, source.uniform(-12.0, 2.0));
    ledger.book(Energy{e});
    sum += e;
    size += std::abs(e);
    ASSERT_GE(ledger.absorbed(), absorbed);
    ASSERT_GE(ledger.returned(), returned);
    absorbed = ledger.absorbed();
    returned = ledger.returned();
  }
  EXPECT_NEAR(ledger.net().si(), sum, 1e-13 * size);  // 1e5 terms, rounded at random
  EXPECT_NEAR((absorbed + returned).si(), size, 1e-13 * size);
}

}  // namespace
}  // namespace twoport::energy_test
