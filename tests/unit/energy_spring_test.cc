#include "common/passivity/energy_spring.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

namespace twoport::energy_spring_test {
namespace {

Force<3> along_x(double n) {
  return Force<3>{Eigen::Vector3d{n, 0.0, 0.0}};
}
Displacement<3> moved_x(double m) {
  return Displacement<3>{Eigen::Vector3d{m, 0.0, 0.0}};
}

constexpr double kStiffness_n_per_m = 1000.0;

/// A handle that is pushed out against a wanted force of 100 N from rest with `initial`, in steps of `step_m`. Returns the
/// energy that has left.
double given_back_j(EnergySpring<3> spring, double step_m, int steps) {
  const Seconds dt{1e-3};
  double net = 0.0;
  Force<3> f;
  for (int k = 0; k < steps; ++k) {
    const Displacement<3> moved = moved_x(k == 0 ? 0.0 : -step_m);
    net += dot(f, moved).si();
    spring.observe(Energy{net}, moved, f, dt, dt);
    f = spring.scale(along_x(100.0), dt) * along_x(100.0);
  }
  return -net;
}

/// After ten seconds at rest: the reach d is that of the tick's own motion.
EnergySpring<3> rested(EnergySpring<3> spring) {
  const Seconds dt{1e-3};
  for (int k = 0; k < 10000; ++k) spring.observe(Energy{}, moved_x(0.0), Force<3>{}, dt, dt);
  return spring;
}

// dE = -sqrt(2 K E) dx: the way of a spring K that gives back E. It ends after sqrt(2E/K) = 4.5 mm.
TEST(EnergySpring, GivesBackWhatItHoldsAndNoMore) {
  const EnergySpring<3> spring = rested({Energy{10e-3}, kStiffness_n_per_m, 0.0, 0.0, 0.0});
  EXPECT_NEAR(given_back_j(spring, 1e-5, 1000), 10e-3, 1e-4);  // K δ: 1 % of sqrt(2 K E)
  EXPECT_LE(given_back_j(spring, 1e-5, 1000), 10e-3 * (1.0 + 1e-12));
}

// Without a mass there is no prediction: it misses at most K δ²/2.
TEST(EnergySpring, MissesAtMostTheEnergyOfOneTickWithoutAPrediction) {
  for (const double step : {1e-4, 1e-3, 3e-3}) {
    const EnergySpring<3> spring{Energy{1e-3}, kStiffness_n_per_m, 0.0, 0.0, 0.0};
    EXPECT_LE(given_back_j(spring, step, 100), 1e-3 + 0.5 * kStiffness_n_per_m * step * step) << step;
  }
}

TEST(EnergySpring, ShowsTheForceOfASpringThatHoldsTheEnergy) {
  EnergySpring<3> spring = rested({Energy{2e-3}, kStiffness_n_per_m, 0.0, 0.0, 0.0});
  EXPECT_DOUBLE_EQ(spring.scale(along_x(10.0), Seconds{1e-3}), 0.2);  // sqrt(2·1000·2e-3) = 2 N
  EXPECT_EQ(spring.scale(along_x(1.9), Seconds{1e-3}), 1.0);
  spring.restart(Energy{}, Energy{-5e-3});
  EXPECT_EQ(spring.scale(along_x(1.9), Seconds{1e-3}), 0.0);
  EXPECT_DOUBLE_EQ(spring.undissipated().si(), 3e-3);
  EXPECT_EQ(spring.scale({}, Seconds{1e-3}), 1.0);
}

// A torque counts by K/K_r: 0.1 N m at 10 N m/rad is as far as 1 N at 100 N/m.
TEST(EnergySpring, WeighsATorqueByTheStiffnesses) {
  const EnergySpring<6> spring{Energy{1e-3}, 100.0, 10.0, 0.0, 0.0};
  Force<6>::Vector f = Force<6>::Vector::Zero();
  f[4] = 0.1;
  EXPECT_DOUBLE_EQ(spring.norm(Force<6>{f}, Seconds{1e-3}), std::sqrt(0.1));
}

/// A damping b on a mass m, held for T, with bT/m beyond 2: each tick turns the velocity round and makes it larger.
double least_energy_of_a_damper_j(bool with_account) {
  const Seconds dt{0.01};
  const double mass = 0.05, damping = 15.0;  // bT/m = 3
  DamperAccount<3> account;
  const EnergySpring<3> port{Energy{1.0}, kStiffness_n_per_m, 0.0, 0.0, 0.0};  // predicts nothing
  double x_step = 0.0, v = 0.1, net = 0.0, least = 0.0, before = 0.0;
  std::mt19937 random{1};
  for (int k = 0; k < 500; ++k) {
    net += before * x_step;
    least = std::min(least, net);
    account.observe(moved_x(x_step), 1.0, dt);
    const Force<3> wanted = along_x(damping * v);
    const double f = with_account ? account.apply(wanted, Velocity<3>{}, port, dt)[0] : wanted[0];
    before = f;
    v = std::clamp(v - f * dt.si() / mass, -3.0, 3.0);
    x_step = v * dt.si();
    v += 0.02 * std::normal_distribution<>{}(random);  // the hand
  }
  return least;
}

// No stiffer than the sampled handle: K <= m/(4T²), so that one tick misses no more than a quarter of the handle's kinetic energy
// at the speed of that tick. Force alone: sqrt(2·1000·20e-3) = 6.3 N without a mass, 0.632 N with 0.1 kg/(4·(50 ms)²) = 10 N/m.
TEST(EnergySpring, IsNoStifferThanTheSampledHandleAllows) {
  const Seconds slow{0.05}, fast{1e-3};
  const EnergySpring<3> unknown{Energy{20e-3}, kStiffness_n_per_m, 0.0, 0.0, 0.0};
  const EnergySpring<3> known{Energy{20e-3}, kStiffness_n_per_m, 0.0, 0.1, 0.0};
  EXPECT_DOUBLE_EQ(unknown.stiffness(slow), kStiffness_n_per_m);
  EXPECT_DOUBLE_EQ(known.stiffness(slow), 10.0);
  EXPECT_DOUBLE_EQ(known.stiffness(fast), kStiffness_n_per_m);
  EXPECT_LE(known.scale(along_x(10.0), slow) * 10.0, std::sqrt(2.0 * 10.0 * 20e-3) * (1.0 + 1e-12));
  // Rotation apart: J/(4T²) = 1e-3/(4·(10 ms)²) = 2.5 N m/rad of K_r = 10, which leaves K as it is.
  const EnergySpring<6> wrench{Energy{20e-3}, kStiffness_n_per_m, 10.0, 10.0, 1e-3};
  EXPECT_DOUBLE_EQ(wrench.stiffness(Seconds{0.01}), kStiffness_n_per_m);
  EXPECT_DOUBLE_EQ(wrench.rotational_stiffness(Seconds{0.01}), 2.5);
}

// Against a hand that turns back in each tick, whatever the period: -E(0) - K δ²/2 with K δ²/2 <= m (δ/T)²/8.
TEST(EnergySpring, MissesAtMostAQuarterOfTheKineticEnergyOfOneTick) {
  std::mt19937 random{3};
  for (const double dt_s : {0.001, 0.01, 0.05}) {
    const double mass = 0.1, step = 0.5 * dt_s;  // 0.5 m/s
    const Seconds dt{dt_s};
    EnergySpring<3> spring{Energy{1e-3}, 1e5, 0.0, mass, 0.0};
    double net = 0.0, least = 0.0;
    Force<3> f;
    for (int k = 0; k < 5000; ++k) {
      const Displacement<3> moved = moved_x(random() % 2 == 0 ? step : -step);
      net += dot(f, moved).si();
      least = std::min(least, net);
      spring.observe(Energy{net}, moved, f, dt, dt);
      const Force<3> wanted = along_x(random() % 2 == 0 ? 50.0 : -50.0);
      f = spring.scale(wanted, dt) * wanted;
    }
    EXPECT_GE(least, -1e-3 - mass * 0.25 / 8.0) << dt_s;
    EXPECT_LT(least, -0.5e-3) << "the spring must be used";
  }
}

// Without a mass, any motion and period: E >= -E(0) to rounding, as long as no tick moves more than twice as far as one of
// the last half second, at first 2 m/s T. The fourth step is the largest allowed.
TEST(EnergySpring, KeepsItsEnergyForAnyMotionUpToTwiceTheLargestRecentOne) {
  std::mt19937 random{5};
  for (const double dt_s : {0.001, 0.01, 0.05}) {
    const Seconds dt{dt_s};
    EnergySpring<3> spring{Energy{1e-3}, 1e5, 0.0, 0.0, 0.0};
    double net = 0.0, least = 0.0, taken = 0.0;
    Force<3> f;
    for (int k = 0; k < 5000; ++k) {
      const double share = std::uniform_real_distribution<>{-1.0, 1.0}(random);
      const double most = k % 500 == 400 ? spring.reach(dt) : std::min(spring.reach(dt), 0.3 * dt_s);
      const Displacement<3> moved = moved_x(k % 500 == 400 ? -std::copysign(most, f[0]) : share * most);
      net += dot(f, moved).si();
      taken = std::min(taken, dot(f, moved).si());
      least = std::min(least, net);
      spring.observe(Energy{net}, moved, f, dt, dt);
      const Force<3> wanted = along_x(random() % 2 == 0 ? 50.0 : -50.0);
      f = spring.scale(wanted, dt) * wanted;
    }
    EXPECT_GE(least, -1e-3 - 1e-12) << dt_s;
    EXPECT_LT(least, -0.9e-3) << "the spring must be used";
    EXPECT_LT(taken, -0.1e-3) << "and a tick must take much of it";
  }
}

/// A hand that changes its own force now and then, by up to F_h within two ticks, on a handle of `mass_kg` under held forces: exact.
class RandomHand {
 public:
  RandomHand(double mass_kg, Seconds dt, unsigned seed) : mass_kg_{mass_kg}, dt_s_{dt.si()}, random_{seed} {}
  /// Displacement of the next tick under `port`, the force on it.
  Displacement<3> step(const Force<3>& port) {
    const auto does = random_() % 80;
    if (does < 2) goal_ = Eigen::Vector3d{draw(), draw(), draw()} * 30.0 - 10.0 * v_;
    if (does == 2) goal_ = -3.0 * port.vec();  // pulls along the force that it feels
    const Eigen::Vector3d change = goal_ - own_;
    own_ += std::min(1.0, 0.5 * kHandForceChange_n / std::max(change.norm(), 1e-9)) * change;
    const Eigen::Vector3d a = (own_ - port.vec()) / mass_kg_;
    const Eigen::Vector3d by = dt_s_ * v_ + 0.5 * dt_s_ * dt_s_ * a;
    v_ += dt_s_ * a;
    return Displacement<3>{by};
  }
  double draw() { return std::uniform_real_distribution<>{-1.0, 1.0}(random_); }

