// Hands, robots, networks and packets that are drawn to create energy, against what each method claims.

#include "lab/study/adversary.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <tuple>
#include <vector>

#include "common/base/check.h"
#include "common/coupling/claim.h"
#include "common/method/catalogue.h"
#include "lab/study/map.h"
#include "lab/study/parallel.h"

namespace twoport::lab::adversary_test {
namespace {

class AttackedMethod : public testing::TestWithParam<std::string> {};

// scripts/check adversary runs 10,000.
TEST_P(AttackedMethod, KeepsWhatItClaimsIn500Runs) {
  const Adversary all = attack_all({.methods = {GetParam()}, .seed = 1, .runs = 500, .jobs = all_cores()});
  EXPECT_EQ(broken_runs(all), "");
}
INSTANTIATE_TEST_SUITE_P(Of, AttackedMethod, testing::ValuesIn(method_names()),
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

Claim claim_named(const std::string& method) {
  ControlOptions o;
  o.handle_mass_kg = 0.1;
  EXPECT_TRUE(choose_method(o, method)) << method;
  return claim_of(o);
}

// Every pair that claims a bound keeps it over switches, limits at both sides, queues, dead directions, packets that come again, other rates,
// a clock that drifts, scales, clutch and locks; more than half of its runs have a bound. `twoport-lab adversary --claiming` runs more.
class EveryClaim : public testing::TestWithParam<std::string> {};
TEST_P(EveryClaim, HoldsIn150Runs) {
  const Adversary all = attack_all({.methods = {GetParam()}, .seed = 2001, .runs = 150, .jobs = all_cores()});
  EXPECT_EQ(broken_runs(all), "");
  int bounded = 0, switched = 0, felt = 0;
  for (const AdversaryRun& run : all.runs[0]) {
    bounded += std::isfinite(run.hand_bound_j) || std::isfinite(run.both_bound_j);
    switched += run.switches > 0;
    felt += run.felt_max_n > 0.1;
  }
  EXPECT_GT(bounded, 60);
  if (claim_named(GetParam()).hand) {
    EXPECT_GT(switched, 30);
  }
  EXPECT_GT(felt, 90) << "what is kept is not kept by silence";
}
INSTANTIATE_TEST_SUITE_P(Of, EveryClaim, testing::ValuesIn(claiming_methods()), [](const auto& each) {
  std::string name = each.param;
  std::replace(name.begin(), name.end(), '+', '_');
  return name;
});

// A queue holds what the hand did until both sides have released; the hand rests when it flows.
TEST(Adversary, NoRobotMovesByItself) {
  const Adversary all = attack_all({.methods = {"INTERNAL_MODEL", "ENERGY_EXCHANGE", "FORCE_PROJECTED", "ENERGY_TANK",
                                                "SET_POSITION_MODULATION", "NONE"},
                                    .seed = 1,
                                    .runs = 200,
                                    .jobs = all_cores()});
  EXPECT_EQ(moved_runs(all), "");
  int rests = 0;
  for (const AdversaryRun& run : all.runs[0]) rests += run.rests;
  EXPECT_GT(rests, 20);
}

// Both sides couple again, the master first, which says nothing of its offset yet.
TEST(Adversary, NoRobotMovesByAnOffsetOfTheCouplingBefore) {
  for (const char* method : {"INTERNAL_MODEL+ENERGY_SPRING", "INTERNAL_MODEL+ENERGY_EXCHANGE"}) {
    const AdversaryRun run = attack(method, 910036081);
    EXPECT_TRUE(run.rests);
    EXPECT_LT(run.self_moved_m, 1e-4) << method;
  }
}

// Two axes open at once while the hand moves along the third: what they would take in does not pay.
TEST(Adversary, AnAxisThatOpensPaysForNoOther) {
  for (const char* method : {"INTERNAL_MODEL+ENERGY_SPRING", "INTERNAL_MODEL+ENERGY_EXCHANGE"})
    EXPECT_FALSE(attack(method, 910023542).broken()) << method;
}

// What voids a claim, and what remains of it in a run that switches.
TEST(Claims, AreThoseOfThePairWithItsOptions) {
  ControlOptions o;
  o.handle_mass_kg = 0.1;
  o.known.device_damping_n_s_per_m = 0.1;
  const auto claim = [&](const char* method) {
    EXPECT_TRUE(choose_method(o, method));
    return to_string(claim_of(o));
  };
  EXPECT_EQ(claim("INTERNAL_MODEL"), "hand");
  EXPECT_EQ(claim("FORCE_PROJECTED"), "hand, both");
  EXPECT_EQ(claim("INTERNAL_MODEL+FORCE_PROJECTED"), "hand");
  EXPECT_EQ(claim("RANDOM+ENERGY_SPRING_TWO_PORT"), "both");
  EXPECT_EQ(claim("ENERGY_EXCHANGE"), "hand, both");
  EXPECT_EQ(claim("SET_POSITION_MODULATION"), "both");
  EXPECT_EQ(claim("WAVE_VARIABLES"), "none");
  EXPECT_EQ(claim("ENERGY_BOUNDING"), "hand");
  o.energy_bounding.damping_n_s_per_m = 0.2;
  EXPECT_EQ(claim("ENERGY_BOUNDING"), "none") << "the device has 0.1 N s/m";
  o.robot_limits.force_rate_n_per_s = 100.0;
  EXPECT_EQ(claim("ENERGY_TANK"), "none");
  EXPECT_EQ(claim("FORCE_PROJECTED"), "hand, both");
  o.device_limits.force_rate_n_per_s = 50e3;
  o.device_limits.force_n = 25.0;
  o.known.master_tick = Seconds{1e-3};
  EXPECT_EQ(claim("INTERNAL_MODEL"), "hand") << "no force changes by more than 50 N";
  o.device_limits.force_rate_n_per_s = 49e3;
  EXPECT_EQ(claim("INTERNAL_MODEL"), "none");
  EXPECT_EQ(claim("RANDOM+ENERGY_SPRING_TWO_PORT"), "both");
  o.observer = ObserverRule::rectangle;
  EXPECT_EQ(claim("RANDOM+ENERGY_SPRING_TWO_PORT"), "none");

  ControlOptions first;
  first.handle_mass_kg = 0.1;
  EXPECT_TRUE(choose_method(first, "FORCE_PROJECTED"));
  const auto over = [&](const char* method) {
    ScheduledControl next{1.0, first};
    EXPECT_TRUE(choose_method(next.control, method));
    return to_string(claim_of(first, {&next, 1}));
  };
  EXPECT_EQ(over("INTERNAL_MODEL"), "hand");
  EXPECT_EQ(over("ENERGY_EXCHANGE"), "hand");
  EXPECT_EQ(over("FOUR_CHANNEL+FORCE_PROJECTED"), "hand");
  EXPECT_EQ(over("RANDOM+ENERGY_SPRING_TWO_PORT"), "none");
  EXPECT_EQ(over("NONE"), "none");
}

// Under a transparency layer that displays a model FORCE_PROJECTED keeps the hand's port, not both.
TEST(Adversary, ForceProjectedKeepsOnlyTheHandsPortUnderAModel) {
  const std::vector<std::string> methods{"INTERNAL_MODEL+FORCE_PROJECTED", "SURFACE_MODEL+FORCE_PROJECTED"};
  for (const std::string& method : methods) {
    EXPECT_TRUE(claim_named(method).hand) << method;
    EXPECT_FALSE(claim_named(method).both) << method;
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

// Hand and robot together, by either name. E(0) of the robot's side is in its own joules. Lies about energy are no part of the claim.
class BothPorts : public testing::TestWithParam<const char*> {};
TEST_P(BothPorts, GiveNoMoreThanEZeroOfEachSide) {
  int honest = 0, felt = 0, driven = 0;
  for (const char* scale : {"1", "10"})
    for (std::uint64_t seed = 1; seed <= 300; ++seed) {
      const AdversaryRun run = attack(GetParam(), seed, {std::string{"control.force_scale="} + scale});
      if (!std::isfinite(run.both_bound_j)) continue;
      ++honest;
      felt += run.felt_max_n > 0.1;
      driven += run.both_least_j < -0.3e-3;
      EXPECT_FALSE(run.broken()) << seed << ": " << run.both_least_j << " J of " << run.both_bound_j;
    }
  EXPECT_GT(honest, 180);
  EXPECT_GT(felt, 150);
  EXPECT_GT(driven, 60) << "E(0) must be used";
}
INSTANTIATE_TEST_SUITE_P(Of, BothPorts, testing::Values("INTERNAL_MODEL+ENERGY_SPRING_TWO_PORT", "ENERGY_EXCHANGE"));

// Limits that act, at either side: what is applied is booked, and a force that the limit of its rate could hold is not shown.
class Limited : public testing::TestWithParam<const char*> {};
TEST_P(Limited, LetsNothingOutOfBothPorts) {
  int driven = 0;
  for (std::uint64_t seed = 1; seed <= 160; ++seed) {
    const AdversaryRun run = attack("ENERGY_EXCHANGE", seed, {std::string{"control."} + GetParam()});
    if (!std::isfinite(run.both_bound_j)) continue;
    driven += run.both_least_j < -0.3e-3;
    EXPECT_FALSE(run.broken()) << seed << ": " << run.both_least_j << " J of " << run.both_bound_j;
  }
  EXPECT_GT(driven, 5) << "E(0) must be used";
}
INSTANTIATE_TEST_SUITE_P(Of, Limited,
                         testing::Values("robot_limits.force_n=2", "robot_limits.force_rate_n_per_s=200",
                                         "robot_limits.power_w=0.2", "robot_limits.speed_m_per_s=0.1",
                                         "robot_limits.set_point_step_m=1e-4", "robot_limits.workspace_m=0.01",
                                         "device_limits.force_rate_n_per_s=300", "device_limits.power_w=0.2",
                                         "device_limits.speed_m_per_s=0.1", "device_limits.workspace_m=0.01"));

// The same of the robot's limits under layers whose transparency layer has a damper at the robot: the account has the part of the damper
// that is applied, and the set point moves no further than it pays for.
using LimitAndMethod = std::tuple<const char*, const char*>;
class LimitedDamper : public testing::TestWithParam<LimitAndMethod> {};
TEST_P(LimitedDamper, LetsNothingOutOfBothPorts) {
  const auto& [method, limit] = GetParam();
  int bounded = 0;
  for (std::uint64_t seed = 1; seed <= 120; ++seed) {
    const AdversaryRun run = attack(method, seed, {std::string{"control.robot_limits."} + limit});
    bounded += std::isfinite(run.both_bound_j);
    EXPECT_FALSE(run.broken()) << seed << ": " << run.both_least_j << " J of " << run.both_bound_j;
  }
  EXPECT_GT(bounded, 30);
}
INSTANTIATE_TEST_SUITE_P(Of, LimitedDamper,
                         testing::Combine(testing::Values("FIXED_DAMPING+ENERGY_SPRING_TWO_PORT",
                                                          "FIXED_DAMPING+FORCE_PROJECTED",
                                                          "CONTACT_SPRING+FORCE_PROJECTED", "FORCE_PROJECTED"),
                                          testing::Values("force_n=2", "force_rate_n_per_s=200", "speed_m_per_s=0.1",
                                                          "workspace_m=0.01", "set_point_step_m=1e-4")));

TEST(Adversary, ASeedIsARun) {
  const Adversary many = attack_all({.methods = {"ENERGY_TANK"}, .seed = 40, .runs = 150, .jobs = 2});
  const AdversaryRun alone = attack("ENERGY_TANK", 187);
  EXPECT_EQ(many.runs[0][147].seed, 187U);
  EXPECT_EQ(many.runs[0][147].hand_least_j, alone.hand_least_j);
  EXPECT_EQ(many.runs[0][147].both_least_j, alone.both_least_j);
  EXPECT_THROW(attack("NO_SUCH", 1), ConfigError);
}

}  // namespace
}  // namespace twoport::lab::adversary_test
