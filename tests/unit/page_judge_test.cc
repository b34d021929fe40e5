#include <gtest/gtest.h>

#include <cmath>

#include "common/link/report.h"
#include "common/page/judge.h"

namespace twoport::page_judge_test {
namespace {

constexpr double kRate = 500.0;

/// A scene that a pair with a passivity controller or none plays.
Scene scene_of(const char* passivity) {
  Scene s;
  s.control.passivity = passivity;
  s.control.transparency = "DELAYED_FORCE";
  s.control.initial_energy = Energy{1e-3};
  return s;
}

/// Six seconds of a hand that swings with `amplitude(t)` at 4 Hz while nobody moves anything, its port's energy `energy(t)`.
template <class Amplitude, class EnergyOf>
PageVerdict swings(const char* passivity, Amplitude amplitude, EnergyOf energy, double dissipates_w = 0.0) {
  PageJudge judge{scene_of(passivity), kRate, true};
  PageSample s;
  s.mode = s.slave_mode = static_cast<double>(Mode::coupled);
  for (int k = 0; k < 6 * static_cast<int>(kRate); ++k) {
    s.t_s = k / kRate;
    const double w = 2.0 * M_PI * 4.0, a = amplitude(s.t_s);
    s.hand_x_m[0] = a * std::sin(w * s.t_s);
    s.hand_v_m_per_s[0] = a * w * std::cos(w * s.t_s);
    s.robot_x_m = s.hand_x_m;
    s.robot_v_m_per_s = s.hand_v_m_per_s;
    s.unlimited_n[0] = s.felt_n[0] = 100.0 * s.hand_x_m[0];
    s.hand_energy_j = energy(s.t_s);
    s.dissipated_j = dissipates_w * s.t_s;
    judge.add(s);
  }
  return judge.verdict();
}

TEST(PageJudge, AMotionThatDiesAwayIsPassive) {
  const PageVerdict v = swings(
      "NONE", [](double t) { return 0.01 * std::exp(-3.0 * t); }, [](double) { return 1e-3; });
  EXPECT_EQ(v.kind, PageVerdict::Kind::passive) << v.reason;
  EXPECT_NE(v.reason.find("decaying"), v.reason.npos) << v.reason;
}

TEST(PageJudge, AMotionThatGrowsByItselfIsUnstable) {
  const PageVerdict v = swings(
      "NONE", [](double t) { return 1e-4 * std::exp(0.8 * t); }, [](double t) { return -1e-4 * std::exp(t); });
  EXPECT_EQ(v.kind, PageVerdict::Kind::unstable) << v.reason;
}

TEST(PageJudge, AMotionThatAPassiveControllerKeepsUpIsRestless) {
  const PageVerdict v = swings(
      "ENERGY_SPRING", [](double) { return 0.01; }, [](double) { return 1e-3; }, 1e-3);
  EXPECT_EQ(v.kind, PageVerdict::Kind::restless) << v.reason;
}

TEST(PageJudge, AHandThatHasBeenPaidBeyondItsBudgetIsNotPassive) {
  PageJudge judge{scene_of("NONE"), kRate, false};
  PageSample s;
  s.hand_energy_j = -0.9e-3;
  judge.add(s);
  EXPECT_EQ(judge.verdict().kind, PageVerdict::Kind::passive) << "E(0) is 1 mJ";
  s.hand_energy_j = -1.1e-3;
  judge.add(s);
  EXPECT_EQ(judge.verdict().kind, PageVerdict::Kind::not_passive);
  EXPECT_EQ(judge.verdict().reason, "the hand has got 0.1 mJ more than it has put in and E(0)");
  s.hand_energy_j = -31.101;
  judge.add(s);
  EXPECT_EQ(judge.verdict().reason, "the hand has got 31.10 J more than it has put in and E(0)");
}

TEST(PageJudge, ADebtOfAnEarlierMethodIsNotHeldAgainstTheNext) {
  Scene scene = scene_of("NONE");
  scene.schedule.push_back({.at_s = 1.0, .control = scene_of("ENERGY_SPRING").control});
  PageJudge judge{scene, kRate, false};
  PageSample s;
  s.hand_energy_j = -13.0;
  judge.add(s);
  EXPECT_EQ(judge.verdict().kind, PageVerdict::Kind::not_passive);
  s.epoch = 1.0;
  judge.add(s);
  EXPECT_EQ(judge.verdict().kind, PageVerdict::Kind::passive);
  EXPECT_EQ(judge.earlier_debt_j(), 13.0);
  s.hand_energy_j = -13.002;
  judge.add(s);
  EXPECT_EQ(judge.verdict().kind, PageVerdict::Kind::not_passive);
}

/// E(0) of both sides under FORCE_PROJECTED; ENERGY_SPRING bounds the hand alone. The robot's side follows a switch a while later.
TEST(PageJudge, TellsTheBudgetOfBothPortsWhereTheLayerBoundsThem) {
  Scene scene = scene_of("ENERGY_SPRING");
  scene.schedule.push_back({.at_s = 1.0, .control = scene_of("FORCE_PROJECTED").control});
  scene.schedule.push_back({.at_s = 2.0, .control = scene_of("ENERGY_SPRING_TWO_PORT").control});
  PageJudge judge{scene, kRate, false};
  PageSample s;
  s.hand_energy_j = 0.002;
  s.robot_port_j = -0.003;
  judge.add(s);
  EXPECT_LT(judge.both_initial_energy_j(), 0.0);
  s.epoch = 1.0;
  judge.add(s);
  EXPECT_EQ(judge.both_initial_energy_j(), 2e-3);
  EXPECT_NEAR(judge.both_earlier_debt_j(), 0.001, 1e-12);
  s.t_s = 0.1;
  s.robot_port_j = -0.006;
  judge.add(s);
  EXPECT_NEAR(judge.both_earlier_debt_j(), 0.004, 1e-12) << "the slave has just followed";
  s.t_s = 10.0;
  s.robot_port_j = -0.009;
  judge.add(s);
  EXPECT_NEAR(judge.both_earlier_debt_j(), 0.004, 1e-12) << "this is the method's own";
  s.epoch = 2.0;
  judge.add(s);
  EXPECT_EQ(judge.both_initial_energy_j(), 2e-3);
}

/// While the hand is moved, a growing motion is its own.
TEST(PageJudge, WhatTheHandMovesIsNotJudged) {
  PageJudge judge{scene_of("NONE"), kRate, true};
  PageSample s;
  s.mode = s.slave_mode = static_cast<double>(Mode::coupled);
  for (int k = 0; k < 3000; ++k) {
    s.t_s = k / kRate;
    s.hand_v_m_per_s[0] = 1e-3 * std::exp(s.t_s) * std::cos(25.0 * s.t_s);
    if (k % 8 == 0) judge.disturb();
    judge.add(s);
  }
  EXPECT_EQ(judge.verdict().kind, PageVerdict::Kind::passive) << judge.verdict().reason;
}

}  // namespace
}  // namespace twoport::page_judge_test
