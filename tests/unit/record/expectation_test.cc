#include <gtest/gtest.h>

#include <limits>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/record/summary.h"

namespace twoport::expectation_test {
namespace {

using Sentences = std::vector<std::string>;

TEST(Expectations, ThatAreMetSayNothing) {
  Summary s;
  s.set_stable(true);
  s.set_min_port_energy_j(-1e-4);
  s.set_drift_m(0.01);
  s.mutable_packets()->mutable_to_slave()->set_lost(0);
  EXPECT_EQ(violations({.stable = true,
                        .at_least = {{"min_port_energy_j", -1e-4}},
                        .at_most = {{"drift_m", 0.01}, {"packets.to_slave.lost", 0}}},
                       s),
            Sentences{});
  EXPECT_EQ(violations({}, s), Sentences{});
}

TEST(Expectations, OfAMethodConcernItsRunsOnly) {
  Summary s;
  s.set_method("CLASSIC");
  s.set_verdict_kind("UNSTABLE");
  s.set_verdict("port energy -1 J");
  const ExpectSpec expect{
      .stable = {}, .at_least = {}, .at_most = {}, .of_method = {{"NONE", "STABLE"}, {"CLASSIC", "STABLE"}}};
  EXPECT_EQ(violations(expect, s),
            Sentences{"verdict_kind with CLASSIC is UNSTABLE, expected STABLE: port energy -1 J"});
  s.set_verdict_kind("STABLE");
  EXPECT_EQ(violations(expect, s), Sentences{});
}

TEST(Expectations, OfAStableRunWantAStableGripper) {
  ExpectSpec expect;
  expect.stable = true;
  Summary s;
  s.set_stable(true);
  s.mutable_gripper()->set_stable(true);
  EXPECT_EQ(violations(expect, s), Sentences{});
  s.mutable_gripper()->set_stable(false);
  s.mutable_gripper()->set_verdict("diverged at 1 s");
  EXPECT_EQ(violations(expect, s), Sentences{"gripper.stable is false, expected stable true: diverged at 1 s"});
  EXPECT_EQ(violations({}, s), Sentences{});
}

TEST(Expectations, ThatAreMissedSayByHowMuch) {
  Summary s;
  s.set_min_port_energy_j(-0.0123);
  s.set_drift_m(0.5);
  s.mutable_rtt_ms()->set_p99(7);
  EXPECT_EQ(violations({.stable = {},
                        .at_least = {{"min_port_energy_j", -0.0001}},
                        .at_most = {{"drift_m", 0.2}, {"rtt_ms.p99", 5}}},
                       s),
            (Sentences{"min_port_energy_j is -0.0123, expected at least -0.0001: short by 0.0122",
                       "drift_m is 0.5, expected at most 0.2: over by 0.3",
                       "rtt_ms.p99 is 7, expected at most 5: over by 2"}));
}

TEST(Expectations, MayBeStabilityOrInstability) {
  Summary s;
  s.set_stable(false);
  s.set_verdict("grows");
  EXPECT_EQ(violations({.stable = true, .at_least = {}, .at_most = {}}, s),
            Sentences{"stable is false, expected true: grows"});
  EXPECT_EQ(violations({.stable = false, .at_least = {}, .at_most = {}}, s), Sentences{});
  s.set_stable(true);
  s.set_verdict("bounded");
  EXPECT_EQ(violations({.stable = false, .at_least = {}, .at_most = {}}, s),
            Sentences{"stable is true, expected false: bounded"});
}

TEST(Expectations, OfStabilityAreMissedByAnUndecidedRun) {
  Summary s;
  set_verdict({VerdictKind::undecided, "undecided: too short"}, s);
  EXPECT_EQ(violations({.stable = true, .at_least = {}, .at_most = {}}, s),
            Sentences{"stable is undecided, expected true: undecided: too short"});
  EXPECT_EQ(violations({.stable = false, .at_least = {}, .at_most = {}}, s),
            Sentences{"stable is undecided, expected false: undecided: too short"});
}

TEST(Expectations, AreMissedByANumberThatIsNone) {
  Summary s;
  s.set_drift_m(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(violations({.stable = {}, .at_least = {{"drift_m", -1}}, .at_most = {{"drift_m", 1}}}, s),
            (Sentences{"drift_m is nan, expected at least -1", "drift_m is nan, expected at most 1"}));
}

TEST(Expectations, AreMissedByWhatIsNotKnown) {
  Summary s;
  EXPECT_EQ(violations({.stable = true,
                        .at_least = {{"held_force_ratio", 0.9}},
                        .at_most = {{"muted_share", 0.1}, {"rtt_ms.p99", 5}}},
                       s),
            (Sentences{"stable is not known of this run, expected true",
                       "held_force_ratio is not known of this run, expected at least 0.9",
                       "muted_share is not known of this run, expected at most 0.1",
                       "rtt_ms.p99 is not known of this run, expected at most 5"}));
  s.mutable_rtt_ms();  // a block that is there has all its numbers
  EXPECT_EQ(violations({.stable = {}, .at_least = {}, .at_most = {{"rtt_ms.p99", 5}}}, s), Sentences{});
}

TEST(Expectations, OfAnUnknownNumberAreAnError) {
  try {
    static_cast<void>(violations({.stable = {}, .at_least = {{"drift", 0}}, .at_most = {}}, Summary{}));
    FAIL() << "it was known";
  } catch (const ConfigError& e) {
    EXPECT_NE(std::string{e.what()}.find("\"drift\""), std::string::npos) << e.what();
  }
}

}  // namespace
}  // namespace twoport::expectation_test
