#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "tests/support/live.h"

// Two arms as plug-ins, joint by joint, two programs over UDP: the leader's first joint goes to and fro between 0 and 0.5 rad with 3 s, the
// follower's meets a wall at 0.3 rad.
namespace twoport::test::joints_test {
namespace {

TEST(RunJoints, OfPlugInsPressesAndIsPassive) {
  const Pair pair{two_arms(TWOPORT_EXAMPLES)};
  Process slave = pair.listening_slave("slave", {"--robot", TWOPORT_ARM_PLUGIN});
  Process master = pair.master("master", {"--device", TWOPORT_ARM_PLUGIN});
  EXPECT_EQ(master.wait(), Exit{.status = 0}) << master.err();
  EXPECT_EQ(slave.wait(), Exit{.status = 0}) << slave.err();
  for (const Process* side : {&master, &slave}) {
    EXPECT_NE(side->err().find("hardware: odd arm"), std::string::npos) << side->err();
    EXPECT_NE(side->err().find("arm: torques 0 0 0 at the end"), std::string::npos) << side->err();
  }
  const schema::Summary m = pair.summary("master"), s = pair.summary("slave");
  EXPECT_EQ(m.mode(), "coupled");
  EXPECT_GT(m.coupled_share(), 0.8);
  if (!kept_time({m, s})) return;
  EXPECT_GE(m.min_port_energy_j(), -1e-3);
  const Trace felt = pair.trace("master"), pressed = pair.trace("slave");
  EXPECT_EQ(felt.columns.count("master_x_2"), 1u);
  EXPECT_EQ(felt.columns.count("master_x_3"), 0u) << "three joints";
  EXPECT_GT(felt.peak("master_x_0", 0.0, 3.0), 0.32);
  EXPECT_LT(pressed.peak("slave_x_0", 0.0, 3.0), 0.31) << "the wall";
  // Where the hand turns back, 1.5 s after it has begun.
  const double pressed_n_m = pressed.peak("env_f_0", 1.4, 1.6), felt_n_m = felt.peak("master_f_0", 1.4, 1.6);
  EXPECT_GT(pressed_n_m, 2.0);
  EXPECT_NEAR(felt_n_m, pressed_n_m, 0.2 * pressed_n_m);
  EXPECT_LT(felt.peak("master_x_2", 0.0, 3.0), 1e-3) << "joints that nobody moves rest";
}

/// The plug-in's limit of a joint, where the arm's file allows 10 N m; replay knows it from the recording.
TEST(RunJoints, KeepsThePlugInsLimitsAndReplays) {
  const Pair pair{two_arms(TWOPORT_EXAMPLES)};
  Process slave = pair.listening_slave("slave", {"--robot", TWOPORT_ARM_PLUGIN});
  Process master = pair.master(
      "master", {"--device", std::string{TWOPORT_ARM_PLUGIN} + ":torque=2", "--record", pair.at("master.mcap")});
  EXPECT_EQ(master.wait(), Exit{.status = 0}) << master.err();
  EXPECT_EQ(slave.wait(), Exit{.status = 0}) << slave.err();
  EXPECT_NEAR(pair.trace("master").peak("master_f_0", 0.0, 3.0), 2.0, 1e-6);
  Process replay = finished({TWOPORT_LAB, "replay", pair.at("master.mcap")});
  EXPECT_EQ(replay.wait(), Exit{.status = 0}) << replay.out() << replay.err();
}

/// A joint whose number is missing: the arm is released while it is, and the run ends when it stays so. The hand is let go.
TEST(RunJoints, WithoutANumberOfAJointLetsGo) {
  const Pair pair{two_arms(TWOPORT_EXAMPLES)};
  const std::string quick = "control.release_after_s=0.3";
  Process slave =
      pair.listening_slave("slave", {"--set", quick, "--robot", std::string{TWOPORT_ARM_PLUGIN} + ":nan=1.2"});
  Process master = pair.master("master", {"--set", quick, "--device", TWOPORT_ARM_PLUGIN});
  EXPECT_EQ(slave.wait().status, 1) << slave.err();
  EXPECT_NE(slave.err().find("readings are not finite numbers; the hardware was released"), std::string::npos)
      << slave.err();
  EXPECT_EQ(master.wait().status, 3) << "not coupled to the end: " << master.err();
  EXPECT_NE(slave.err().find("arm: torques 0 0 0 at the end"), std::string::npos) << slave.err();
  const Trace felt = pair.trace("master");
  EXPECT_GT(felt.peak("master_f_0", 0.9, 1.3), 0.5);
  EXPECT_EQ(felt["master_f_0"].back(), 0.0);
}

TEST(RunJoints, WithAMomentWithoutANumberGoesOn) {
  const Pair pair{two_arms(TWOPORT_EXAMPLES)};
  Process slave = pair.listening_slave("slave", {"--robot", std::string{TWOPORT_ARM_PLUGIN} + ":blink=0.7"});
  Process master = pair.master("master", {"--device", std::string{TWOPORT_ARM_PLUGIN} + ":blink=0.4"});
  EXPECT_EQ(master.wait(), Exit{.status = 0}) << master.err();
  EXPECT_EQ(slave.wait(), Exit{.status = 0}) << slave.err();
  const schema::Summary m = pair.summary("master"), s = pair.summary("slave");
  EXPECT_EQ(m.mode(), "coupled");
  if (!kept_time({m, s})) return;
  EXPECT_GE(m.min_port_energy_j(), -1e-3);
  EXPECT_GT(pair.trace("slave").peak("env_f_0", 1.2, 3.0), 2.0);
}

/// Two arms on one torso: two pairs of programs, one with a key, and one stop.
TEST(RunJoints, OfTwoPairsEndsByOneStop) {
  Pair left{two_arms(TWOPORT_EXAMPLES)}, right{two_arms(TWOPORT_EXAMPLES)};
  right.share_key();
  const std::string port = std::to_string(free_udp_port());
  const auto with = [](const char* flag, Words more = {}) {
    more.insert(more.end(), {flag, TWOPORT_ARM_PLUGIN, "--set", "duration_s=10"});
    return more;
  };
  const Words listens{"--stop-port", port};
  Process left_slave = left.listening_slave("slave", with("--robot"));
  Process right_slave = right.listening_slave("slave", with("--robot", listens));
  Process left_master = left.master("master", with("--device", listens));
  Process right_master = right.master("master", with("--device"));
  for (const Pair* pair : {&left, &right})
    for (const char* side : {"master", "slave"}) pair->await(side, 1.0);
  Process stop = finished({TWOPORT_SCRIPTS "/stop", port});
  EXPECT_EQ(stop.wait(), exited(0)) << stop.err();
  for (Process* program : {&left_slave, &left_master, &right_slave, &right_master}) {
    EXPECT_EQ(program->wait(), exited(1)) << program->err();
    EXPECT_NE(program->err().find("no force until both programs have ended"), std::string::npos) << program->err();
  }
  EXPECT_TRUE(right.summary("master").encrypted());
}

/// A joint of 0.03 kg m2 and 0.1 N m s/rad; the stand-in goes by the clock.
TEST(RunJoints, AProbeMeasuresOneJointOfAPlugIn) {
  const std::string arm = TWOPORT_ARM_PLUGIN;
  const Process measured = finished({TWOPORT_DEVICE, "probe", arm + ":free", "--joint", "2", "--move", "--json"});
  const std::string key = "\"inertia_kg_m2\": ", json = measured.out();
  ASSERT_NE(json.find(key), std::string::npos) << json << measured.err();
  EXPECT_NEAR(std::stod(json.substr(json.find(key) + key.size())), 0.03, 0.006) << json;
  const auto says = [](const Words& arguments, const std::string& what) {
    Words command{TWOPORT_DEVICE, "probe"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    Process process = finished(command);
    EXPECT_EQ(process.wait(), exited(2));
    EXPECT_NE(process.err().find(what), std::string::npos) << process.err();
  };
  says({arm, "--joint", "4"}, "--joint is 4, but " + arm + " has 3 joints");
  says({arm}, "it has one for --device with space JOINTS");
  says({"sim", "--joint", "1"}, "--joint: a plug-in says what its arm is; for sim --scene must");
  const std::string scene = TWOPORT_SCENES "/leader_follower.textproto";
  says({"sim", "--scene", scene}, "space is JOINTS; --joint must be 1 to 7");
  says({"sim", "--scene", scene, "--joint", "8"}, "space is JOINTS; --joint must be 1 to 7");
}

}  // namespace
}  // namespace twoport::test::joints_test
