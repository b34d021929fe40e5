#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <random>
#include <string>
#include <type_traits>

#include "common/base/vector.h"
#include "common/passivity/controller.h"
#include "tests/support/sizes.h"

namespace twoport::direction_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr Seconds kPeriod{5e-4};
constexpr double kUncapped = std::numeric_limits<double>::infinity();
constexpr int kSamples = 100'000;

/// A force, a velocity, what the account allows, and how the controller is set: sizes over nine decades.
template <int N>
struct Situation {
  Force<N> f;
  Velocity<N> v;
  Budget budget;
  ControllerOptions options;
};
class Source {
 public:
  explicit Source(std::uint64_t seed) : rng_{seed} {}
  double uniform(double from, double to) { return std::uniform_real_distribution<double>{from, to}(rng_); }
  double size() { return std::pow(10.0, uniform(-6.0, 3.0)); }
  bool coin() { return (rng_() & 1) != 0; }
  template <int N>
  Eigen::Matrix<double, N, 1> vector() {
    return Eigen::Matrix<double, N, 1>::NullaryExpr([this](Eigen::Index) { return normal_(rng_); });
  }
  Matrix3d turn() {
    const Eigen::Vector4d q = vector<4>().normalized();
    return Eigen::Quaterniond{q}.toRotationMatrix();
  }
  template <int N>
  Situation<N> situation(Method method) {
    Situation<N> s;
    s.f = Force<N>{size() * vector<N>()};
    s.v = Velocity<N>{size() * vector<N>()};
    // Budgets of the order of the energy at stake, from a thousandth to a thousand of it.
    const double stake = s.f.vec().norm() * s.v.vec().norm() * kPeriod.si();
    s.budget = {Energy{(coin() ? 1.0 : -1.0) * stake * std::pow(10.0, uniform(-3.0, 3.0))},
                Energy{(coin() ? 1.0 : -1.0) * stake * std::pow(10.0, uniform(-3.0, 3.0))}};
    s.options = {.method = method,
                 .max_gain = coin() ? kUncapped : std::pow(10.0, uniform(-3.0, 3.0)),
                 .unilateral = true,
                 .predict = coin()};
    return s;
  }

 private:
  std::mt19937_64 rng_;
  std::normal_distribution<double> normal_;
};
template <int N>
Corrected<Force<N>> correct(const Situation<N>& s) {
  return passivity_controller(s.f, s.v, s.budget, s.options, kPeriod);
}

/// Angle from f to u [deg], by atan2: an arc cosine is blind below 1e-6 deg. In six dimensions what is across f is
/// u less its part along f.
template <int N>
double angle_deg(const Eigen::Matrix<double, N, 1>& u, const Eigen::Matrix<double, N, 1>& f) {
  double across = 0.0;
  if constexpr (N == 3) {
    across = u.cross(f).norm() / f.norm();
  } else {
    const Eigen::Matrix<double, N, 1> unit = f.normalized();
    across = (u - u.dot(unit) * unit).norm();
  }
  return std::atan2(across, u.dot(f) / f.norm()) * 180.0 / std::numbers::pi;
}

template <class Size>
class Projected : public ::testing::Test {};
TYPED_TEST_SUITE(Projected, test::Sizes, test::SizeName);

TYPED_TEST(Projected, NeverTurnsTheForceAndNeverReversesIt) {
  constexpr int N = TypeParam::value;
  Source source{20240611};
  int changed = 0, withheld = 0;
  for (int i = 0; i < kSamples; ++i) {
    const auto s = source.template situation<N>(Method::force_projected);
    const auto u = correct(s).out.vec();
    changed += u != s.f.vec();
    if (u.isZero(0.0)) {
      ++withheld;
      continue;
    }
    // A number times a vector: one rounding per axis, 1e-16 rad = 6e-15 deg; and some in measuring it.
    ASSERT_LT((angle_deg<N>(u, s.f.vec())), 1e-9) << "sample " << i;
    ASSERT_GT(u.dot(s.f.vec()), 0.0) << "sample " << i;
  }
  EXPECT_GT(changed, kSamples / 4);
  EXPECT_GT(withheld, kSamples / 20);
}

