#include <gtest/gtest.h>

#include <csignal>
#include <string>
#include <utility>

#include "tests/support/live.h"

// A gripper beside the arm, two programs over UDP.
namespace twoport::test {
namespace {

/// Under a method whose fingers are not held back while the object is pressed: the force at rest is then that of the springs.
std::string arm() {
  std::string text = press();
  const std::string method = "FORCE_PROJECTED";
  return text.replace(text.find(method), method.size(), "INTERNAL_MODEL");
}
std::string press_and_squeeze() {
  return arm() + R"(gripper {
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
  Pair other{arm()};
  other.port = pair.port;
  Process slave = pair.listening_slave();
  Process master = other.master();
  EXPECT_EQ(master.wait().status, 2) << master.err();
  EXPECT_EQ(slave.wait().status, 2) << slave.err();
  EXPECT_NE((master.err() + slave.err()).find("differ in gripper"), std::string::npos) << master.err() << slave.err();
}

/// With a key a side tells an authenticated one only.
TEST(RunGripper, IsRefusedWhereItDiffersAlsoWithAKey) {
  Pair pair{press_and_squeeze()};
  pair.share_key();
  Process slave = pair.listening_slave();
  Process master = pair.master("master", {"--set", "gripper.force_scale=2"});
  EXPECT_EQ(master.wait().status, 2) << master.err();
  EXPECT_EQ(slave.wait().status, 2) << slave.err();
  EXPECT_NE(master.err().find("differ in gripper;"), std::string::npos) << master.err();
  EXPECT_NE(slave.err().find("differ in gripper;"), std::string::npos) << slave.err();
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

/// The device's and the robot's gripper are plug-ins; the force as above.
TEST(RunGripper, OfPlugInsSqueezesAndIsPassive) {
  const Pair pair{press_and_squeeze()};
  Process slave = pair.listening_slave("slave", {"--robot", TWOPORT_GRIPPER_PLUGIN});
  Process master = pair.master("master", {"--device", TWOPORT_GRIPPER_PLUGIN});
  EXPECT_EQ(master.wait(), Exit{.status = 0}) << master.err();
  EXPECT_EQ(slave.wait(), Exit{.status = 0}) << slave.err();
  EXPECT_NE(master.err().find("gripper: gripper of a plug-in"), std::string::npos) << master.err();
  EXPECT_NE(slave.err().find("gripper: gripper of a plug-in"), std::string::npos) << slave.err();
  EXPECT_NE(master.err().find("force 0 at the end"), std::string::npos) << master.err();
  EXPECT_NE(slave.err().find("force 0 at the end"), std::string::npos) << slave.err();
  const schema::Summary m = pair.summary("master"), s = pair.summary("slave");
  ASSERT_TRUE(m.has_gripper() && s.has_gripper());
  EXPECT_EQ(m.gripper().mode(), "coupled");
  if (kept_time({m, s})) {
    EXPECT_GE(m.gripper().min_port_energy_j(), -1e-3);
    const Trace gripper{pair.at("master") + "/trace-gripper.csv"};
    EXPECT_NEAR(gripper.peak("env_f_0", 1.8, 2.0), 2.5, 0.5);
    EXPECT_NEAR(gripper.peak("master_f_0", 1.8, 2.0), 2.5, 0.5);
    EXPECT_LT(gripper["slave_x_0"].back(), 0.04);
  }
}

/// Where the program has let go of the arm the gripper is released in every tick and gets no command. Afterwards both go on.
TEST(RunGripper, OfADeviceIsReleasedWhileItsArmHasNoReadings) {
  const Pair pair{press_and_squeeze()};
  Process slave = pair.listening_slave("slave", {"--set", "duration_s=3"});
  Process master = pair.master(
      "master", {"--set", "duration_s=3", "--device", std::string{TWOPORT_GRIPPER_PLUGIN} + ":arm_stale=1.2"});
  EXPECT_EQ(master.wait(), Exit{.status = 0}) << master.err();
  slave.wait();
  EXPECT_NE(master.err().find("device gripper: 0 commands and "), std::string::npos) << master.err();
  EXPECT_EQ(master.err().find(" and 0 releases while the arm"), std::string::npos) << master.err();
  const Trace gripper{pair.at("master") + "/trace-gripper.csv"};
  EXPECT_GT(gripper.peak("master_f_0", 1.0, 1.2), 1.0);
  EXPECT_EQ(gripper.peak("master_f_0", 1.55, 1.65), 0.0);
  EXPECT_GT(gripper.peak("master_f_0", 2.5, 3.0), 0.5);
}

TEST(RunGripper, OfARobotIsReleasedWhileItsArmsReadingsAreNotFinite) {
  const Pair pair{press_and_squeeze()};
  Process slave = pair.listening_slave("slave", {"--robot", std::string{TWOPORT_GRIPPER_PLUGIN} + ":arm_nan=1.2"});
  Process master = pair.master();
  EXPECT_EQ(master.wait(), Exit{.status = 0}) << master.err();
  EXPECT_EQ(slave.wait(), Exit{.status = 0}) << slave.err();
  EXPECT_NE(slave.err().find("robot gripper: 0 commands and "), std::string::npos) << slave.err();
  EXPECT_EQ(slave.err().find(" and 0 releases while the arm"), std::string::npos) << slave.err();
  const Trace gripper{pair.at("master") + "/trace-gripper.csv"};
  EXPECT_GT(gripper.peak("env_f_0", 1.7, 2.0), 1.0);
}

/// A call that throws ends the program, with the other hardware released too.
TEST(RunGripper, EndsTheRunInWordsWhereItOrItsArmFails) {
  for (const auto& [defect, why] : {std::pair{":arm_throws=0.6", "sense() threw: the cable is out"},
                                    std::pair{":gripper_throws=0.6", "sense() threw: the gripper's cable is out"}}) {
    const Pair pair{press_and_squeeze()};
    Process slave = pair.listening_slave("slave", {"--duration", "2"});
    Process master = pair.master("master", {"--device", std::string{TWOPORT_GRIPPER_PLUGIN} + defect});
    EXPECT_EQ(master.wait(), Exit{.status = 1}) << master.err();
    EXPECT_NE(master.err().find(why), std::string::npos) << master.err();
    EXPECT_EQ(master.err().find("the gripper: ") != std::string::npos, std::string{defect}.starts_with(":gripper"))
        << master.err();
    EXPECT_NE(master.err().find("force 0 at the end"), std::string::npos) << master.err();
  }
}

TEST(RunGripper, IsRefusedWhereTheHardwareHasNone) {
  const Pair pair{press_and_squeeze()};
  const std::string plugin = TWOPORT_FIRST_PLUGIN;
  Process master = pair.master("master", {"--device", plugin}), slave = pair.slave("slave", {"--robot", plugin});
  EXPECT_EQ(master.wait().status, 2);
  EXPECT_EQ(slave.wait().status, 2);
  EXPECT_NE(master.err().find("the scene has a gripper, but the device \"" + plugin + "\" has none"), std::string::npos)
      << master.err();
  EXPECT_NE(slave.err().find("the scene has a gripper, but the robot \"" + plugin + "\" has none"), std::string::npos)
      << slave.err();
}

TEST(RunGripper, IsNotRecorded) {
  const Pair pair{press_and_squeeze()};
  Process master = pair.master("master", {"--record", pair.at("a.mcap")});
  Process lab = finished({TWOPORT_LAB, "run", pair.scene, "--record", pair.at("b.mcap")});
  for (Process* program : {&master, &lab}) {
    EXPECT_EQ(program->wait().status, 2);
    EXPECT_NE(program->err().find("the scene has a gripper, which no recording holds"), std::string::npos)
        << program->err();
  }
}

TEST(RunGripper, IsNotReadFromARecording) {
  const Pair plain{arm()}, pair{press_and_squeeze()};
  const std::string file = plain.at("hand.mcap");
  Process recorded = finished({TWOPORT_LAB, "run", plain.scene, "--set", "duration_s=0.5", "--record", file});
  ASSERT_EQ(recorded.wait().status, 0) << recorded.err();
  Process lab = finished({TWOPORT_LAB, "run", pair.scene, "--set", "operator={recording: \"" + file + "\"}"});
  EXPECT_EQ(lab.wait().status, 2);
  EXPECT_NE(lab.err().find("gripper is given with operator.recording: a recording has no gripper"), std::string::npos)
      << lab.err();
}

}  // namespace
}  // namespace twoport::test
