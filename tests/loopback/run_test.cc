#include <gtest/gtest.h>
#include <sys/mount.h>

#include <csignal>
#include <cstring>
#include <filesystem>
#include <regex>
#include <string>
#include <thread>

#include "proto/scene.pb.h"
#include "tests/support/live.h"

// A run from its beginning to its end, however that comes.
namespace twoport::test::run_test {
namespace {

bool exists(const std::string& path) {
  return std::filesystem::exists(path);
}

/// A side says nothing of what it cannot know, and both say the same of the robot.
void expect_only_what_is_known(const schema::Summary& m, const schema::Summary& s) {
  EXPECT_TRUE(m.has_min_port_energy_j() && m.has_felt_force_error_rms_n() && m.has_muted_share());
  EXPECT_FALSE(s.has_stable() || s.has_min_port_energy_j() || s.has_hand_min_energy_j() || s.has_max_force_n() ||
               s.has_felt_force_error_rms_n() || s.has_muted_share() || s.has_free_force_rms_n());
  EXPECT_TRUE(s.has_robot_min_energy_j());
  EXPECT_FALSE(m.has_robot_min_energy_j() || m.has_two_port_min_energy_j() || s.has_two_port_min_energy_j());
  EXPECT_TRUE(m.packets().to_slave().has_sent() && m.packets().to_master().has_received());
  EXPECT_FALSE(m.packets().to_slave().has_received() || m.packets().to_master().has_sent());
  EXPECT_TRUE(s.packets().to_master().has_sent() && s.packets().to_slave().has_received());
  EXPECT_FALSE(s.packets().to_master().has_received() || s.packets().to_slave().has_sent());
  if (!kept_time({m, s})) return;
  // The master sees the same 10 ms later, from 0.05 N on.
  EXPECT_NEAR(m.touching_share(), s.touching_share(), 0.05);
  EXPECT_NEAR(m.environment_force_mean_n(), s.environment_force_mean_n(), 0.1 * s.environment_force_mean_n());
  EXPECT_NEAR(m.robot_max_force_n(), s.robot_max_force_n(), 0.1 * s.robot_max_force_n());
}

void expect_none_rejected(const schema::Summary& m, const schema::Summary& s) {
  for (const schema::Packets& way : {s.packets().to_slave(), m.packets().to_master()})
    for (const auto& [reason, packets] : way.rejected_by())
      // While they pair, a tick that begins late finds more greetings than one tick takes.
      if (reason != "flood") ADD_FAILURE() << m.scene() << ": " << packets << " " << reason;
}

/// Both have run the pressing scene to its end: what their summaries must say.
void expect_whole_run(const Pair& pair) {
  const schema::Summary m = pair.summary("master"), s = pair.summary("slave");
  EXPECT_EQ(m.scene(), "press");
  EXPECT_EQ(m.side(), "master");
  EXPECT_EQ(s.side(), "slave");
  for (const schema::Summary& each : {m, s}) {
    EXPECT_EQ(each.architecture(), "POSITION_FORCE");
    EXPECT_EQ(each.method(), "FORCE_PROJECTED");
    EXPECT_EQ(each.dof(), 1);
    EXPECT_EQ(each.rate_hz(), 1000);
    // Ticks that a busy machine left out are not rows.
    EXPECT_GE(each.steps() + each.deadline_misses(), 1990u);
    EXPECT_LE(each.steps(), 2000u);
    // Ticks that the loop left out are time, too.
    EXPECT_GE(each.duration_s(), each.steps() / 1000.0 - 1e-9);
    EXPECT_LE(each.duration_s(), (each.steps() + each.deadline_misses()) / 1000.0 + 1e-9);
    EXPECT_GT(each.robot_max_force_n(), 0.2);
    EXPECT_GT(each.robot_max_speed_m_per_s(), 1e-3);
    if (kept_time({m, s})) {
      EXPECT_GT(each.contact_s(), 0.5);
    }
    EXPECT_GT(each.step_ns(), 0.0);
    EXPECT_LE(each.loop_lateness_us().p50(), each.loop_lateness_us().p99());
    EXPECT_LE(each.loop_lateness_us().p99(), each.loop_lateness_us().max());
    EXPECT_EQ(each.reconnects(), 0u);
  }
  EXPECT_GT(m.max_force_n(), 0.2);
  expect_sound({m, s});
  expect_only_what_is_known(m, s);
  EXPECT_GE(m.rtt_ms().p50(), 19.9) << "10 ms each way, and what a busy machine adds";
  // Each tick sends one packet; those before the two knew each other, and after one had gone, arrive nowhere.
  EXPECT_GE(m.packets().to_slave().sent(), m.steps());
  EXPECT_LE(s.packets().to_slave().received(), m.packets().to_slave().sent());
  if (kept_time({m, s})) {
    EXPECT_EQ(m.mode(), "coupled");
    EXPECT_LT(m.rtt_ms().p50(), 100.0);
    EXPECT_GT(s.packets().to_slave().received(), 0.8 * m.steps() - 200);
  }
  EXPECT_LE(m.packets().to_master().received(), s.packets().to_master().sent());
  EXPECT_EQ(s.packets().to_slave().duplicated(), 0u);
  EXPECT_EQ(m.packets().to_master().duplicated(), 0u);
  expect_none_rejected(m, s);
  EXPECT_EQ(pair.trace("master").rows(), m.steps());
  EXPECT_EQ(pair.trace("slave").rows(), s.steps());
}

TEST(Run, GoesFromEndToEndWhenTheSlaveStartsFirst) {
  const Pair pair;
  Process slave = pair.listening_slave(), master = pair.master();
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  expect_whole_run(pair);
}

TEST(Run, GoesFromEndToEndWhenTheMasterStartsFirst) {
  const Pair pair;
  Process master = pair.master();
  EXPECT_TRUE(master.says("waiting for a slave at " + pair.address())) << master.err();
  std::this_thread::sleep_for(500ms);
  Process slave = pair.slave();
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  expect_whole_run(pair);
}

/// A signal to each in the middle of contact: what was recorded until then is there, whole.
void expect_stop_by(int to_master, int to_slave) {
  const Pair pair;
  const Words longer{"--set", "duration_s=60"};
  Process slave = pair.listening_slave("slave", longer), master = pair.master("master", longer);
  for (const char* side : {"master", "slave"}) pair.await(side, 0.8);
  master.send(to_master);
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  slave.send(to_slave);
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  for (const std::string side : {"master", "slave"}) {
    const schema::Summary s = pair.summary(side);
    EXPECT_NE(s.verdict().find("interrupted"), std::string::npos) << side << ": " << s.verdict();
    EXPECT_GT(s.steps(), 100u) << side;
    EXPECT_LT(s.steps(), 60'000u) << side;
    EXPECT_EQ(pair.trace(side).rows(), s.steps()) << side;
    EXPECT_FALSE(exists(pair.at(side + "/trace.csv.partial"))) << side;
  }
}

TEST(Run, EndsWholeOnSigintToTheMasterAndSigtermToTheSlave) {
  expect_stop_by(SIGINT, SIGTERM);
}
TEST(Run, EndsWholeOnSigtermToTheMasterAndSigintToTheSlave) {
  expect_stop_by(SIGTERM, SIGINT);
}

TEST(Run, EndsWholeWhenTheTerminalGoes) {
  expect_stop_by(SIGHUP, SIGHUP);
}

TEST(Run, EndsWholeWhenItsTimeOfTheProcessorIsUp) {
  expect_stop_by(SIGXCPU, SIGXCPU);
}

TEST(Run, WithoutADurationGoesOnUntilItIsEnded) {
  std::string scene = press();
  scene.erase(scene.find("duration_s: 2\n"), 14);
  const Pair pair{scene};
  Process slave = pair.listening_slave("slave", {}, {.terminal = true}),
          master = pair.master("master", {}, {.terminal = true});
  for (const char* side : {"master", "slave"}) pair.await(side, 2.3);
  EXPECT_TRUE(master.running() && slave.running()) << master.err() << slave.err();
  for (Process* each : {&master, &slave}) {
    each->send(SIGINT);
    EXPECT_EQ(each->wait(), exited(0)) << each->err();
  }
  EXPECT_TRUE(std::regex_search(master.err(), std::regex{R"(\r +2\.[0-9] s   coupled)"})) << master.err();
  const schema::Summary m = pair.summary("master"), s = pair.summary("slave");
  EXPECT_NE(m.verdict_kind(), "UNSTABLE") << m.verdict();
  EXPECT_TRUE(m.verdict().ends_with("; interrupted")) << m.verdict();
  for (const schema::Summary& each : {m, s}) EXPECT_GT(each.duration_s(), 1.5) << each.side();
  // Given on the command line, it ends.
  const Pair rendered{press(1, "RENDER")};
  Process ended = rendered.master("ended", {"--duration", "0.2"});
  EXPECT_EQ(ended.wait(), exited(0)) << ended.err();
  EXPECT_LE(rendered.summary("ended").steps(), 200u);
}

TEST(Run, EndsAfterItsDurationThoughNobodyComes) {
  const Pair pair;
  Process alone = pair.master("alone", {"--duration", "0.3"});
  EXPECT_EQ(alone.wait(), exited(1));
  for (const std::string& part : Words{"no slave answered at ", pair.address(), "--duration", "--peer"})
    EXPECT_NE(alone.err().find(part), std::string::npos) << alone.err();
  EXPECT_EQ(pair.summary("alone").steps(), 0u);
  EXPECT_EQ(pair.summary("alone").verdict_kind(), "UNDECIDED");
  Process unused = pair.slave("unused", {"--duration", "0.3"});
  EXPECT_EQ(unused.wait(), exited(1));
  for (const std::string& part : Words{"no master called ", pair.address(), "--duration", "--peer"})
    EXPECT_NE(unused.err().find(part), std::string::npos) << unused.err();
}

TEST(Run, CountsItsDurationFromItsStart) {
  const Pair pair;
  Process slave = pair.listening_slave("slave", {"--duration", "4"});
  std::this_thread::sleep_for(500ms);
  Process master = pair.master("master", {"--duration", "60"});
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  // Half a second of waiting leaves 3.5 s together, however long the master would go on.
  EXPECT_LE(pair.summary("slave").duration_s(), 3.5);
  EXPECT_GT(pair.summary("slave").duration_s(), 0.0);
  master.send(SIGINT);
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
}

/// `signals` at once, or nearly: what a user does who presses Ctrl-C again, and `timeout -s INT`.
void expect_whole_after(Process& process, const std::vector<int>& signals, std::chrono::microseconds gap) {
  for (const int signal : signals) {
    process.send(signal);
    std::this_thread::sleep_for(gap);
  }
  EXPECT_EQ(process.wait(), exited(0)) << process.err();
}
void expect_interrupted(const Pair& pair, const std::string& out) {
  const schema::Summary s = pair.summary(out);
  EXPECT_NE(s.verdict().find("interrupted"), std::string::npos) << out << ": " << s.verdict();
  EXPECT_EQ(pair.trace(out).rows(), s.steps()) << out;
  EXPECT_FALSE(exists(pair.at(out + "/trace.csv.partial"))) << out;
}

TEST(Run, EndsWholeHoweverOftenItIsInterrupted) {
  // The second signal falls into another moment of the end each time: the loop, the release, the files.
  const Pair pair{press(1, "RENDER")};
  for (int i = 0; i < 24; ++i) {
    const std::string out = "run" + std::to_string(i);
    Process master = pair.master(out, {"--set", "duration_s=60"});
    ASSERT_TRUE(master.says("hardware: ")) << master.err();
    std::this_thread::sleep_for(60ms);
    expect_whole_after(master, {SIGINT, i % 2 == 0 ? SIGINT : SIGTERM, SIGINT}, std::chrono::microseconds{200 * i});
    expect_interrupted(pair, out);
  }
}

TEST(Run, OfBothSidesEndsWholeWhenInterruptedTwiceAndThrice) {
  const Pair pair;
  Process slave = pair.listening_slave("slave", {"--set", "duration_s=60"}),
          master = pair.master("master", {"--set", "duration_s=60"});
  for (const char* side : {"master", "slave"}) pair.await(side, 0.8);
  expect_whole_after(master, {SIGINT, SIGINT}, 1ms);
  expect_whole_after(slave, {SIGINT, SIGINT, SIGINT}, 1ms);
  for (const std::string side : {"master", "slave"}) {
    expect_interrupted(pair, side);
    EXPECT_GT(pair.summary(side).steps(), 100u) << side;
  }
}

// A file that finds no room costs itself only. /dev/full is a disk without room.
void fill_disk_under(const std::string& file) {
  std::filesystem::create_directories(std::filesystem::path{file}.parent_path());
  std::filesystem::create_symlink("/dev/full", file + ".partial");
}
bool says_no_room(const std::string& text, const std::string& file) {
  return text.find(file + ": cannot be written: No space left") != std::string::npos;
}

TEST(Run, KeepsTheSummaryWhereTheTraceFindsNoRoom) {
  const Pair pair;
  for (const std::string side : {"master", "slave"}) fill_disk_under(pair.at(side + "/trace.csv"));
  Process slave = pair.listening_slave(), master = pair.master();
  EXPECT_EQ(master.wait(), exited(1)) << master.err();
  EXPECT_EQ(slave.wait(), exited(1)) << slave.err();
  for (const auto& [side, process] : {std::pair<std::string, Process*>{"master", &master}, {"slave", &slave}}) {
    EXPECT_TRUE(says_no_room(process->err(), "trace.csv")) << process->err();
    EXPECT_NE(process->out().find("; summary in "), std::string::npos) << process->out();
    EXPECT_GT(pair.summary(side).steps(), 1000u);
    EXPECT_FALSE(exists(pair.at(side + "/trace.csv")));
    EXPECT_FALSE(exists(pair.at(side + "/trace.csv.partial")));
  }
}

TEST(Run, KeepsTheTraceAndPrintsTheSummaryWhereThatFindsNoRoom) {
  const Pair pair{press(1, "RENDER")};
  fill_disk_under(pair.at("master/summary.json"));
  Process master = pair.master("master", {"--set", "duration_s=0.5"});
  EXPECT_EQ(master.wait(), exited(1)) << master.err();
  EXPECT_TRUE(says_no_room(master.err(), "summary.json")) << master.err();
  EXPECT_GT(pair.trace("master").rows(), 300u);
  EXPECT_FALSE(exists(pair.at("master/summary.json")));
  EXPECT_NE(master.out().find("\"side\": \"master\""), std::string::npos) << master.out();
}

// A small disk of its own for each program.
TEST(Run, KeepsTheRowsThatFindRoomAndTheSummary) {
  const Pair pair{press(1, "RENDER")};
  for (const std::string side : {"master", "lab"}) {
    const std::string out = pair.at(side);
    std::filesystem::create_directories(out);
    if (mount("tmpfs", out.c_str(), "tmpfs", 0, "size=256k") != 0)
      GTEST_SKIP() << "no right to mount a file system of its own: " << std::strerror(errno);
    Process process = side == "master"
                          ? pair.master("master", {"--set", "duration_s=3"})
                          : finished({TWOPORT_LAB, "run", pair.scene, "--set", "duration_s=3", "--out", out});
    const Exit end = process.wait();
    std::size_t rows = 0, steps = 0;
    std::string wrong;
    try {
      rows = Trace{out + "/trace.csv"}.rows();
      steps = summary_in(out).steps();
    } catch (const std::exception& e) {
      wrong = e.what();
    }
    umount(out.c_str());
    EXPECT_EQ(wrong, "") << process.err();
    EXPECT_EQ(end, exited(1)) << process.err();
    EXPECT_GT(rows, 500u) << "of 250 bytes each; 192 kB are kept";
    EXPECT_GT(steps, 2500u);
    const std::string missing = "trace.csv: its last " + std::to_string(steps - rows) + " of " + std::to_string(steps);
    EXPECT_NE(process.err().find(missing + " rows cannot be written: No space left"), std::string::npos)
        << process.err();
  }
}

TEST(Run, OfTheLaboratoryKeepsWhatFindsRoom) {
  for (const std::string full : {"trace.csv", "summary.json"}) {
    const Folder folder;
    const std::string scene = folder.write("scene.textproto", press()), out = folder / "out";
    fill_disk_under(out + "/" + full);
    Process lab = finished({TWOPORT_LAB, "run", scene, "--out", out});
    EXPECT_EQ(lab.wait(), exited(1)) << lab.err();
    EXPECT_TRUE(says_no_room(lab.err(), full)) << lab.err();
    EXPECT_FALSE(exists(out + "/" + full));
    if (full == "trace.csv") {
      EXPECT_EQ(summary_in(out).steps(), 2000u);
    } else {
      EXPECT_EQ(Trace{out + "/trace.csv"}.rows(), 2000u);
      EXPECT_NE(lab.out().find("\"side\": \"lab\""), std::string::npos) << lab.out();
    }
  }
}

TEST(Run, EndsWholeOnASignalWhileItWaitsForTheOtherSide) {
  const Pair pair;
  Process slave = pair.listening_slave();
  slave.send(SIGTERM);
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  Process master = pair.master();
  ASSERT_TRUE(master.says("waiting for a slave"));
  master.send(SIGINT);
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  for (const std::string side : {"master", "slave"}) {
    EXPECT_EQ(pair.summary(side).steps(), 0u) << side;
    EXPECT_EQ(pair.summary(side).mode(), "idle") << side;
    EXPECT_EQ(pair.trace(side).rows(), 0u) << side;
  }
}

TEST(Run, LeavesNothingUnderItsFinalNameWhenKilledInTheMiddle) {
  const Pair pair;
  const Words longer{"--set", "duration_s=60"};
  Process slave = pair.listening_slave("slave", longer), master = pair.master("master", longer);
  for (const char* side : {"master", "slave"}) pair.await(side, 0.4);
  for (Process* each : {&master, &slave}) {
    each->send(SIGKILL);
    EXPECT_EQ(each->wait(), killed_by(SIGKILL));
  }
  for (const std::string side : {"master", "slave"}) {
    EXPECT_FALSE(exists(pair.at(side + "/summary.json"))) << side;
    EXPECT_FALSE(exists(pair.at(side + "/trace.csv"))) << side;
  }
}

TEST(Run, LeavesWholeFilesOrNoneWhenKilledNearItsEnd) {
  const Pair pair{press(1, "RENDER")};
  int with_summary = 0, without = 0;
  for (int i = 0; i < 24; ++i) {
    const std::string out = "run" + std::to_string(i);
    Process master = pair.master(out, {"--set", "duration_s=0.1"});
    // The end comes when the trace gets its name; kill it around then.
    for (int ms = 0; ms < 5000 && !exists(pair.at(out + "/trace.csv")) && i % 2 == 0; ++ms)
      std::this_thread::sleep_for(200us);
    if (i % 2 == 1) std::this_thread::sleep_for(100ms + i * 3ms);
    master.send(SIGKILL);
    master.wait();
    if (exists(pair.at(out + "/trace.csv"))) {
      EXPECT_GT(pair.trace(out).rows(), 0u);
    }
    if (exists(pair.at(out + "/summary.json"))) {
      ++with_summary;
      EXPECT_EQ(pair.summary(out).steps(), pair.trace(out).rows());
    } else {
      ++without;
    }
  }
  std::cout << "killed near the end: " << with_summary << " runs with a whole summary, " << without << " without\n";
}

TEST(Run, OfARenderedEnvironmentNeedsNoSlaveAndNoSocket) {
  const Pair pair{press(1, "RENDER")};
  Process master = pair.master("master", {"--set", "duration_s=1"});
  pair.await("master", 0.2);
  ASSERT_TRUE(master.running()) << master.err();
  for (const auto& fd : std::filesystem::directory_iterator{"/proc/" + std::to_string(master.pid()) + "/fd"}) {
    std::error_code gone;
    const std::string target = std::filesystem::read_symlink(fd, gone).string();
    EXPECT_EQ(target.find("socket"), std::string::npos) << target;
  }
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  const schema::Summary s = pair.summary("master");
  EXPECT_EQ(s.architecture(), "RENDER");
  expect_sound({s});
  EXPECT_GT(s.max_force_n(), 0.5);
  EXPECT_EQ(s.packets().to_slave().sent(), 0u);
  EXPECT_EQ(pair.trace("master").rows(), s.steps());
}

/// Every architecture that runs live, at one size, side by side.
void expect_each_architecture(int dof) {
  const auto* architectures = schema::Control::Architecture_descriptor();
  std::vector<std::unique_ptr<Pair>> pairs;
  std::vector<Process> running;
  for (int i = 0; i < architectures->value_count(); ++i) {
    const std::string& name = architectures->value(i)->name();
    if (name == "UNCONTROLLED") continue;  // nobody runs it live
    pairs.push_back(std::make_unique<Pair>(press(dof, name)));
    const Words shorter{"--set", "duration_s=1", "--set", "rate_hz=500", "--set", "name=" + name};
    if (name != "RENDER") running.push_back(pairs.back()->slave("slave", shorter));
    running.push_back(pairs.back()->master("master", shorter));
  }
  for (Process& each : running) EXPECT_EQ(each.wait(), exited(0)) << each.err();
  for (const auto& pair : pairs) {
    const schema::Summary m = pair->summary("master");
    EXPECT_EQ(m.architecture(), m.scene());
    EXPECT_EQ(m.dof(), dof) << m.scene();
    if (m.architecture() == "RENDER") {
      expect_sound({m});
      continue;
    }
    const schema::Summary s = pair->summary("slave");
    EXPECT_EQ(s.dof(), dof) << m.scene();
    expect_sound({m, s});
    EXPECT_GT(m.contact_s(), 0.05) << m.scene();
    EXPECT_EQ(m.mode(), "coupled") << m.scene();
    EXPECT_GT(s.packets().to_slave().received(), 0u) << m.scene();
    EXPECT_GT(m.packets().to_master().received(), 0u) << m.scene();
    expect_none_rejected(m, s);
  }
}

TEST(Run, WorksForEveryArchitectureWithOneAxis) {
  expect_each_architecture(1);
}
TEST(Run, WorksForEveryArchitectureWithThreeAxes) {
  expect_each_architecture(3);
}
TEST(Run, WorksForEveryArchitectureWithSixDegreesOfFreedom) {
  expect_each_architecture(6);
}

TEST(Run, MissesAnExpectationWithStatusThreeAndSaysWhichByHowMuch) {
  const Pair pair{press(1, "RENDER") + "expect { at_most { key: \"max_force_n\" value: 0.01 } }\n"};
  Process master = pair.master("master", {"--set", "duration_s=0.7"});
  EXPECT_EQ(master.wait(), exited(3));
  EXPECT_TRUE(std::regex_search(master.err(), std::regex{"max_force_n is .* expected at most 0.01: over by"}))
      << master.err();
}

TEST(Run, ShowsOnATerminalWhatTheTwoSidesDoAndSaysWhereTheFilesAre) {
  const Pair pair;
  Process slave = pair.listening_slave("slave", {}, {.terminal = true}),
          master = pair.master("master", {}, {.terminal = true});
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  // Mode, force, energy of its own port, round trip, loss, lateness, what the controller dissipates.
  const std::regex line{R"(/ 2.0 s   coupled    force +[0-9.]+ N  port +[+-][0-9.]+ J  rtt +2[0-9][.][0-9] ms  lost +)"
                        R"([0-9.]+ %  late +[0-9]+ us  controller +[0-9.]+ mW)"};
  const std::regex energy{R"(port +\+0\.0*[1-9])"};
  for (const auto& [side, process] : {std::pair<std::string, Process*>{"master", &master}, {"slave", &slave}}) {
    EXPECT_TRUE(std::regex_search(process->err(), line)) << process->err();
    EXPECT_TRUE(std::regex_search(process->err(), energy)) << side << ": no energy at its port\n" << process->err();
    EXPECT_NE(process->out().find("; summary and trace in " + pair.at(side) + "\n"), std::string::npos)
        << process->out();
  }
}

TEST(Run, OfASlaveThatDivergesEndsWithStatusThreeUnlessTheSceneSaysSo) {
  const Words unstable{"--set",
                       "control.passivity.method=NONE",
                       "--set",
                       "control.virtual_coupling.stiffness_n_per_m=1e6",
                       "--set",
                       "robot.mass_kg=0.01",
                       "--set",
                       "control.robot_limits={force_n: 1e9 force_rate_n_per_s: 1e18 power_w: 1e18 speed_m_per_s: 1e9 "
                       "set_point_step_m: 1e9 workspace_m: 1e9}"};
  for (const bool promised : {false, true}) {
    const Pair pair{press() + (promised ? "expect { stable: false }\n" : "")};
    Process slave = pair.listening_slave("slave", unstable), master = pair.master("master", unstable);
    EXPECT_EQ(slave.wait(), exited(promised ? 0 : 3)) << slave.err();
    EXPECT_FALSE(pair.summary("slave").stable());
    EXPECT_EQ(pair.summary("slave").verdict().find("diverged at "), 0u) << pair.summary("slave").verdict();
    // The master judges what it knows first-hand: its own motion, which its limits have kept.
    master.wait();
    EXPECT_EQ(pair.summary("master").verdict().find("diverged at "), std::string::npos)
        << pair.summary("master").verdict();
    EXPECT_EQ(count(slave.err(), "the slave has diverged at "), promised ? 0 : 1) << slave.err();
  }
}

TEST(Run, WhoseSlaveEndsEarlyIsUndecidedWithStatusThree) {
  const Pair pair;
  Process slave = pair.listening_slave(), master = pair.master();
  pair.await("slave", 1.0);
  slave.send(SIGTERM);
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_EQ(master.wait(), exited(3)) << "a scene that expects nothing does not expect this\n" << master.err();
  const schema::Summary s = pair.summary("master");
  EXPECT_EQ(s.verdict_kind(), "UNDECIDED") << s.verdict();
  EXPECT_EQ(s.verdict().find("undecided: the two sides were not coupled in the last "), 0u) << s.verdict();
  EXPECT_FALSE(s.coupled_at_end());
  EXPECT_FALSE(s.has_stable());
}

TEST(Run, OfARobotThatItsOwnCouplingDrivesIsUnstableAtTheSlave) {
  const Words driven{"--set", "robot={mass_kg: 0.01 damping_n_s_per_m: 1}",
                     "--set", "control.virtual_coupling={stiffness_n_per_m: 500 damping_n_s_per_m: 30}",
                     "--set", "control.robot_limits.force_n=20"};
  const Pair pair;
  Process slave = pair.listening_slave("slave", driven), master = pair.master("master", driven);
  EXPECT_EQ(slave.wait(), exited(3)) << slave.err();
  master.wait();
  const schema::Summary s = pair.summary("slave");
  EXPECT_EQ(s.verdict_kind(), "UNSTABLE") << s.verdict();
  EXPECT_EQ(s.verdict().find("the robot moves more than the hand, driven by its own coupling"), 0u) << s.verdict();
  EXPECT_EQ(count(slave.err(), "the slave is unstable: "), 1) << slave.err();
}

TEST(Run, LeavesNothingOfAnEarlierRunWhenItIsKilled) {
  const Pair pair{press(1, "RENDER")};
  EXPECT_EQ(pair.master("out", {"--set", "duration_s=0.1"}).wait(), exited(0));
  EXPECT_TRUE(exists(pair.at("out/summary.json")));
  Process master = pair.master("out");
  ASSERT_TRUE(master.says("hardware: ")) << master.err();
  master.send(SIGKILL);
  master.wait();
  EXPECT_FALSE(exists(pair.at("out/summary.json")));
  EXPECT_FALSE(exists(pair.at("out/trace.csv")));
}

TEST(Run, WithoutATraceWritesTheSummaryOnly) {
  const Pair pair{press(1, "RENDER")};
  Process master = pair.master("master", {"--trace", "none", "--set", "duration_s=0.1"});
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_GT(pair.summary("master").steps(), 0u);
  EXPECT_FALSE(exists(pair.at("master/trace.csv")));
  EXPECT_FALSE(exists(pair.at("master/trace.csv.partial")));
}

// The first entry at its time, the second by hand.
TEST(Schedule, BothSidesFollowItAndAUserGoesOn) {
  const Pair pair;
  const Words scheduled{"--set", "control.schedule[0].at_s=0.6",
                        "--set", "control.schedule[0].passivity.method=INTERNAL_MODEL",
                        "--set", "control.schedule[1].architecture=POSITION_POSITION"};
  Process slave = pair.listening_slave("slave", scheduled), master = pair.master("master", scheduled);
  EXPECT_TRUE(master.says("switched to INTERNAL_MODEL, POSITION_FORCE")) << master.err();
  EXPECT_TRUE(slave.says("switched to INTERNAL_MODEL, POSITION_FORCE")) << slave.err();
  master.send(SIGUSR1);
  EXPECT_TRUE(master.says("switched to INTERNAL_MODEL, POSITION_POSITION")) << master.err();
  EXPECT_TRUE(slave.says("switched to INTERNAL_MODEL, POSITION_POSITION")) << slave.err();
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  const schema::Summary m = pair.summary("master");
  EXPECT_EQ(m.switches(), 2u);
  EXPECT_EQ(m.mode(), "coupled");
  expect_sound({m, pair.summary("slave")});
}

TEST(Schedule, SignalsToTheSlaveChangeNothing) {
  const Pair pair;
  Process slave = pair.listening_slave("slave");
  slave.send(SIGUSR1);
  Process master = pair.master("master");
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_NE(pair.summary("slave").mode(), "idle");
}

TEST(Schedule, OfAnotherOrderIsRefused) {
  const Pair pair;
  Process slave = pair.listening_slave("slave", {"--set", "control.schedule[0].passivity.method=INTERNAL_MODEL"});
  Process master = pair.master("master", {"--set", "control.schedule[0].passivity.method=WAVE_VARIABLES"});
  EXPECT_EQ(master.wait(), exited(2));
  // The side that finds the difference names it.
  slave.send(SIGTERM);
  slave.wait();
  EXPECT_NE((master.err() + slave.err()).find("control.schedule"), std::string::npos) << master.err() << slave.err();
}

TEST(Clock, OfTheSlaveIsEstimatedByTheMaster) {
  const Pair pair;
  Process slave = pair.listening_slave();
  std::this_thread::sleep_for(300ms);
  Process master = pair.master();
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  const schema::Summary m = pair.summary("master");
  const schema::ClockEstimate clock = m.slave_clock();
  // Each program counts from its own start; the slave's was at least 0.3 s before.
  EXPECT_GT(clock.offset_ms(), 300.0 - clock.bound_ms());
  // 10 ms each way between the times of the ticks; one that begins late takes a packet for older by as much.
  const double late_ms = 1e-3 * (m.loop_lateness_us().max() + pair.summary("slave").loop_lateness_us().max());
  EXPECT_GT(clock.bound_ms(), 9.9 - 0.5 * late_ms);
  EXPECT_GE(clock.one_way_ms(), 9.9 - late_ms);
  EXPECT_FALSE(clock.has_error_ms());
}

}  // namespace
}  // namespace twoport::test::run_test