TYPED_TEST(Projected, WithoutTheClampStaysOnTheLineOfTheForce) {
  constexpr int N = TypeParam::value;
  Source source{20240612};
  int reversed = 0;
  for (int i = 0; i < kSamples; ++i) {
    auto s = source.template situation<N>(Method::force_projected);
    s.options.unilateral = false;
    const auto u = correct(s).out.vec();
    if (u.isZero(0.0)) continue;
    const double angle = angle_deg<N>(u, s.f.vec());
    ASSERT_LT(std::min(angle, 180.0 - angle), 1e-9) << "sample " << i;
    reversed += angle > 90.0;
  }
  EXPECT_GT(reversed, kSamples / 20);  // the wall would pull: why there is a clamp
}

TEST(Classic, TurnsTheForce) {
  // The yardstick of the tests above sees it.
  Source source{20240613};
  int turned = 0;
  for (int i = 0; i < 1000; ++i) {
    const auto s = source.situation<3>(Method::classic);
    turned += angle_deg<3>(correct(s).out.vec(), s.f.vec()) > 1.0;
  }
  EXPECT_GT(turned, 100);
}

// --- frames --------------------------------------------------------------------------------------

/// The same rotation for force and torque, velocity and angular velocity.
template <int N>
Eigen::Matrix<double, N, 1> turned(const Matrix3d& r, const Eigen::Matrix<double, N, 1>& v) {
  Eigen::Matrix<double, N, 1> out;
  for (int half = 0; half < N / 3; ++half) out.template segment<3>(3 * half) = r * v.template segment<3>(3 * half);
  return out;
}

/// How much a relative error of f and v grows in f·v.
template <int N>
double condition(const Force<N>& f, const Velocity<N>& v) {
  return f.vec().norm() * v.vec().norm() / std::abs(dot(f, v).si());
}

template <int N>
void expect_same_in_every_frame(Method method, std::uint64_t seed) {
  Source source{seed};
  for (int i = 0; i < kSamples; ++i) {
    const auto s = source.situation<N>(method);
    const Matrix3d r = source.turn();
    auto other = s;
    other.f = Force<N>{turned<N>(r, s.f.vec())};
    other.v = Velocity<N>{turned<N>(r, s.v.vec())};
    const auto here = correct(s), there = correct(other);
    const Eigen::Matrix<double, N, 1> expected = turned<N>(r, here.out.vec());
    // 1e-12 while f and v are within 89.4 deg of each other. Beyond, f·v itself is known no better.
    const double tolerance = 1e-14 * std::max(100.0, condition(s.f, s.v));
    const double scale = std::max(here.out.vec().norm(), s.f.vec().norm());
    ASSERT_LT((there.out.vec() - expected).norm(), tolerance * scale) << "sample " << i;
    const double stake = here.dissipated.si() + s.f.vec().norm() * s.v.vec().norm() * kPeriod.si();
    ASSERT_NEAR(there.dissipated.si(), here.dissipated.si(), 1e-12 * stake) << "sample " << i;
  }
}
TEST(Projected3Dof, TurnsWithTheFrame) {
  expect_same_in_every_frame<3>(Method::force_projected, 11);
}
TEST(Projected6Dof, TurnsWithTheFrame) {
  expect_same_in_every_frame<6>(Method::force_projected, 12);
}
TEST(Classic3Dof, TurnsWithTheFrame) {
  expect_same_in_every_frame<3>(Method::classic, 13);
}
TEST(Classic6Dof, TurnsWithTheFrame) {
  expect_same_in_every_frame<6>(Method::classic, 14);
}

// --- units ---------------------------------------------------------------------------------------

/// Lengths in millimetres, all else as it was: N, N mm, mm/s, rad/s, mW, mJ, s.
constexpr double kMilli = 1e3;
Force<6> wrench_in_mm(const Force<6>& f) {
  Force<6>::Vector out = f.vec();
  out.tail<3>() *= kMilli;
  return Force<6>{out};
}
Velocity<6> twist_in_mm(const Velocity<6>& v) {
  Velocity<6>::Vector out = v.vec();
  out.head<3>() *= kMilli;
  return Velocity<6>{out};
}

