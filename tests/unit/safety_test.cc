#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "common/safety/peer_guard.h"
#include "common/safety/safety_stage.h"

namespace twoport::safety_test {
namespace {

template <int N>
using V = Eigen::Matrix<double, N, 1>;
constexpr Seconds kT{1e-3};

TEST(SafetyStage, WithoutLimitsChangesNothing) {
  SafetyStage<3> stage{{}, 1.0};
  const Eigen::Vector3d asked{1e9, -2, 3};
  EXPECT_EQ(stage(Force<3>{asked}, Position<3>{asked}, Velocity<3>{asked}, kT).vec(), asked);
  EXPECT_EQ(stage.counts(), LimitCounts{});
}

TEST(SafetyStage, BoundsTheNormAndKeepsTheDirection) {
  SafetyStage<3> stage{{.force_n = 8.5}, 1.0};
  std::mt19937_64 random{5};
  std::normal_distribution<double> normal{0.0, 6.0};
  std::uint32_t above = 0;
  for (int k = 0; k < 1000; ++k) {
    const Eigen::Vector3d asked{normal(random), normal(random), normal(random)};
    const Eigen::Vector3d kept = stage(Force<3>{asked}, {}, {}, kT).vec();
    if (asked.norm() <= 8.5) {
      ASSERT_EQ(kept, asked);
    } else {
      ++above;
      // A product and a norm, each rounded.
      ASSERT_NEAR(kept.norm(), 8.5, 1e-14);
      ASSERT_LT((kept / 8.5 - asked / asked.norm()).norm(), 1e-15);
    }
    ASSERT_EQ(stage.counts()[Limit::force], above);
  }
}

TEST(SafetyStage, OfAWrenchBoundsForceAndTorqueAndScalesBoth) {
  V<6> asked;
  asked << 6, 0, 8, 0.1, 0.2, 0.3;
  SafetyStage<6> stage{{.force_n = 5.0}, 1.0};
  EXPECT_LT((stage(Force<6>{asked}, {}, {}, kT).vec() - 0.5 * asked).norm(), 1e-15);
  asked << 3, 0, 4, 100, 200, 300;
  EXPECT_EQ(stage(Force<6>{asked}, {}, {}, kT).vec(), asked);
  SafetyStage<6> of_torque{{.torque_n_m = 2.0}, 1.0};
  asked << 3, 0, 4, 0, 8, 0;
  EXPECT_LT((of_torque(Force<6>{asked}, {}, {}, kT).vec() - 0.25 * asked).norm(), 1e-15);
}

TEST(SafetyStage, BoundsTheChangeOfTheForceInATick) {
  SafetyStage<1> stage{{.force_rate_n_per_s = 2000.0}, 1.0};  // 2 N in a tick
  const auto step = [&](double f) { return stage(Force<1>{V<1>{f}}, {}, {}, kT)[0]; };
  EXPECT_EQ(step(5.0), 2.0);
  EXPECT_EQ(step(5.0), 4.0);
  EXPECT_EQ(step(5.0), 5.0);
  EXPECT_EQ(step(-5.0), 3.0);
  EXPECT_EQ(stage.counts()[Limit::force_rate], 3u);
  stage.release();
  EXPECT_EQ(step(5.0), 2.0) << "after a release the force starts from zero";
}

TEST(SafetyStage, BoundsThePowerIntoTheHardwareOnly) {
  SafetyStage<1> robot{{.power_w = 10.0}, 1.0}, device{{.power_w = 10.0}, -1.0};
  const auto step = [](SafetyStage<1>& s, double f, double v) {
    return s(Force<1>{V<1>{f}}, {}, Velocity<1>{V<1>{v}}, kT)[0];
  };
  EXPECT_DOUBLE_EQ(step(robot, 20.0, 2.0), 5.0);
  EXPECT_EQ(step(robot, -20.0, 2.0), -20.0) << "braking takes power out";
  EXPECT_DOUBLE_EQ(step(device, -20.0, 2.0), -5.0) << "the hand is pushed with -f";
  EXPECT_EQ(step(device, 20.0, 2.0), 20.0);
}

TEST(SafetyStage, AcceleratesNothingBeyondTheSpeedAndLeadsNothingBeyondTheWorkspace) {
  SafetyStage<3> stage{{.speed_m_per_s = 1.0, .workspace_m = 0.5}, 1.0};
  const auto step = [&](const V<3>& f, const V<3>& x, const V<3>& v) {
    return V<3>{stage(Force<3>{f}, Position<3>{x}, Velocity<3>{v}, kT).vec()};
  };
  const V<3> fast{2, 0, 0}, far{0, 0.6, 0};
  EXPECT_EQ(step({3, 4, 5}, {0, 0, 0}, fast), (V<3>{0, 4, 5}));
  EXPECT_EQ(step({-3, 4, 5}, {0, 0, 0}, fast), (V<3>{-3, 4, 5})) << "braking is allowed";
  EXPECT_EQ(step({3, 4, 5}, far, {0, 0, 0}), (V<3>{3, 0, 5}));
  EXPECT_EQ(step({3, -4, 5}, far, {0, 0, 0}), (V<3>{3, -4, 5})) << "back inside is allowed";
  EXPECT_EQ(stage.counts()[Limit::speed], 1u);
  EXPECT_EQ(stage.counts()[Limit::workspace], 1u);
}

TEST(SafetyStage, OfAKnownMassLeadsNothingBeyondTheSpeedInTheComingTick) {
  constexpr double kLimit = 0.02, kMass = 0.5;
  std::mt19937_64 random{3};
  std::normal_distribution<double> force{0.0, 20.0}, speed{0.0, 0.02};
  int held = 0;
  for (const double sign : {1.0, -1.0}) {
    SafetyStage<3> stage{{.speed_m_per_s = kLimit}, sign, kMass};
    for (int k = 0; k < 1000; ++k) {
      const V<3> f{force(random), force(random), force(random)}, v{speed(random), speed(random), speed(random)};
      const V<3> kept = stage(Force<3>{f}, {}, Velocity<3>{v}, kT).vec();
      const double longest = std::max(kLimit, v.norm());
      const auto next = [&](const V<3>& by) { return (v + sign * kT.si() / kMass * by).norm(); };
      if (next(f) <= longest) {
        ASSERT_EQ(kept, f);
        continue;
      }
      ++held;
      // Some roundings.
      ASSERT_NEAR(next(kept), longest, 1e-15);
      ASSERT_LE(kept.norm(), f.norm() * (1.0 + 1e-12));
      ASSERT_LE(sign * kept.dot(v), std::max(0.0, sign * f.dot(v)) + 1e-12);
    }
  }
  EXPECT_GT(held, 500);
}

TEST(SafetyStage, BoundsTheStepOfTheSetPointAndHoldsItAtAPressedWall) {
  SafetyStage<1> stage{{.force_n = 10.0, .set_point_step_m = 0.002, .workspace_m = 0.1}, 1.0};
  const auto step = [&](double to, double from, double pressed) {
    const Force<1> f{V<1>{pressed}};
    return stage.set_point(Position<1>{V<1>{to}}, Position<1>{V<1>{from}}, kT, &f).translation()[0];
  };
  EXPECT_DOUBLE_EQ(step(0.05, 0.0, 0.0), 0.002);
  EXPECT_DOUBLE_EQ(step(0.001, 0.0, 0.0), 0.001);
  EXPECT_DOUBLE_EQ(step(0.5, 0.0995, 0.0), 0.1);
  EXPECT_DOUBLE_EQ(step(0.051, 0.05, 11.0), 0.05) << "further in";
  EXPECT_DOUBLE_EQ(step(0.049, 0.05, 11.0), 0.049) << "back";
}

// ---- what the other side claims

const PortLimits kPeer{.force_n = 10.0, .speed_m_per_s = 2.0, .workspace_m = 1.0};

struct Heard {
  PeerGuard<1> guard{kPeer};
  Report<1> last;
  Report<1>& hear(int k, double x, double v, double f, double energy_j) {
    Report<1> r;
    r.sequence = static_cast<std::uint64_t>(k + 1);
    r.x = Position<1>{V<1>{x}};
    r.v = Velocity<1>{V<1>{v}};
    r.f = r.f_coupling = r.f_environment = Force<1>{V<1>{f}};
    r.energy_in_j = energy_j;
    guard.pass(r, tick_time(k, 1000.0), [&](const Report<1>& passed) { last = passed; });
    return last;
  }
};

TEST(PeerGuard, LeavesAloneWhatIsPossible) {
  Heard h;
  for (int k = 0; k < 1000; ++k) {
    const double t = 1e-3 * k, x = 0.5 * std::sin(3.0 * t);
    const Report<1>& r = h.hear(k, x, 1.5 * std::cos(3.0 * t), 9.0, 15.0 * t);
    ASSERT_EQ(r.x.translation()[0], x);
    ASSERT_EQ(r.energy_in_j, 15.0 * t);
  }
  EXPECT_EQ(h.guard.counts(), LimitCounts{});
}

TEST(PeerGuard, ClipsWhatIsNot) {
  for (const double absurd : {1e3, 1e6, 1e154, 1e300, -1e308}) {
    Heard h;
    h.hear(0, 0.0, 0.0, 0.0, 0.0);
    const Report<1> r = h.hear(1, absurd, absurd, absurd, std::abs(absurd));
    EXPECT_LE(std::abs(r.x.translation()[0]), 2.0 * 0.0511)
        << absurd << ": a metre a second too fast, 50 ms on the way";
    EXPECT_NEAR(std::abs(r.v[0]), 2.0, 1e-12) << absurd;
    EXPECT_NEAR(std::abs(r.f_coupling[0]), 10.0, 1e-12) << absurd;
    EXPECT_NEAR(std::abs(r.f_environment[0]), 100.0, 1e-12) << absurd;
    EXPECT_NEAR(r.energy_in_j, 10.0 * 2.0 * 1.001, 1e-9) << absurd;
    for (const Limit each : {Limit::peer_motion, Limit::peer_force, Limit::peer_energy})
      EXPECT_EQ(h.guard.counts()[each], 1u) << absurd;
  }
}

TEST(PeerGuard, GrantsNoMoreEnergyThanForceTimesSpeedTimesTime) {
  Heard h;
  for (int k = 0; k < 5000; ++k) {
    const double t = 1e-3 * k;
    ASSERT_LE(h.hear(k, 0.0, 0.0, 0.0, 1e308).energy_in_j, 20.0 * (t + 1.0) + 1e-9);
  }
  h.guard.reset();
  EXPECT_NEAR(h.hear(5000, 0.0, 0.0, 0.0, 1e308).energy_in_j, 20.0, 1e-9) << "a new session begins anew";
}

TEST(PeerGuard, TurnsAnAttitudeThatIsNoneIntoOne) {
  PeerGuard<6> guard{{.force_n = 1.0}};
  for (const double s : {0.0, 2.0, 1e200, 1e-200}) {
    Report<6> r;
    r.sequence = 1;
    r.x = {Eigen::Vector3d::Zero(), Eigen::Quaterniond{s, -s, 0.0, s}};
    guard.pass(r, Duration{0},
               [](const Report<6>& passed) { EXPECT_NEAR(passed.x.attitude().squaredNorm(), 1.0, 1e-12); });
  }
}

}  // namespace
}  // namespace twoport::safety_test
