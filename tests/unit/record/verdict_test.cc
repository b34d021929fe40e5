#include "common/record/verdict.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "common/record/run_judge.h"

namespace twoport::verdict_test {
namespace {

constexpr double kRate = 1000.0;

/// A tail of one coordinate of each side, the slave at rest: y(t), d(t), port energy(t).
struct Signal {
  std::function<double(double)> y = [](double) { return 0.0; };
  std::function<double(double)> d = [](double) { return 0.0; };
  std::function<double(double)> energy = [](double) { return 0.0; };
  double seconds = 10.0;
  double run_lengths = 1.0;
  bool has_controller = false, acted = false, last = false, touching = true;
  EnergySource source = EnergySource::network;
};

Verdict verdict(const Signal& s) {
  Tail tail{.record = {4, 2}, .has_twin = true};
  for (int i = 0; i < s.seconds * kRate; ++i) {
    const double t = i / kRate, e = s.energy(t);
    const std::vector<double> signals{s.y(t), 0.0, s.d(t), 0.0}, energies{e, e};
    tail.record.add(signals, energies, {.touching = s.touching});
  }
  tail.has_controller = s.has_controller;
  tail.controller_acted = s.acted;
  tail.driven = true;
  tail.run_lengths = s.run_lengths;
  tail.last = s.last;
  return judge(tail, {.dof = 1,
                      .rate_hz = kRate,
                      .source = s.source,
                      .reach_m = 0.1,
                      .speed = {0.1, 0.1},
                      .early = {0.1, 0.1},
                      .noise = {}});
}

/// An oscillation of 5 Hz.
std::function<double(double)> wave(double amplitude, double sigma) {
  return [=](double t) { return amplitude * std::exp(sigma * t) * std::sin(2.0 * std::numbers::pi * 5.0 * t + 0.3); };
}

TEST(Verdict, SeesGrowthAndDecayOfAThousandthASecond) {
  for (const double sigma : {1e-3, -1e-3}) {
    const Verdict v = verdict({.y = wave(0.05, sigma), .d = wave(1e-7, sigma)});
    EXPECT_EQ(v.kind, sigma > 0.0 ? VerdictKind::unstable : VerdictKind::stable) << v.text;
  }
}

TEST(Verdict, SeesAModeThatHidesInTheTwin) {
  const Verdict v = verdict({.y = wave(0.05, -0.1), .d = wave(1e-7, 0.5)});
  EXPECT_EQ(v.kind, VerdictKind::unstable) << v.text;
  EXPECT_NE(v.text.find("when touched"), std::string::npos) << v.text;
}

TEST(Verdict, DoesNotTakeGrowthByAPowerOfTimeForAnExponential) {
  const auto ramp = [](double t) { return (0.01 + 0.01 * t) * std::sin(31.0 * t); };
  EXPECT_NE(verdict({.y = ramp, .d = ramp}).kind, VerdictKind::unstable);
}

TEST(Verdict, CallsASustainedOscillationUnstableWhereTheNetworkPays) {
  Signal s{.y = wave(0.05, 0.0), .d = wave(1e-7, 0.0), .run_lengths = 4.0};
  EXPECT_EQ(verdict(s).kind, VerdictKind::stable) << verdict(s).text;
  s.energy = [](double t) { return 1.0 - 0.1 * t; };
  EXPECT_EQ(verdict(s).kind, VerdictKind::unstable) << verdict(s).text;
  s.has_controller = s.acted = true;
  s.energy = [](double t) { return 100.0 - 0.1 * t; };
  EXPECT_EQ(verdict(s).kind, VerdictKind::restless) << verdict(s).text;
  s.energy = [](double t) { return -1.0 - 0.1 * t; };
  EXPECT_EQ(verdict(s).kind, VerdictKind::unstable) << verdict(s).text;
}

TEST(Verdict, NamesTheSourceOfEnergyWhereItIsKnown) {
  Signal s{.y = wave(0.05, 0.0), .d = wave(1e-7, 0.0), .run_lengths = 4.0};
  s.energy = [](double t) { return -1.0 - 0.1 * t; };
  EXPECT_NE(verdict(s).text.find("fed by the network"), std::string::npos) << verdict(s).text;
  s.source = EnergySource::rendering;
  EXPECT_NE(verdict(s).text.find("fed by the rendering"), std::string::npos) << verdict(s).text;
  s.source = EnergySource::unknown;
  EXPECT_EQ(verdict(s).text.find("fed"), std::string::npos) << verdict(s).text;
}

/// A robot that swings under a controller at 0.05 m/s beside a hand at rest: what it is given [W], how much of that its coupling makes.
Tail driven_robot(double given_w, double made_w, double decay = 0.0, double hand = 0.0) {
  Tail tail{.record = {4, 4}, .has_twin = true, .has_controller = true, .controller_acted = true, .driven = true};
  for (int i = 0; i < 10000; ++i) {
    const double t = i / kRate;
    const std::vector<double> signals{wave(hand, decay)(t), wave(0.05, decay)(t), 0.0, 0.0};
    const std::vector<double> energies{1.0, 1.0, 2.0 - made_w * t, given_w * t};
    tail.record.add(signals, energies, {});
  }
  return tail;
}

TEST(Verdict, IsUnstableWhereTheRobotsOwnCouplingDrivesIt) {
  const MotionScale run{
      .dof = 1, .rate_hz = kRate, .source = {}, .reach_m = 0.1, .speed = {0.1, 0.1}, .early = {0.1, 0.1}, .noise = {}};
  const Verdict driven = judge(driven_robot(1.0, 0.8), run);
  EXPECT_EQ(driven.kind, VerdictKind::unstable) << driven.text;
  EXPECT_NE(driven.text.find("the robot's own coupling"), std::string::npos) << driven.text;
  // What the network or the environment drives, or what comes to rest, is not the coupling's.
  EXPECT_EQ(judge(driven_robot(1.0, 0.05), run).kind, VerdictKind::restless) << "the network drives it";
  EXPECT_EQ(judge(driven_robot(1.0, -0.1), run).kind, VerdictKind::restless) << "the coupling damps";
  EXPECT_EQ(judge(driven_robot(-1.0, 0.2), run).kind, VerdictKind::restless) << "the environment drives it";
  EXPECT_EQ(judge(driven_robot(1.0, 0.8, -0.5), run).kind, VerdictKind::stable) << "it decays";
}

// A live run's rest is shaken by the noise of its force sensor, which a tail is not.
TEST(Verdict, TakesMotionThatNoiseMayCauseForRest) {
  Tail tail{.record = {4, 4}, .has_controller = true, .controller_acted = true, .driven = true, .last = true};
  for (int i = 0; i < 10000; ++i) {
    const std::vector<double> signals{wave(0.005, 0.0)(i / kRate), 0.0, 0.0, 0.0}, energies(4, 1.0);
    tail.record.add(signals, energies, {});
  }
  MotionScale run{
      .dof = 1, .rate_hz = kRate, .source = {}, .reach_m = 0.1, .speed = {0.1, 0.1}, .early = {0.1, 0.1}, .noise = {}};
  EXPECT_EQ(judge(tail, run).kind, VerdictKind::restless);
  run.noise.translation = 0.004;
  const Verdict noisy = judge(tail, run);
  EXPECT_EQ(noisy.kind, VerdictKind::stable) << noisy.text;
}

TEST(Verdict, OfASlaveNeedsARobotThatMovesMoreThanTheHand) {
  const MotionScale run{
      .dof = 1, .rate_hz = kRate, .source = {}, .reach_m = 0.1, .speed = {0.0, 0.1}, .early = {0.0, 0.1}, .noise = {}};
  EXPECT_TRUE(is_driven_by_coupling(driven_robot(1.0, 0.8, 0.0, 0.01), run, 1.0));
  EXPECT_FALSE(is_driven_by_coupling(driven_robot(1.0, 0.8, 0.0, 0.02), run, 1.0));
  EXPECT_FALSE(is_driven_by_coupling(driven_robot(1.0, 0.8, 0.0, 0.01), run, 2.0));
}

TEST(Verdict, IsTheSameForEveryUnit) {
  for (const double sigma : {0.3, -0.3})
    for (const double scale : {1e-3, 1.0, 1e3}) {
      Tail tail{.record = {4, 2}, .has_twin = true, .driven = true};
      for (int i = 0; i < 10000; ++i) {
        const double t = i / kRate;
        const std::vector<double> signals{scale * wave(0.05, sigma)(t), 0.0, scale * wave(1e-7, sigma)(t), 0.0},
            energies{0.0, 0.0};
        tail.record.add(signals, energies, {});
      }
      const double v = 0.1 * scale;
      const Verdict judged = judge(
          tail,
          {.dof = 1, .rate_hz = kRate, .source = {}, .reach_m = v, .speed = {v, v}, .early = {v, v}, .noise = {}});
      EXPECT_EQ(judged.kind, sigma > 0.0 ? VerdictKind::unstable : VerdictKind::stable) << scale << judged.text;
    }
}

TEST(Verdict, WaitsWhereAControllerHasCreditLeft) {
  Signal s{.y = wave(0.01, 0.3), .d = wave(1e-7, 0.3), .has_controller = true};
  s.energy = [](double) { return 1.0; };
  EXPECT_EQ(verdict(s).kind, VerdictKind::undecided) << verdict(s).text;
  s.energy = [](double) { return -1.0; };
  EXPECT_EQ(verdict(s).kind, VerdictKind::unstable) << verdict(s).text;
}

TEST(Verdict, DoesNotWaitForTheHandsCreditWhereTheCouplingFeedsTheRobot) {
  const MotionScale run{
      .dof = 1, .rate_hz = kRate, .source = {}, .reach_m = 0.1, .speed = {0.1, 0.1}, .early = {0.1, 0.1}, .noise = {}};
  Tail tail = driven_robot(100.0, 0.8, 0.3);
  tail.controller_acted = false;
  EXPECT_EQ(judge(tail, run).kind, VerdictKind::unstable) << judge(tail, run).text;
  tail.initial_energy_j = 100.0;
  EXPECT_EQ(judge(tail, run).kind, VerdictKind::undecided) << judge(tail, run).text;
}

TEST(Verdict, IsUndecidedWhereTooLittleIsSeen) {
  const Verdict v = verdict({.y = wave(0.05, 0.3), .seconds = 0.05});
  EXPECT_EQ(v.kind, VerdictKind::undecided);
  EXPECT_NE(v.text.find("longer"), std::string::npos) << v.text;
}

// ---- what is kept of a tail

TEST(TrendRecord, KeepsWindowMeansHoweverLongItGets) {
  TrendRecord record{1, 1};
  const auto sum = [](double t) { return std::exp(-0.2 * t) * std::sin(40.0 * t); };
  for (int i = 0; i < 100000; ++i) {
    const double t = i / 1e4, v = sum(t);
    const std::vector<double> signals{v}, energies{t};
    record.add(signals, energies, {});
  }
  const MotionTrend trend = record.motion(0, 0.0, true);
  EXPECT_EQ(trend.trend, Trend::decays);
  // ln A falls by 0.2 1/s over windows of an eighth of what whole blocks hold.
  EXPECT_NEAR(trend.slope, -0.2 * static_cast<double>(record.ticks()) / 1e4 / 8.0, 1e-5);
  EXPECT_NEAR(static_cast<double>(trend.turns), 40.0 / std::numbers::pi * 7.5, 3.0);
  EXPECT_NEAR(record.energies(0)[0], 10.0 / 16.0, 0.03);
  EXPECT_LT(record.energy(0).ripple, 0.05);
  EXPECT_FALSE(record.energy(0).falls());
}

// A window is an eighth of the record; the rate is that of the least damped mode, whatever decays beside it.
TEST(TrendRecord, GivesTheRateOfTheLeastDampedMode) {
  for (const double rate : {1e-4, -1e-4, 0.3}) {
    TrendRecord record{1, 1};
    for (int i = 0; i < 4096; ++i) {
      const double t = i / 1e3, v = std::exp(rate * t) * std::sin(130.0 * t) + std::exp(-3.0 * t) * std::cos(40.0 * t);
      const std::vector<double> signals{v}, energies{0.0};
      record.add(signals, energies, {});
    }
    const MotionTrend trend = record.motion(0, 0.0, true);
    EXPECT_EQ(trend.trend, rate > 0.0 ? Trend::grows : Trend::decays) << rate;
    EXPECT_NEAR(trend.slope, rate * static_cast<double>(record.ticks()) / 1e3 / 8.0, 1e-4 * std::abs(rate)) << rate;
  }
}

TEST(DampedMode, IsFoundInAQuarterOfAPeriod) {
  std::array<double, kPencilSamples> x{};
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double t = static_cast<double>(i) / static_cast<double>(x.size());
    x[i] = std::exp(0.2 * t) * std::cos(0.5 * std::numbers::pi * t);
  }
  const DampedMode mode = least_damped_mode(x);
  ASSERT_TRUE(mode.found);
  EXPECT_NEAR(mode.rate * static_cast<double>(x.size()), 0.2, 1e-6);
}

// ---- from the run's own rows

using Known = RunJudge<1>::Known;
Row<1> row(double t, double v) {
  Row<1> r;
  r.t_s = t;
  r.master_v = Velocity<1>{Eigen::Matrix<double, 1, 1>{v}};
  r.mode = Mode::coupled;
  return r;
}

TEST(RunJudge, SaysNothingOfARunThatShowsNothing) {
  const Known known{.rate_hz = kRate, .duration_s = 1.0, .quiet_from_s = 0.0};
  EXPECT_EQ(RunJudge<1>{known}.verdict().kind, VerdictKind::undecided);
  EXPECT_NE(RunJudge<1>{known}.verdict().text.find("nothing was run"), std::string::npos);

  RunJudge<1> still{known};
  still.add(row(0.0, 0.0));
  EXPECT_EQ(still.verdict().kind, VerdictKind::undecided);
  EXPECT_NE(still.verdict().text.find("nothing moved"), std::string::npos);

  RunJudge<1> alone{{.rate_hz = kRate, .duration_s = 1.0, .quiet_from_s = 0.0, .link = true}};
  Row<1> idle = row(0.0, 1.0);
  idle.mode = Mode::idle;
  alone.add(idle);
  EXPECT_EQ(alone.verdict().kind, VerdictKind::undecided);
  EXPECT_NE(alone.verdict().text.find("never met"), std::string::npos);
}

TEST(RunJudge, IsUndecidedWhileTheHandMovesAndSaysWhatWasPaid) {
  RunJudge<1> judge{{.rate_hz = kRate, .duration_s = 10.0, .quiet_from_s = std::numeric_limits<double>::infinity()}};
  for (int i = 0; i < 10000; ++i) {
    Row<1> r = row(i / kRate, wave(0.05, 0.5)(i / kRate));
    r.master_energy_j = -1e-3 * i / kRate;
    judge.add(r);
  }
  EXPECT_EQ(judge.verdict().kind, VerdictKind::undecided);
  EXPECT_NE(judge.verdict().text.find("paid 0.009999 J"), std::string::npos) << judge.verdict().text;
}

TEST(RunJudge, JudgesWhatComesAfterThePathsEnd) {
  for (const double sigma : {0.5, -0.5}) {
    RunJudge<1> judge{{.rate_hz = kRate, .duration_s = 10.0, .quiet_from_s = 5.0}};
    for (int i = 0; i < 10000; ++i) judge.add(row(i / kRate, wave(0.05, sigma)(i / kRate)));
    EXPECT_EQ(judge.verdict().kind, sigma > 0.0 ? VerdictKind::unstable : VerdictKind::stable) << judge.verdict().text;
  }
}

// A live run has no longer tail to wait for.
TEST(RunJudge, DecidesAnUnsteadyMotionByTheEnergyOfTheHand) {
  const auto judged = [](bool controller, double power_w) {
    RunJudge<1> judge{{.rate_hz = kRate,
                       .duration_s = 10.0,
                       .quiet_from_s = 5.0,
                       .initial_energy_j = 1e-3,
                       .controller = controller,
                       .unseen = true,
                       .coarse = true}};
    for (int i = 0; i < 10000; ++i) {
      const double t = i / kRate;
      Row<1> r = row(t, 0.05 * (1.0 + 0.6 * std::sin(2.0 * t)) * std::sin(100.0 * t));
      r.master_energy_j = power_w * t;
      judge.add(r);
    }
    return judge.verdict();
  };
  EXPECT_EQ(judged(false, -1.0).kind, VerdictKind::unstable) << judged(false, -1.0).text;
  EXPECT_EQ(judged(true, -1.0).kind, VerdictKind::unstable) << judged(true, -1.0).text;
  EXPECT_EQ(judged(true, 0.0).kind, VerdictKind::restless) << judged(true, 0.0).text;
  EXPECT_EQ(judged(false, 0.0).kind, VerdictKind::undecided) << judged(false, 0.0).text;
}

TEST(RunJudge, EndsWhereThereIsNoUseInGoingOn) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  const Known known{.rate_hz = kRate, .duration_s = 1.0, .quiet_from_s = 0.0};
  for (const double bad : {kNone, 1001.0}) {
    RunJudge<1> judge{known};
    EXPECT_TRUE(judge.add(row(0.0, 0.1)));
    EXPECT_FALSE(judge.add(row(0.5, bad)));
    EXPECT_EQ(judge.verdict().kind, VerdictKind::unstable);
    EXPECT_EQ(judge.verdict().text, "diverged at 0.5 s");
  }
  RunJudge<1> fast{known};
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(fast.add(row(i / kRate, 2000.0))) << "a body that glides";
}

}  // namespace
}  // namespace twoport::verdict_test