TEST(Projected6Dof, DoesNotKnowTheUnitOfLength) {
  // Without the cap on the accumulated deficit: a damping along a wrench has to say what a radian is in metres.
  Source source{21};
  for (int i = 0; i < kSamples; ++i) {
    auto s = source.situation<6>(Method::force_projected);
    s.options.max_gain = kUncapped;
    s.options.unilateral = source.coin();
    auto mm = s;
    mm.f = wrench_in_mm(s.f);
    mm.v = twist_in_mm(s.v);
    mm.budget = {kMilli * s.budget.available, kMilli * s.budget.rise};
    const auto in_m = correct(s), in_mm = correct(mm);
    const double tolerance = 1e-14 * std::max(100.0, condition(s.f, s.v));  // as above
    // Force against force in N, torque against torque in N mm.
    const Force<6> expected = wrench_in_mm(in_m.out);
    const auto error = (in_mm.out.vec() - expected.vec()).eval();
    ASSERT_LT(error.head<3>().norm(), tolerance * std::max(s.f.vec().head<3>().norm(), in_m.out.vec().head<3>().norm()))
        << "sample " << i;
    ASSERT_LT(error.tail<3>().norm(),
              tolerance * std::max(mm.f.vec().tail<3>().norm(), expected.vec().tail<3>().norm()))
        << "sample " << i;
    const double stake = in_mm.dissipated.si() + mm.f.vec().norm() * mm.v.vec().norm() * kPeriod.si();
    ASSERT_NEAR(in_mm.dissipated.si(), kMilli * in_m.dissipated.si(), 1e-12 * stake) << "sample " << i;
  }
}

TEST(Classic6Dof, DependsOnTheUnitOfLength) {
  // Theory A5: V = (0.1 m/s, 1 rad/s); what translation takes of the dissipation is 1 % in m, 50 in dm, 99.99 in mm.
  const auto translation_part = [](double per_metre) {
    Velocity<6>::Vector v;
    v << 0.1 * per_metre, 0, 0, 0, 0, 1.0;
    const auto c = passivity_controller(Force<6>{}, Velocity<6>{v}, Budget{Energy{-per_metre}, Energy{}},
                                        {.method = Method::classic, .max_gain = kUncapped}, kPeriod);
    return c.out.vec().head<3>().dot(v.head<3>()) / c.out.vec().dot(v);
  };
  EXPECT_NEAR(translation_part(1.0), 1.0 / 101.0, 1e-12);
  EXPECT_NEAR(translation_part(10.0), 0.5, 1e-12);
  EXPECT_NEAR(translation_part(1e3), 1e4 / 10001.0, 1e-12);
}

// --- reference points ----------------------------------------------------------------------------

/// The same wrench and the same motion, told at a point r away.
Force<6> wrench_at(const Vector3d& r, const Force<6>& f) {
  Force<6>::Vector out = f.vec();
  out.tail<3>() -= r.cross(f.vec().head<3>());
  return Force<6>{out};
}
Velocity<6> twist_at(const Vector3d& r, const Velocity<6>& v) {
  Velocity<6>::Vector out = v.vec();
  out.head<3>() += v.vec().tail<3>().cross(r);
  return Velocity<6>{out};
}

TEST(Power6Dof, DoesNotDependOnTheReferencePoint) {
  Source source{31};
  for (int i = 0; i < kSamples; ++i) {
    const auto s = source.situation<6>(Method::none);
    const Vector3d r = source.vector<3>();
    const Force<6> f = wrench_at(r, s.f);
    const Velocity<6> v = twist_at(r, s.v);
    // Relative to the products that are added.
    ASSERT_NEAR(dot(f, v).si(), dot(s.f, s.v).si(), 1e-14 * f.vec().norm() * v.vec().norm()) << "sample " << i;
  }
}

TEST(Projected6Dof, DoesNotDependOnTheReferencePoint) {
  Source source{32};
  for (int i = 0; i < kSamples; ++i) {
    auto s = source.situation<6>(Method::force_projected);
    s.options.max_gain = kUncapped;
    const Vector3d r = source.vector<3>();
    auto moved = s;
    moved.f = wrench_at(r, s.f);
    moved.v = twist_at(r, s.v);
    const auto here = correct(s), there = correct(moved);
    const Force<6> expected = wrench_at(r, here.out);
    // As above; the power is now a sum of the larger products at the other point.
    const double products = std::max(moved.f.vec().norm() * moved.v.vec().norm(), s.f.vec().norm() * s.v.vec().norm());
    const double tolerance = 1e-14 * std::max(100.0, products / std::abs(dot(s.f, s.v).si()));
    ASSERT_LT((there.out.vec() - expected.vec()).norm(),
              tolerance * std::max(expected.vec().norm(), moved.f.vec().norm()))
        << "sample " << i;
  }
}

}  // namespace
}  // namespace twoport::direction_test
