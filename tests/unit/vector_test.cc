#include "common/base/vector.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <initializer_list>
#include <limits>
#include <numbers>
#include <random>

#include "common/base/time.h"

namespace twoport::vector_test {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using namespace literals;

template <class A, class B>
concept Adds = requires(const A& a, const B& b) {
  a + b;
};
template <class A, class B>
concept Subtracts = requires(const A& a, const B& b) {
  a - b;
};
template <class A, class B>
concept Dots = requires(const A& a, const B& b) {
  dot(a, b);
};
template <class A, class B>
concept Multiplies = requires(const A& a, const B& b) {
  a* b;
};
template <class A, class B>
concept Divides = requires(const A& a, const B& b) {
  a / b;
};
template <class A, class B>
concept Compares = requires(const A& a, const B& b) {
  a < b;
};
template <class Clock>
concept CanBeAsked = requires {
  Clock::now();
};

// Kinds do not mix in sums.
static_assert(Adds<Force<3>, Force<3>>);
static_assert(!Adds<Force<3>, Velocity<3>>);
static_assert(!Subtracts<Velocity<3>, Displacement<3>>);
static_assert(!Adds<Force<3>, Force<6>>);
static_assert(!Adds<Position<3>, Position<3>>);
static_assert(!Adds<Position<6>, Displacement<3>>);
static_assert(std::same_as<decltype(Position<6>{} - Position<6>{}), Displacement<6>>);
static_assert(std::same_as<decltype(Position<6>{} + Displacement<6>{}), Position<6>>);

// Nor do they convert into each other.
static_assert(!std::constructible_from<Velocity<3>, Force<3>>);
static_assert(!std::constructible_from<Displacement<3>, Velocity<3>>);
static_assert(!std::constructible_from<Velocity<6>, Velocity<3>>);
static_assert(!std::convertible_to<Vector3d, Force<3>>);
static_assert(!std::convertible_to<Force<3>, Vector3d>);
static_assert(std::constructible_from<Force<3>, Vector3d>);
static_assert(!std::convertible_to<double, Energy>);
static_assert(!std::constructible_from<Energy, Power>);

// They multiply only into their duals.
static_assert(std::same_as<decltype(dot(Force<6>{}, Velocity<6>{})), Power>);
static_assert(std::same_as<decltype(dot(Velocity<6>{}, Force<6>{})), Power>);
static_assert(std::same_as<decltype(dot(Force<6>{}, Displacement<6>{})), Energy>);
static_assert(!Dots<Force<3>, Force<3>>);
static_assert(!Dots<Velocity<3>, Velocity<3>>);
static_assert(!Dots<Velocity<3>, Displacement<3>>);
static_assert(!Dots<Force<3>, Velocity<6>>);
static_assert(std::same_as<decltype(Velocity<3>{} * Seconds{}), Displacement<3>>);
static_assert(std::same_as<decltype(Displacement<3>{} / Seconds{}), Velocity<3>>);
static_assert(!Multiplies<Force<3>, Seconds>);
static_assert(!Divides<Velocity<3>, Seconds>);

// Kinds of numbers do not mix either.
static_assert(std::same_as<decltype(Power{} * Seconds{}), Energy>);
static_assert(!Adds<Energy, Power>);
static_assert(!Adds<Energy, double>);
static_assert(!Multiplies<Energy, Energy>);
static_assert(!Compares<Energy, Power>);
static_assert(Energy{3.0} / Energy{2.0} == 1.5);
static_assert(positive_part(-1.0_J) == 0.0_J && positive_part(2.0_J) == 2.0_J);
static_assert(-(3.0_J - 1.0_J) < 0.5 * 1.0_J);

// The clocks of the two sides cannot be asked, and their moments do not subtract.
static_assert(!CanBeAsked<MasterClock> && !CanBeAsked<SlaveClock>);
static_assert(Subtracts<Instant<MasterClock>, Instant<MasterClock>>);
static_assert(!Subtracts<Instant<MasterClock>, Instant<SlaveClock>>);
static_assert(!Compares<Instant<MasterClock>, Instant<SlaveClock>>);

TEST(TickTime, IsRoundedOnceAndNeverDrifts) {
  // 1/3000 s is no whole number of nanoseconds; a million rounded periods would be 0.33 ms off.
  EXPECT_EQ(tick_time(3'000'000, 3000.0), Duration{1'000'000'000'000});
  EXPECT_EQ(tick_time(1, 3000.0), Duration{333'333});
  EXPECT_EQ(tick_time(2, 3000.0), Duration{666'667});
  EXPECT_EQ(to_duration(0.05), Duration{50'000'000});
  EXPECT_EQ(to_seconds(Duration{50'000'000}).si(), 0.05);
}

TEST(Coords, StartAtZeroAndAddAxisByAxis) {
  Force<3> f;
  EXPECT_EQ(f.squared_norm(), 0.0);
  f += Force<3>{Vector3d{1, 2, 3}};
  f = 2.0 * f - Force<3>{Vector3d{1, 1, 1}};
  EXPECT_EQ(f.vec(), (Vector3d{1, 3, 5}));
  EXPECT_EQ((-f).vec(), (Vector3d{-1, -3, -5}));
  EXPECT_EQ(f[2], 5.0);
  EXPECT_EQ(dot(f, Velocity<3>{Vector3d{1, 10, 100}}).si(), 531.0);
}

TEST(Coords, AreFiniteOnlyWhenEveryAxisIs) {
  for (int axis = 0; axis < 6; ++axis) {
    for (double bad : {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()}) {
      Force<6>::Vector v = Force<6>::Vector::Ones();
      EXPECT_TRUE(Force<6>{v}.finite());
      v[axis] = bad;
      EXPECT_FALSE(Force<6>{v}.finite()) << "axis " << axis;
    }
  }
  EXPECT_FALSE((Position<6>{Vector3d::Zero(), Quaterniond{1, 0, std::nan(""), 0}}.finite()));
  EXPECT_FALSE((Position<6>{Vector3d{0, 0, std::nan("")}, Quaterniond::Identity()}.finite()));
}

// --- rotations -----------------------------------------------------------------------------------

Vector3d random_axis(std::mt19937_64& rng) {
  std::normal_distribution<double> n;
  return Vector3d{n(rng), n(rng), n(rng)}.normalized();
}

/// |a - b| / |b|, in extended precision.
double relative_error(const Vector3d& a, const Eigen::Matrix<long double, 3, 1>& b) {
  return static_cast<double>((a.cast<long double>() - b).norm() / b.norm());
}

// 8e-16 is under four roundings of 2^-53 each way; no truncation of a series hides in it.
constexpr double kFewRoundings = 8e-16;

TEST(RotationVector, ComesBackFromItsQuaternionFromTinyToNearPi) {
  std::mt19937_64 rng{20240611};
  std::uniform_real_distribution<double> exponent{-150.0, std::log10(3.0)};
  for (int i = 0; i < 20'000; ++i) {
    const Vector3d r = std::pow(10.0, exponent(rng)) * random_axis(rng);
    // A factor of 1.5: two functions, one after the other.
    ASSERT_LT(relative_error(rotation_vector(rotation(r)), r.cast<long double>()), 1.5 * kFewRoundings)
        << r.transpose();
  }
}

TEST(RotationVector, ComesBackUpToOneRoundingBelowPi) {
  std::mt19937_64 rng{7};
  for (double below : {1e-1, 1e-3, 1e-6, 1e-9, 1e-12, 1e-15}) {
    for (int i = 0; i < 100; ++i) {
      const Vector3d r = (std::numbers::pi - below) * random_axis(rng);
      ASSERT_LT(relative_error(rotation_vector(rotation(r)), r.cast<long double>()), 1.5 * kFewRoundings)
          << "pi - " << below;
    }
  }
}

TEST(RotationVector, OfMoreThanHalfATurnIsTheShorterWayRound) {
  std::mt19937_64 rng{8};
  for (double angle : {3.2, 4.0, 6.0, 6.28}) {
    const Vector3d axis = random_axis(rng);
    const Vector3d r = rotation_vector(rotation(angle * axis));
    // Absolute: the angle itself is rounded at 2 pi.
    EXPECT_LT((r - (angle - 2.0 * std::numbers::pi) * axis).norm(), 4e-15);
  }
}

TEST(RotationVector, DoesNotDependOnTheSignOfTheQuaternion) {
  std::mt19937_64 rng{9};
  for (double angle : {1e-9, 0.01, 0.5, 3.0}) {
    const Quaterniond q = rotation(angle * random_axis(rng));
    EXPECT_EQ(rotation_vector(q), rotation_vector(Quaterniond{-q.coeffs()}));
  }
  EXPECT_EQ(rotation_vector(Quaterniond::Identity()), Vector3d::Zero());
  EXPECT_EQ(rotation(Vector3d::Zero()).coeffs(), Quaterniond::Identity().coeffs());
}

TEST(RotationVector, HasNoSeamBetweenSeriesAndClosedForm) {
  // The seam is at |sin(theta/2)| = 0.02; both sides against extended precision.
  std::mt19937_64 rng{10};
  std::uniform_real_distribution<double> near{0.9, 1.1};
  for (int i = 0; i < 20'000; ++i) {
    const double half = std::asin(0.02) * near(rng);
    const Eigen::Matrix<long double, 3, 1> axis = random_axis(rng).cast<long double>().normalized();
    const long double h = half;
    const Vector3d v = (std::sin(h) * axis).cast<double>();
    const Quaterniond q{static_cast<double>(std::cos(h)), v.x(), v.y(), v.z()};
    ASSERT_LT(relative_error(rotation_vector(q), 2.0L * h * axis), kFewRoundings) << "half angle " << half;
  }
}

TEST(Rotation, HasNoSeamBetweenSeriesAndClosedForm) {
  // The seam is at 0.02 rad.
  std::mt19937_64 rng{11};
  std::uniform_real_distribution<double> near{0.9, 1.1};
  for (int i = 0; i < 20'000; ++i) {
    const Vector3d r = 0.02 * near(rng) * random_axis(rng);
    const long double h = 0.5L * r.cast<long double>().norm();
    const Quaterniond q = rotation(r);
    ASSERT_LT(std::abs(static_cast<double>(static_cast<long double>(q.w()) / std::cos(h) - 1.0L)), kFewRoundings);
    ASSERT_LT(relative_error(q.vec(), (std::sin(h) / h * 0.5L) * r.cast<long double>()), kFewRoundings);
  }
}

TEST(Rotation, AgreesWithEigensAngleAxis) {
  std::mt19937_64 rng{12};
  std::uniform_real_distribution<double> angle{1e-6, 6.0};
  for (int i = 0; i < 1'000; ++i) {
    const double a = angle(rng);
    const Vector3d axis = random_axis(rng);
    const Quaterniond theirs{Eigen::AngleAxisd{a, axis}};
    // Absolute: both are unit quaternions.
    ASSERT_LT((rotation(a * axis).coeffs() - theirs.coeffs()).norm(), 1e-15);
  }
}

// --- positions -----------------------------------------------------------------------------------

Position<6> random_pose(std::mt19937_64& rng) {
  std::uniform_real_distribution<double> angle{0.0, 3.1}, metre{-1.0, 1.0};
  return {Vector3d{metre(rng), metre(rng), metre(rng)}, rotation(angle(rng) * random_axis(rng))};
}
double distance(const Position<6>& a, const Position<6>& b) {
  return std::max((a.translation() - b.translation()).norm(),
                  std::min((a.attitude().coeffs() - b.attitude().coeffs()).norm(),
                           (a.attitude().coeffs() + b.attitude().coeffs()).norm()));
}

TEST(Pose, PlusTheDifferenceIsTheOtherPose) {
  std::mt19937_64 rng{13};
  for (int i = 0; i < 10'000; ++i) {
    const Position<6> a = random_pose(rng), b = random_pose(rng);
    // Absolute, of numbers of order one: ten roundings.
    ASSERT_LT(distance(b + (a - b), a), 2e-15);
  }
}

TEST(Pose, PlusADisplacementDiffersByThatDisplacement) {
  std::mt19937_64 rng{14};
  std::uniform_real_distribution<double> exponent{-8.0, 0.0};
  for (int i = 0; i < 10'000; ++i) {
    const Position<6> a = random_pose(rng);
    Displacement<6>::Vector d;
    d << std::pow(10.0, exponent(rng)) * random_axis(rng), 3.0 * std::pow(10.0, exponent(rng)) * random_axis(rng);
    // Absolute: a small displacement is the difference of two poses of order one.
    ASSERT_LT((((a + Displacement<6>{d}) - a).vec() - d).norm(), 3e-15);
  }
}

TEST(Pose, TurnsInWorldAxesWhateverItsAttitude) {
  std::mt19937_64 rng{15};
  const Position<6> a = random_pose(rng);
  Displacement<6>::Vector d;
  d << 0, 0, 0, 0, 0, std::numbers::pi / 2;  // a quarter turn about the world's z
  const Vector3d arm = a.attitude() * Vector3d{1, 2, 3};
  const Vector3d turned = (a + Displacement<6>{d}).attitude() * Vector3d{1, 2, 3};
  EXPECT_LT((turned - Vector3d{-arm.y(), arm.x(), arm.z()}).norm(), 4e-15);  // 4 roundings of a length of 3.7
}

TEST(Pose, StaysOnTheUnitSphereOverAMillionSteps) {
  std::mt19937_64 rng{16};
  std::uniform_real_distribution<double> small{-0.01, 0.01};
  Position<6> x;
  for (int i = 0; i < 1'000'000; ++i) {
    Displacement<6>::Vector d;
    d << 0, 0, 0, small(rng), small(rng), small(rng);
    x = x + Displacement<6>{d};
  }
  EXPECT_NEAR(x.attitude().norm(), 1.0, 5e-16);  // does not grow with the number of steps
}

TEST(Pose, AFullTurnInSmallStepsComesHome) {
  constexpr int kSteps = 100'000;
  const Vector3d step = Vector3d{1, -2, 2}.normalized() * (2.0 * std::numbers::pi / kSteps);
  Displacement<6>::Vector d;
  d << Vector3d::Constant(1e-5), step;
  Position<6> x;
  for (int i = 0; i < kSteps; ++i) x = x + Displacement<6>{d};
  // The step is rounded once and repeated, and each product is rounded: 1e5 roundings at most.
  EXPECT_LT(rotation_vector(x.attitude()).norm(), 1e5 * 1.2e-16);
  EXPECT_LT((x.translation() - Vector3d::Ones()).norm(), 1e-11);
}

TEST(Position, WrittenAsNumbersIsItsDifferenceFromTheOrigin) {
  EXPECT_EQ(coordinates(Position<3>{Vector3d{1, 2, 3}}), (Vector3d{1, 2, 3}));
  const Vector3d r{0.3, -0.2, 0.1};
  const auto c = coordinates(Position<6>{Vector3d{1, 2, 3}, rotation(r)});
  EXPECT_EQ(c.head<3>(), (Vector3d{1, 2, 3}));
  EXPECT_LT((c.tail<3>() - r).norm(), 2e-16);
}

}  // namespace
}  // namespace twoport::vector_test
