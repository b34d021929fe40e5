#include <gtest/gtest.h>

#include <csignal>
#include <string>

#include "tests/support/live.h"

// A gripper beside the arm, two programs over UDP.
namespace twoport::test {
namespace {

std::string press_and_squeeze() {
  return press() + R"(gripper {
  operator {
    hand { mass_kg: 0.05 stiffness_n_per_m: 400 damping_n_s_per_m: 6 }
    path { move_to { position_m: [0.06] duration_s: 0.001 } }
    path { hold { duration_s: 0.2 } }
    path { move_to { position_m: [0.03] duration_s: 0.6 } }
  }
  device { mass_kg: 0.05 damping_n_s_per_m: 0.5 position_m: [0.06] max_force_n: 8 }
  robot { mass_kg: 0.2 damping_n_s_per_m: 2 position_m: [0.06] force_sensor { } }
  object { width_m: 0.04 stiffness_n_per_m: 2000 }
}
)";
}

/// Three springs in series press with 2.5 N; 20 %: a hand and a link that have just come to rest.
TEST(RunGripper, SqueezesAndIsPassive) {
  const Pair pair{press_and_squeeze()};
  Process slave = pair.listening_slave(), master = pair.master();
  EXPECT_EQ(master.wait(), Exit{.status = 0}) << master.err();
  EXPECT_EQ(slave.wait(), Exit{.status = 0}) << slave.err();
  const schema::Summary m = pair.summary("master"), s = pair.summary("slave");
  ASSERT_TRUE(m.has_gripper() && s.has_gripper());
  EXPECT_EQ(m.gripper().mode(), "coupled");
  EXPECT_GT(m.gripper().coupled_share(), 0.8);
  EXPECT_GT(s.gripper().robot_max_force_n(), 1.0);
  if (kept_time({m, s})) {
    EXPECT_GE(m.gripper().min_port_energy_j(), -1e-3);
    const Trace arm = pair.trace("master"), gripper{pair.at("master") + "/trace-gripper.csv"};
    EXPECT_EQ(gripper.rows(), arm.rows());
    EXPECT_NEAR(gripper.peak("env_f_0", 1.8, 2.0), 2.5, 0.5);
    EXPECT_LT(gripper["slave_x_0"].back(), 0.04);
  }
}

TEST(RunGripper, IsRefusedWhereOnlyOneSideHasIt) {
  const Pair pair{press_and_squeeze()};
  Pair other{press()};
  other.port = pair.port;
  Process slave = pair.listening_slave();
  Process master = other.master();
  EXPECT_EQ(master.wait().status, 2) << master.err();
  EXPECT_EQ(slave.wait().status, 2) << slave.err();
  EXPECT_NE((master.err() + slave.err()).find("differ in gripper"), std::string::npos) << master.err() << slave.err();
}

/// A master that is gone lets go of both: no force on the fingers from release_after_s on.
TEST(RunGripper, LetsGoWithTheArm) {
  const Pair pair{press_and_squeeze()};
  Process slave = pair.listening_slave("slave", {"--set", "control.release_after_s=0.3", "--duration", "6"});
  Process master = pair.master("master", {"--set", "control.release_after_s=0.3", "--set", "duration_s=1.2"});
  EXPECT_EQ(master.wait().status, 0) << master.err();
  slave.wait();
  const schema::Summary s = pair.summary("slave");
  EXPECT_EQ(s.gripper().mode(), s.mode());
  const Trace arm = pair.trace("slave"), gripper{pair.at("slave") + "/trace-gripper.csv"};
  EXPECT_EQ(gripper["mode"].back(), arm["mode"].back());
  EXPECT_GT(gripper.peak("slave_f_0", 0.0, 1.2), 0.5);
}

TEST(RunGripper, IsNotRecorded) {
  const Pair pair{press_and_squeeze()};
  Process master = pair.master("master", {"--record", pair.at("a.mcap")});
  EXPECT_EQ(master.wait().status, 2);
  EXPECT_NE(master.err().find("the scene has a gripper, which no recording holds"), std::string::npos) << master.err();
}

}  // namespace
}  // namespace twoport::test