 private:
  double mass_kg_, dt_s_;
  std::mt19937 random_;
  Eigen::Vector3d v_ = Eigen::Vector3d::Zero(), own_ = v_, goal_ = v_;
};

// |v - w + C f| <= worst_error in every tick, and a tick comes near.
TEST(PortVelocityPredictor, KnowsTheLargestErrorThatAHandCanCause) {
  const double mass_kg = 0.1;
  const Seconds dt{4e-3};
  PortVelocityPredictor<3> predictor{mass_kg, 0.0};
  RandomHand hand{mass_kg, dt, 7};
  Force<3> f;
  double most = 0.0;
  for (int k = 0; k < 20000; ++k) {
    const Displacement<3> moved = k == 0 ? Displacement<3>{} : hand.step(f);
    if (k > 1) {
      const VelocityPrediction<3>& port = predictor.prediction();
      const Eigen::Vector3d error = moved.vec() / dt.si() - port.w.vec() + port.mobility * f.vec();
      most = std::max(most, error.norm() / port.worst_error());
    }
    predictor.step(moved, f, dt, dt);
    f = along_x(10.0 * hand.draw());
  }
  EXPECT_LE(most, 1.0 + 1e-9);
  EXPECT_GT(most, 0.95);
}

// An axis opens while the hand pushes with a force that is not known yet: no force acts on it in the first tick; in the second the error is
// that of 50 N, on this axis, then as everywhere.
TEST(PortVelocityPredictor, KnowsNoPushAgainstALockInTheSecondTickAfterItOpens) {
  const double mass_kg = 0.5, dt_s = 4e-3, push_n = 49.0;
  const Seconds dt{dt_s};
  PortVelocityPredictor<3> predictor{mass_kg, 0.0};
  using Vector = Force<3>::Vector;
  predictor.take_ratio(Vector{0.0, 1.0, 1.0}, Velocity<3>{}, dt);
  double v = 0.0, largest = 0.0;
  const auto tick = [&](double ratio) {
    const double moved = ratio * (v * dt_s + 0.5 * push_n / mass_kg * dt_s * dt_s);
    v += push_n / mass_kg * dt_s;
    return Displacement<3>{Vector{moved, 0.0, 0.0}};
  };
  for (int k = 0; k < 20; ++k) predictor.step(tick(0.0), Force<3>{}, dt, dt);
  for (int k = 0; k < 8; ++k) {
    predictor.take_ratio(Vector::Ones(), Velocity<3>{Vector{v, 0.0, 0.0}}, dt);
    const VelocityPrediction<3>& port = predictor.prediction();
    EXPECT_EQ(port.opened[0] > 0.0, k == 1) << k;
    EXPECT_EQ(port.opened[1], 0.0) << k;
    EXPECT_EQ(port.mobility.diagonal()[0] == 0.0 && port.w.vec()[0] == 0.0, k == 0) << k;
    const double w = port.w.vec()[0];
    const Displacement<3> moved = tick(1.0);
    const double error = std::abs(moved.vec()[0] / dt_s - w);
    if (k > 0) {
      EXPECT_LE(error, port.worst_power_error(Force<3>{Vector{1.0, 0.0, 0.0}})) << k;
    }
    if (k == 1) largest = std::max(largest, error - port.worst_error());
    predictor.step(moved, Force<3>{}, dt, dt);
  }
  EXPECT_GT(largest, 0.01) << "the bound without the push would not hold";
}

// An axis opens while the port goes out along another one: on the axis that opens no force acts, so nothing comes in there that could pay.
TEST(EnergySpring, CountsNothingOfAnAxisThatOpens) {
  const double dt_s = 8e-3, initial_j = 1e-3;
  const Seconds dt{dt_s};
  using Vector = Force<3>::Vector;
  EnergySpring<3> spring{Energy{initial_j}, 1000.0, 0.0, 0.1, 0.0};
  const Velocity<3> out{Vector{0.0, -2.0, 0.0}}, opened{Vector{10.0, -2.0, 0.0}};
  for (int k = 0; k < 50; ++k) {
    spring.observe(Energy{}, out * dt, Force<3>{}, dt, dt);
    spring.take_ratio(Vector{0.0, 1.0, 1.0}, out, dt);
  }
  spring.observe(Energy{}, out * dt, Force<3>{}, dt, dt);
  spring.take_ratio(Vector::Ones(), opened, dt);
  const Force<3> wish{Vector{10.0, 10.0, 0.0}};
  EXPECT_LE(spring.scale(wish, dt) * 10.0 * 2.0 * dt_s, initial_j);
}

// Another method's port until now, behind a scale of 1/2 of a hand that pushes with 45 N: what was known of it before is wrong.
TEST(PortVelocityPredictor, BeginsAnewAtThePortOfAHandleThatMoves) {
  const double mass_kg = 0.1, dt_s = 8e-3, push_n = 45.0, ratio = 0.5;
  const Seconds dt{dt_s};
  using Vector = Force<3>::Vector;
  const auto step = [&](PortVelocityPredictor<3>& predictor, double& v) {
    const double moved = ratio * (v * dt_s + 0.5 * push_n / mass_kg * dt_s * dt_s);
    v += push_n / mass_kg * dt_s;
    const VelocityPrediction<3>& port = predictor.prediction();
    const double error = std::abs(moved / dt_s - port.w.vec()[0]),
                 bound = port.worst_power_error(Force<3>{Vector{1.0, 0.0, 0.0}});
    predictor.step(Displacement<3>{Vector{moved, 0.0, 0.0}}, Force<3>{}, dt, dt);
    predictor.take_ratio(Vector::Constant(ratio), Velocity<3>{}, dt);
    return std::pair{error, bound};
  };
  const auto violations = [&](bool restarts) {
    PortVelocityPredictor<3> predictor{mass_kg, 0.0};
    if (restarts) predictor.restart(Vector::Constant(ratio));
    double v = -0.5 * push_n / mass_kg * dt_s;  // turns back in this tick: nothing of the push is seen
    step(predictor, v);
    int count = 0;
    for (int k = 0; k < 10; ++k) {
      const auto [error, bound] = step(predictor, v);
      count += error > bound;
    }
    return count;
  };
  EXPECT_EQ(violations(true), 0);
  EXPECT_GT(violations(false), 0) << "as at a port that has stood still";
}

/// Least energy [J] of a handle of 50 T in kg/s, on which F_h changes the velocity by 0.2 m/s, under wishes and dampers that are drawn.
double least_energy_j(double dt_s, unsigned seed, double& damped_n) {
  const double mass_kg = 50.0 * dt_s;
  const Seconds dt{dt_s};
  EnergySpring<3> spring{Energy{1e-3}, 1e5, 0.0, mass_kg, 0.0};
  DamperAccount<3> damper;
  RandomHand hand{mass_kg, dt, seed};
  double net = 0.0, least = 0.0;
  Force<3> f, wanted, g_wanted;
  for (int k = 0; k < 5000; ++k) {
    const Displacement<3> moved = k == 0 ? Displacement<3>{} : hand.step(f);
    net += dot(f, moved).si();
    least = std::min(least, net);
    spring.observe(Energy{net}, moved, f, dt, dt);
    damper.observe(moved, 1.0, dt);
    if (k % 7 == 0) wanted = Force<3>{Eigen::Vector3d{hand.draw(), hand.draw(), hand.draw()} * 20.0};
    if (k % 5 == 0) g_wanted = Force<3>{Eigen::Vector3d{hand.draw(), hand.draw(), hand.draw()} * 5.0};
    const Force<3> g = damper.apply(g_wanted, moved / dt, spring, dt);
    damped_n = std::max(damped_n, g.vec().norm());
    f = spring.scale(wanted, dt, g) * wanted + g;
  }
  return least;
}

// Any wish, any damper, any period, any hand within F_h: E >= -E(0) to rounding.
TEST(EnergySpring, KeepsItsEnergyForAnyHandThatChangesItsForceNoFasterThanAssumed) {
  for (const double dt_s : {2.5e-4, 0.001, 0.01, 0.05}) {
    double least = 0.0, damped_n = 0.0;
    for (unsigned seed = 1; seed <= 50; ++seed) least = std::min(least, least_energy_j(dt_s, seed, damped_n));
    EXPECT_GE(least, -1e-3 - 1e-12) << dt_s;
    EXPECT_LT(least, -0.9e-3) << "the spring must be used at " << dt_s;
    EXPECT_GT(damped_n, 0.01) << "and the damper at " << dt_s;
  }
}

// D_1 = 1 mJ for one tick within the reach; a damper of 20 N s/m at 2 m/s and 20 ms would lose 800 mJ in a tick that turns back.
TEST(DamperAccount, LosesNoMoreThanItsShareInOneTick) {
  const Seconds dt{0.02};
  DamperAccount<3> account;
  EnergySpring<3> port{Energy{1.0}, kStiffness_n_per_m, 0.0, 0.0, 0.0};  // predicts nothing
  port.observe(Energy{}, moved_x(1.0 * dt.si()), Force<3>{}, dt, dt);
  const Force<3> g = account.apply(along_x(20.0 * 2.0), Velocity<3>{}, port, dt);
  EXPECT_GT(g[0], 0.0);
  EXPECT_LE(g[0] * 2.0 * dt.si(), 1e-3 * (1.0 + 1e-12));
}

// What it gives back beyond what it has taken: D_0 = 10 µJ, one tick at b v = 15 N s/m · v over v T, and 1 µW.
TEST(DamperAccount, SwitchesOffADamperThatIsActive) {
  EXPECT_LT(least_energy_of_a_damper_j(false), -1.0);
  EXPECT_GT(least_energy_of_a_damper_j(true), -10e-3);
}

// A hand that turns back in each tick takes 1 mJ from a damper without an account: 2 N s/m at 0.1 m/s, 50 times in 1000 ticks.
TEST(DamperAccount, GivesBackNoMoreThanItsLevelAndOneTick) {
  const Seconds dt{1e-3};
  const double damping = 2.0, speed = 0.1;
  DamperAccount<3> account;
  const EnergySpring<3> port{Energy{1.0}, kStiffness_n_per_m, 0.0, 0.0, 0.0};  // predicts nothing
  double net = 0.0, least = 0.0, v = speed;
  Force<3> g;
  for (int k = 0; k < 20000; ++k) {
    net += dot(g, moved_x(v * dt.si())).si();
    least = std::min(least, net);
    account.observe(moved_x(v * dt.si()), 1.0, dt);
    g = account.apply(along_x(damping * v), Velocity<3>{}, port, dt);
    v = -v;
  }
  EXPECT_LT(least, -10e-6);
  EXPECT_GE(least, -(10e-6 + damping * speed * speed * dt.si() + 20000 * dt.si() * 1e-6));
}

}  // namespace
}  // namespace twoport::energy_spring_test
