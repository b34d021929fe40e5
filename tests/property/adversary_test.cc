// Hands, robots, networks and packets that are drawn to create energy, against what each method claims.

#include "lab/study/adversary.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/method/catalogue.h"
#include "lab/study/map.h"
#include "lab/study/parallel.h"

namespace twoport::lab {
namespace {

class EveryMethod : public testing::TestWithParam<std::string> {};

// scripts/check adversary runs 10,000.
TEST_P(EveryMethod, KeepsWhatItClaimsIn500Runs) {
  const Adversary all = attack_all({.methods = {GetParam()}, .seed = 1, .runs = 500, .jobs = all_cores()});
  EXPECT_EQ(broken_runs(all), "");
}
INSTANTIATE_TEST_SUITE_P(Of, EveryMethod, testing::ValuesIn(method_names()),
                         [](const auto& each) { return each.param; });

// The claim of a passivity layer is proven for any transparency layer by one that draws its force.
class EveryPassivityLayer : public testing::TestWithParam<std::string> {};
TEST_P(EveryPassivityLayer, KeepsWhatItClaimsIn500RunsUnderRandomForces) {
  const Adversary all = attack_all({.methods = {"RANDOM+" + GetParam()}, .seed = 1, .runs = 500, .jobs = all_cores()});
  EXPECT_EQ(broken_runs(all), "");
  int felt = 0, below = 0;
  for (const AdversaryRun& run : all.runs[0]) felt += run.felt_max_n > 0.1, below += run.below();
  EXPECT_GT(felt, 250) << "what is kept is not kept by silence";
  if (GetParam() == "NONE") {
    EXPECT_GT(below, 250);
  }
}
std::vector<std::string> passivity_layers() {
  std::vector<std::string> all;
  for (const PassivityLayerName& each : kPassivityLayers) all.emplace_back(each.name);
  return all;
}
INSTANTIATE_TEST_SUITE_P(Of, EveryPassivityLayer, testing::ValuesIn(passivity_layers()),
                         [](const auto& each) { return each.param; });

// Under a transparency layer that displays a model FORCE_PROJECTED keeps the hand's port, not both.
TEST(Adversary, ForceProjectedKeepsOnlyTheHandsPortUnderAModel) {
  const std::vector<std::string> methods{"INTERNAL_MODEL+FORCE_PROJECTED", "SURFACE_MODEL+FORCE_PROJECTED"};
  for (const std::string& method : methods) {
    EXPECT_TRUE(energy_claim(method).hand) << method;
    EXPECT_FALSE(energy_claim(method).both) << method;
  }
  const Adversary all = attack_all({.methods = methods, .seed = 1, .runs = 500, .jobs = all_cores()});
  EXPECT_EQ(broken_runs(all), "");
  double least_j = 0.0;
  for (const auto& of_method : all.runs)
    for (const AdversaryRun& run : of_method) least_j = std::min(least_j, run.both_least_j);
  EXPECT_LT(least_j, -0.01) << "if it kept both it could claim so";
}

// The adversary is one: without a controller every third hand gets more than E(0). And methods display forces: what they keep
// is not kept by silence.
TEST(Adversary, GetsEnergyFromALoopWithoutControl) {
  const Adversary all = attack_all(
      {.methods = {"NONE", "INTERNAL_MODEL", "FORCE_PROJECTED"}, .seed = 1, .runs = 200, .jobs = all_cores()});
  int below = 0, felt = 0;
  for (const AdversaryRun& run : all.runs[0]) below += run.below();
  for (const std::size_t m : {1U, 2U})
    for (const AdversaryRun& run : all.runs[m]) felt += run.felt_max_n > 0.1;
  EXPECT_GT(below, 67);
  EXPECT_GT(felt, 300);
}

// Strict: hand and slave together, with E(0) once, to rounding. Lies about energy are no part of the claim.
TEST(Adversary, GetsNothingFromBothPortsOfAStrictTwoPort) {
  int honest = 0, felt = 0, driven = 0;
  for (std::uint64_t seed = 1; seed <= 400; ++seed) {
    const AdversaryRun run = attack("INTERNAL_MODEL", seed, {"control.passivity.internal_model.strict_two_port=true"});
    if (run.lies) continue;
    ++honest;
    felt += run.felt_max_n > 0.1;
    driven += run.both_least_j < -0.3e-3;
    EXPECT_GE(run.both_least_j, -1e-3 - 1e-9) << seed;
  }
  EXPECT_GT(honest, 250);
  EXPECT_GT(felt, 200);
  EXPECT_GT(driven, 50) << "E(0) must be used";
}

// E(0)/2 of the slave is in the master's joules, as E(0) is.
TEST(Adversary, GetsNothingFromBothPortsOfAScaledStrictTwoPort) {
  int driven = 0;
  for (std::uint64_t seed = 1; seed <= 150; ++seed) {
    const AdversaryRun run = attack(
        "INTERNAL_MODEL", seed, {"control.passivity.internal_model.strict_two_port=true", "control.force_scale=10"});
    if (run.lies) continue;
    driven += run.both_least_j < -0.3e-3;
    // Seed 73 lets 9.6 J come out without strict_two_port.
    EXPECT_GE(run.both_least_j, -1e-3 - 1e-9) << seed;
  }
  EXPECT_GT(driven, 10) << "E(0) must be used";
}

// Limits that act, at either side: what is applied is booked, the set point moves no further than the level pays for, and a force
// that the limit of its rate could hold is not shown. Without that 17 of the first 150 runs end below -E(0) with the device's rate, 48, 7, 18
// and 70 with the robot's rate, speed, step and workspace, by 3.2 J at most.
class Limited : public testing::TestWithParam<const char*> {};
TEST_P(Limited, LetsNothingOutOfBothPortsOfAStrictTwoPort) {
  int driven = 0;
  for (std::uint64_t seed = 1; seed <= 160; ++seed) {
    const AdversaryRun run =
        attack("INTERNAL_MODEL", seed,
               {"control.passivity.internal_model.strict_two_port=true", std::string{"control."} + GetParam()});
    if (run.lies) continue;
    driven += run.both_least_j < -0.3e-3;
    EXPECT_GE(run.both_least_j, -1e-3 - 1e-9) << seed;
  }
  EXPECT_GT(driven, 40) << "E(0) must be used";
}
INSTANTIATE_TEST_SUITE_P(Of, Limited,
                         testing::Values("robot_limits.force_n=2", "robot_limits.force_rate_n_per_s=200",
                                         "robot_limits.power_w=0.2", "robot_limits.speed_m_per_s=0.1",
                                         "robot_limits.set_point_step_m=1e-4", "robot_limits.workspace_m=0.01",
                                         "device_limits.force_rate_n_per_s=300", "device_limits.power_w=0.2",
                                         "device_limits.speed_m_per_s=0.1", "device_limits.workspace_m=0.01"));

TEST(Adversary, ASeedIsARun) {
  const Adversary many = attack_all({.methods = {"ENERGY_TANK"}, .seed = 40, .runs = 150, .jobs = 2});
  const AdversaryRun alone = attack("ENERGY_TANK", 187);
  EXPECT_EQ(many.runs[0][147].seed, 187U);
  EXPECT_EQ(many.runs[0][147].hand_least_j, alone.hand_least_j);
  EXPECT_EQ(many.runs[0][147].both_least_j, alone.both_least_j);
  EXPECT_THROW(attack("NO_SUCH", 1), ConfigError);
}

}  // namespace
}  // namespace twoport::lab
