#include <gtest/gtest.h>

#include <csignal>
#include <string>
#include <utility>

#include "common/base/file.h"
#include "tests/support/live.h"

// A gripper beside the arm, two programs over UDP.
namespace twoport::test::gripper_test {
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

/// Fingers that were let go of under a grip are opened by the object, and relative to that the closed handle does not grip again.
const Words kGripsAgain{"--set", "control.registration.mode=ABSOLUTE"};
Words gripping_again(Words more) {
  more.insert(more.end(), kGripsAgain.begin(), kGripsAgain.end());
  return more;
}

/// Where the program has let go of the arm the gripper is released in every tick and gets no command. Afterwards both go on.
TEST(RunGripper, OfADeviceIsReleasedWhileItsArmHasNoReadings) {
  const Pair pair{press_and_squeeze()};
  Process slave = pair.listening_slave("slave", gripping_again({"--set", "duration_s=3"}));
  Process master = pair.master("master", gripping_again({"--set", "duration_s=3", "--device",
                                                         std::string{TWOPORT_GRIPPER_PLUGIN} + ":arm_stale=1.2"}));
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
  Process slave =
      pair.listening_slave("slave", gripping_again({"--robot", std::string{TWOPORT_GRIPPER_PLUGIN} + ":arm_nan=1.2"}));
  Process master = pair.master("master", kGripsAgain);
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
    Process slave = pair.listening_slave("slave", {"--duration", "60"});
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

/// Number of ticks of each side that replay `file` finds identical, as the program prints it; it must end with status 0.
std::string replayed(const std::string& file) {
  Process replay = finished({TWOPORT_LAB, "replay", file});
  EXPECT_EQ(replay.wait(), Exit{.status = 0}) << replay.out() << replay.err();
  return replay.out();
}

TEST(RunGripper, IsRecordedAndReplaysToTheBit) {
  const Pair pair{press_and_squeeze()};
  Process slave = pair.listening_slave("slave", {"--record", pair.at("slave.mcap")});
  Process master = pair.master("master", {"--record", pair.at("master.mcap")});
  EXPECT_EQ(master.wait(), Exit{.status = 0}) << master.err();
  EXPECT_EQ(slave.wait(), Exit{.status = 0}) << slave.err();
  for (const std::string side : {"master", "slave"}) {
    const std::string said = replayed(pair.at(side + ".mcap"));
    EXPECT_NE(said.find(side + ": "), std::string::npos) << said;
    EXPECT_NE(said.find(side + "/gripper: "), std::string::npos) << said;
    Process exported = finished({TWOPORT_LAB, "export", pair.at(side + ".mcap"), "--csv", pair.at(side + ".csv")});
    EXPECT_EQ(exported.wait(), Exit{.status = 0}) << exported.err();
    EXPECT_TRUE(read_whole(pair.at(side + ".csv")) == read_whole(pair.at(side) + "/trace.csv")) << side;
    EXPECT_TRUE(read_whole(pair.at(side + "-gripper.csv")) == read_whole(pair.at(side) + "/trace-gripper.csv")) << side;
  }
}

/// Also where the node is told nothing for a while: what is recorded is what the node was given.
TEST(RunGripper, ReplaysWhereItsArmHadNoReadings) {
  const Pair pair{press_and_squeeze()};
  Process slave = pair.listening_slave();
  Process master = pair.master("master", {"--record", pair.at("master.mcap"), "--device",
                                          std::string{TWOPORT_GRIPPER_PLUGIN} + ":arm_stale=0.6"});
  EXPECT_EQ(master.wait(), Exit{.status = 0}) << master.err();
  slave.wait();
  EXPECT_NE(replayed(pair.at("master.mcap")).find("master/gripper: "), std::string::npos);
}

/// The hand and the fingers of a recording are those of the run that plays it, to a tick; the hand rests at both ends.
TEST(RunGripper, IsPlayedBack) {
  const Pair pair{press_and_squeeze()};
  Process lab = finished({TWOPORT_LAB, "run", pair.scene, "--out", pair.at("lab"), "--record", pair.at("lab.mcap")});
  EXPECT_EQ(lab.wait(), Exit{.status = 0}) << lab.err();
  Process slave = pair.listening_slave("slave", {"--robot", "playback:" + pair.at("lab.mcap")});
  Process master = pair.master("master", {"--device", "playback:" + pair.at("lab.mcap")});
  EXPECT_EQ(master.wait(), Exit{.status = 0}) << master.err();
  slave.wait();
  EXPECT_NE(master.err().find("gripper: playback of a hand"), std::string::npos) << master.err();
  const Trace recorded{pair.at("lab") + "/trace-gripper.csv"}, at_hand{pair.at("master") + "/trace-gripper.csv"},
      at_fingers{pair.at("slave") + "/trace-gripper.csv"};
  if (!kept_time({pair.summary("master"), pair.summary("slave")})) return;
  const auto first_and_last = [](const Trace& trace, const char* column) {
    return std::pair{trace[column][10], trace[column].back()};
  };
  for (const auto& [played, column] : {std::pair{&at_hand, "master_x_0"}, std::pair{&at_fingers, "slave_x_0"}}) {
    const auto [from, to] = first_and_last(recorded, column);
    const auto [played_from, played_to] = first_and_last(*played, column);
    EXPECT_GT(from - to, 0.015) << column;
    EXPECT_NEAR(played_from, from, 1e-4) << column;
    EXPECT_NEAR(played_to, to, 1e-4) << column;
  }
}

TEST(RunGripper, IsNotPlayedBackFromARecordingWithoutOne) {
  const Pair plain{arm()}, pair{press_and_squeeze()};
  const std::string file = plain.at("hand.mcap");
  Process recorded = finished({TWOPORT_LAB, "run", plain.scene, "--set", "duration_s=0.5", "--record", file});
  ASSERT_EQ(recorded.wait().status, 0) << recorded.err();
  Process master = pair.master("master", {"--device", "playback:" + file});
  EXPECT_EQ(master.wait().status, 2);
  EXPECT_NE(master.err().find("the scene has a gripper, but the device \"playback:" + file + "\" has none"),
            std::string::npos)
      << master.err();
}

}  // namespace
}  // namespace twoport::test::gripper_test
