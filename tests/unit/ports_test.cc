#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <type_traits>
#include <utility>

#include "common/passivity/passivated.h"
#include "common/ports/port.h"
#include "tests/support/sizes.h"

namespace twoport {
namespace {

// --- elements ------------------------------------------------------------------------------------

/// Impedance. f(k) = K x(k), with x the sum of v T: what a sampled spring answers.
template <int N>
class Spring {
 public:
  using In = Velocity<N>;
  using Out = Force<N>;
  explicit Spring(double stiffness, Displacement<N> x = {}) : k_{stiffness}, x_{x} {}
  Out step(const In& v, Seconds dt) noexcept {
    x_ += v * dt;
    return Force<N>{k_ * x_.vec()};
  }
  const Displacement<N>& stretch() const { return x_; }

 private:
  double k_;
  Displacement<N> x_;
};

/// Impedance. f = B v. Remembers what it was given and what it answered.
template <int N>
class Damper {
 public:
  using In = Velocity<N>;
  using Out = Force<N>;
  explicit Damper(double damping) : b_{damping} {}
  Out step(const In& v, Seconds) noexcept {
    power_ = dot(Force<N>{b_ * v.vec()}, v);
    return Force<N>{b_ * v.vec()};
  }
  [[nodiscard]] Power power() const { return power_; }

 private:
  double b_;
  Power power_;
};

/// Admittance. v(k) = v(k-1) + T f / m.
template <int N>
class Mass {
 public:
  using In = Force<N>;
  using Out = Velocity<N>;
  explicit Mass(double mass, Velocity<N> v = {}) : m_{mass}, v_{v} {}
  Out step(const In& f, Seconds dt) noexcept {
    v_ += Velocity<N>{(dt.si() / m_) * f.vec()};
    return v_;
  }

 private:
  double m_;
  Velocity<N> v_;
};

/// Lossless two-port: motion at the right is n times that at the left, force at the left n times that at the right.
template <int N>
class Lever {
 public:
  using LeftIn = Velocity<N>;
  using LeftOut = Force<N>;
  using RightIn = Force<N>;
  using RightOut = Velocity<N>;
  struct Out {
    LeftOut left;
    RightOut right;
  };
  explicit Lever(double ratio) : n_{ratio} {}
  Out step(const LeftIn& v, const RightIn& f, Seconds) noexcept { return {-n_ * f, n_ * v}; }

 private:
  double n_;
};

/// Two-port that takes velocities at both ends: f_left = K (x_left - x_right) + B (v_left - v_right) = -f_right.
template <int N>
class Rod {
 public:
  using LeftIn = Velocity<N>;
  using LeftOut = Force<N>;
  using RightIn = Velocity<N>;
  using RightOut = Force<N>;
  struct Out {
    LeftOut left;
    RightOut right;
  };
  Rod(double stiffness, double damping) : k_{stiffness}, b_{damping} {}
  Out step(const LeftIn& left, const RightIn& right, Seconds dt) noexcept {
    stretch_ += (left - right) * dt;
    const Force<N> f{k_ * stretch_.vec() + b_ * (left - right).vec()};
    return {f, -f};
  }

 private:
  double k_, b_;
  Displacement<N> stretch_;
};

struct Throws : Spring<3> {
  using Spring<3>::Spring;
  Out step(const In& v, Seconds dt) { return Spring<3>::step(v, dt); }
};
struct VelocityToVelocity {
  using In = Velocity<3>;
  using Out = Velocity<3>;
  Out step(const In& v, Seconds) noexcept { return v; }
};

template <class Z, class Y>
concept HasJoint = requires {
  typename Joined<Z, Y>;
};
template <class T, class E>
concept HasEnd = requires {
  typename Terminated<T, E>;
};

// --- what compiles -------------------------------------------------------------------------------

TEST(OnePort, IsAStepBetweenDualsThatDoesNotThrow) {
  static_assert(OnePort<Spring<1>> && OnePort<Spring<6>> && OnePort<Mass<3>>);
  static_assert(!OnePort<Throws>);
  static_assert(!OnePort<VelocityToVelocity>);
  static_assert(!OnePort<Lever<3>>);
}

TEST(PowerDual, IsAForceAndAVelocityOfOneSizeInEitherOrder) {
  static_assert(PowerDual<Force<6>, Velocity<6>> && PowerDual<Velocity<1>, Force<1>>);
  static_assert(!PowerDual<Force<3>, Force<3>> && !PowerDual<Velocity<3>, Velocity<3>>);
  static_assert(!PowerDual<Force<3>, Velocity<6>>);
  static_assert(!PowerDual<Force<3>, Displacement<3>>);  // that is an energy
}

TEST(Joinable, TwoImpedancesDoNotJoin) {
  static_assert(Joinable<Spring<3>, Mass<3>> && Joinable<Mass<3>, Spring<3>>);
  static_assert(!Joinable<Spring<3>, Spring<3>>);  // nobody sets the velocity
  static_assert(!Joinable<Spring<3>, Damper<3>>);
  static_assert(!HasJoint<Spring<3>, Damper<3>>);
}

TEST(Joinable, TwoAdmittancesDoNotJoin) {
  static_assert(!Joinable<Mass<3>, Mass<3>>);  // nobody sets the force
  static_assert(!HasJoint<Mass<3>, Mass<3>>);
}

TEST(Joinable, SizesDoNotMix) {
  static_assert(!Joinable<Spring<3>, Mass<6>>);
}

TEST(Joined, NamesTheImpedanceFirst) {
  static_assert(HasJoint<Spring<6>, Mass<6>>);
  static_assert(!HasJoint<Mass<6>, Spring<6>>);
}

TEST(Passivated, StaysInTheFamilyInBothCausalities) {
  static_assert(OnePort<Passivated<Spring<3>>> && OnePort<Passivated<Mass<6>>>);
  static_assert(Joinable<Passivated<Spring<3>>, Mass<3>> && Joinable<Spring<3>, Passivated<Mass<3>>>);
  static_assert(!Joinable<Passivated<Spring<3>>, Spring<3>>);
}

TEST(Terminated, IsAOnePortWhoseEndMustFit) {
  static_assert(TwoPort<Lever<3>> && TwoPort<Rod<6>> && !TwoPort<Spring<3>>);
  static_assert(OnePort<Terminated<Lever<3>, Damper<3>>> && OnePort<Terminated<Rod<6>, Mass<6>>>);
  static_assert(Joinable<Terminated<Lever<3>, Damper<3>>, Mass<3>>);
  static_assert(!HasEnd<Lever<3>, Mass<3>>);  // both would set the velocity
  static_assert(!HasEnd<Rod<3>, Damper<3>>);  // both would set the force
  static_assert(!HasEnd<Lever<3>, Damper<6>>);
}

// --- what happens --------------------------------------------------------------------------------

template <class Size>
class Ports : public ::testing::Test {
 public:
  using Vector = typename Force<Size::value>::Vector;
  static Vector ramp() { return Vector::LinSpaced(Size::value, 0.3, 1.4); }  // a different number on every axis
};
TYPED_TEST_SUITE(Ports, test::Sizes, test::SizeName);

constexpr Seconds kPeriod{1e-3};

TYPED_TEST(Ports, AMassOnASampledSpringSwingsAtTheSampledFrequency) {
  // v(k) = v(k-1) - T K/m x(k-1), x(k) = x(k-1) + T v(k) has the solution x(k) = v0 T sin(k th)/sin(th),
  // cos(th) = 1 - K T²/(2m); by hand from its characteristic polynomial z² - 2 cos(th) z + 1.
  constexpr int N = TypeParam::value;
  constexpr double kMass = 0.5, kStiffness = 300.0;
  const Velocity<N> v0{this->ramp()};
  Joined joint{Spring<N>{kStiffness}, Mass<N>{kMass, v0}};
  const double th = std::acos(1.0 - kStiffness * kPeriod.si() * kPeriod.si() / (2.0 * kMass));
  for (int k = 1; k <= 5000; ++k) {
    const auto sample = joint.step(kPeriod);
    const double factor = kPeriod.si() * std::sin(k * th) / std::sin(th);
    const auto x = joint.impedance().stretch();
    // Relative to the amplitude, 1/sin(th) T = 0.04 m: the phase k·th is rounded at 1e2 rad.
    ASSERT_LT((x.vec() - factor * v0.vec()).norm(), 1e-12 * v0.vec().norm()) << "step " << k;
    ASSERT_EQ(sample.f.vec(), (kStiffness * x.vec()).eval());
  }
}

TYPED_TEST(Ports, AMassFeelsTheSpringsForceOnePeriodLate) {
  constexpr int N = TypeParam::value;
  const Velocity<N> v0{this->ramp()};
  Joined joint{Spring<N>{100.0}, Mass<N>{1.0, v0}};
  const auto first = joint.step(kPeriod);
  EXPECT_EQ(first.v.vec(), v0.vec());  // no force yet
  const auto second = joint.step(kPeriod);
  EXPECT_EQ(second.v.vec(), (v0.vec() - kPeriod.si() * first.f.vec()).eval());
}

TYPED_TEST(Ports, WhatOneElementAnswersReachesItsNeighbourWithVelocityCommonAndForceOpposite) {
  constexpr int N = TypeParam::value;
  EXPECT_EQ(across(Velocity<N>{this->ramp()}).vec(), this->ramp());
  EXPECT_EQ(across(Force<N>{this->ramp()}).vec(), (-this->ramp()).eval());
}

TYPED_TEST(Ports, ALeverOnADamperPassesAllPowerOn) {
  // Every period: power into the left port = power that the damper took the period before, at the velocity of now.
  constexpr int N = TypeParam::value;
  constexpr double kRatio = 2.5, kDamping = 4.0;
  Terminated chain{Lever<N>{kRatio}, Damper<N>{kDamping}};
  const Velocity<N> v{this->ramp()};
  EXPECT_EQ(chain.step(v, kPeriod).squared_norm(), 0.0);  // nothing has come back yet
  for (int k = 0; k < 10; ++k) {
    const Force<N> f = chain.step(v, kPeriod);
    // 4 roundings per product.
    EXPECT_NEAR(dot(f, v) / chain.end().power(), 1.0, 1e-15);
    EXPECT_GT(dot(f, v).si(), 0.0);
  }
}

TYPED_TEST(Ports, ALeverOnADamperIsADamperTimesTheRatioSquared) {
  constexpr int N = TypeParam::value;
  constexpr double kRatio = 2.5, kDamping = 4.0;
  Terminated chain{Lever<N>{kRatio}, Damper<N>{kDamping}};
  typename Force<N>::Vector before = Force<N>::Vector::Zero();
  for (int k = 0; k < 100; ++k) {
    const Velocity<N> v{std::sin(0.1 * k) * this->ramp()};
    const Force<N> f = chain.step(v, kPeriod);
    EXPECT_LE((f.vec() - kRatio * kRatio * kDamping * before).norm(), 1e-15 * f.vec().norm()) << "step " << k;
    before = v.vec();
  }
}

TYPED_TEST(Ports, AMassAtTheEndOfARodFollowsTheHand) {
  // Not its mirror image: the velocity is common where the rod and the mass meet.
  constexpr int N = TypeParam::value;
  Terminated chain{Rod<N>{400.0, 40.0}, Passivated{Mass<N>{0.5}, ControllerOptions{}}};
  Displacement<N> hand, mass;
  for (int k = 0; k < 2000; ++k) {
    const Velocity<N> v{(k < 500 ? 1.0 : 0.0) * this->ramp()};
    hand += v * kPeriod;
    chain.step(v, kPeriod);
    mass += chain.end().last().out * kPeriod;
  }
  // After 1.5 s at rest (a swing that decays within 0.1 s) the rod is as long as it was.
  EXPECT_LT((mass - hand).vec().norm(), 1e-6 * hand.vec().norm());
}

TYPED_TEST(Ports, ARodPushesTheHandBackWhileTheMassLags) {
  constexpr int N = TypeParam::value;
  Terminated chain{Rod<N>{400.0, 40.0}, Mass<N>{0.5}};
  const Velocity<N> v{this->ramp()};
  Energy into;
  for (int k = 0; k < 1000; ++k) into += dot(chain.step(v, kPeriod), v) * kPeriod;
  // A mass brought from rest to v by a hand that moves at v takes m v² from it: half moves, half is burnt.
  // Sampled at 1 ms against a time constant of 12 ms: within 10 %.
  EXPECT_NEAR(into.si(), 0.5 * v.squared_norm(), 0.05 * v.squared_norm());
}

}  // namespace
}  // namespace twoport
