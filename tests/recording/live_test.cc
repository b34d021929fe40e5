#include "tests/support/live.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <random>
#include <string>
#include <thread>

#include "tests/recording/rewrite.h"

// Both programs over UDP, recorded. The recordings are replayed by the laboratory, bit by bit.
namespace twoport::test::live_test {
namespace {

std::string replayed(const std::string& recording, int status = 0) {
  Process lab = finished({TWOPORT_LAB, "replay", recording});
  EXPECT_EQ(lab.wait(), exited(status)) << lab.out() << lab.err();
  return lab.out() + lab.err();
}

/// Both sides run the scene to its end and record.
struct RecordedPair : Pair {
  explicit RecordedPair(const std::string& text, const Words& of_both = {}) : Pair{text} {
    Words of_slave{"--record", at("slave.mcap")}, of_master{"--record", at("master.mcap")};
    of_slave.insert(of_slave.end(), of_both.begin(), of_both.end());
    of_master.insert(of_master.end(), of_both.begin(), of_both.end());
    Process s = listening_slave("slave", of_slave);
    Process m = master("master", of_master);
    EXPECT_EQ(m.wait(), exited(0)) << m.err();
    EXPECT_EQ(s.wait(), exited(0)) << s.err();
    EXPECT_EQ(count(m.err() + s.err(), "missing from"), 0) << m.err() << s.err();
  }
};

/// 10 ms, jitter that reorders, and 5 % loss each way.
std::string lossy(int dof, std::string_view method) {
  std::string text = press(dof);
  const auto replace = [&](const std::string& what, const std::string& by) {
    for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += by.size())
      text.replace(at, what.size(), by);
  };
  replace("delay_ms: 10", "delay_ms: 10 jitter_ms: 2 loss: 0.05");
  replace("FORCE_PROJECTED", std::string{method});
  return text;
}

TEST(RecordedLive, BothSidesReplayToTheBit) {
  const RecordedPair pair{lossy(3, "FORCE_PROJECTED")};
  for (const char* side : {"master", "slave"}) {
    const std::string said = replayed(pair.at(std::string{side} + ".mcap"));
    EXPECT_NE(said.find(std::string{side} + ": "), std::string::npos) << said;
    EXPECT_NE(said.find(" ticks, identical to the bit"), std::string::npos) << said;
  }
}

TEST(RecordedLive, WithWordsOfTheMethodToo) {
  const RecordedPair pair{lossy(6, "INTERNAL_MODEL")};
  replayed(pair.at("master.mcap"));
  replayed(pair.at("slave.mcap"));
}

TEST(RecordedLive, TheTraceIsThatOfTheRun) {
  const RecordedPair pair{press(1)};
  for (const std::string side : {"master", "slave"}) {
    Process lab = finished({TWOPORT_LAB, "export", pair.at(side + ".mcap"), "--csv", pair.at(side + ".csv")});
    ASSERT_EQ(lab.wait(), exited(0)) << lab.err();
    EXPECT_EQ(bytes_of(pair.at(side + ".csv")), bytes_of(pair.at(side) + "/trace.csv")) << side;
  }
}

TEST(RecordedLive, ARenderedEnvironmentReplaysToTheBit) {
  const Folder folder;
  const std::string scene = folder.write("scene.textproto", press(3, "RENDER"));
  Process m = finished(
      {TWOPORT_MASTER, "--scene", scene, "--no-spin", "--out", folder / "out", "--record", folder / "render.mcap"});
  ASSERT_EQ(m.wait(), exited(0)) << m.err();
  EXPECT_NE(replayed(folder / "render.mcap").find("master: "), std::string::npos);
}

TEST(RecordedLive, OfARestartedPeerReplaysToTheBit) {
  const Pair pair{lossy(1, "FORCE_PROJECTED")};
  Process s = pair.listening_slave("slave", {"--record", pair.at("slave.mcap"), "--set", "duration_s=20"});
  {
    Process first = pair.master("first", {"--record", pair.at("first.mcap"), "--set", "duration_s=20"});
    ASSERT_TRUE(first.says("paired"));
    std::this_thread::sleep_for(500ms);
    first.send(SIGKILL);
    EXPECT_EQ(first.wait(), killed_by(SIGKILL));
  }
  Process second = pair.master("second", {"--record", pair.at("second.mcap"), "--set", "duration_s=20"});
  ASSERT_TRUE(s.says("re-paired"));
  std::this_thread::sleep_for(500ms);
  second.send(SIGINT);
  second.wait();
  s.send(SIGINT);
  s.wait();
  for (const char* each : {"first.mcap", "second.mcap", "slave.mcap"}) replayed(pair.at(each));
}

TEST(RecordedLive, SwitchesOfTheMethodReplayToTheBit) {
  const std::string text = [] {
    std::string t = press(1);
    t.replace(t.find("passivity {"), 0,
              "schedule { at_s: 0.6 passivity { method: INTERNAL_MODEL } } schedule { at_s: 1.2 passivity { method: "
              "WAVE_VARIABLES } } ");
    return t;
  }();
  const RecordedPair pair{text};
  replayed(pair.at("master.mcap"));
  replayed(pair.at("slave.mcap"));
}

TEST(RecordedLive, AProgramThatIsKilledAtItsStartLeavesAReadableRecording) {
  const Pair pair{lossy(1, "FORCE_PROJECTED")};
  Process s = pair.listening_slave("slave", {"--set", "duration_s=20"});
  Process m = pair.master("master", {"--record", pair.at("master.mcap"), "--set", "duration_s=20"});
  ASSERT_TRUE(m.says("paired"));
  m.send(SIGKILL);
  EXPECT_EQ(m.wait(), killed_by(SIGKILL));
  s.send(SIGINT);
  s.wait();
  EXPECT_FALSE(read_messages(pair.at("master.mcap")).torn);
  EXPECT_NE(replayed(pair.at("master.mcap")).find("identical to the bit"), std::string::npos);
}

/// Kills the master at random moments: TWOPORT_KILLS of them, by default 3.
TEST(RecordedLive, AKilledProgramLosesHalfASecondAtMost) {
  const char* asked = std::getenv("TWOPORT_KILLS");
  const int kills = asked != nullptr ? std::atoi(asked) : 3;
  std::minstd_rand random{7};
  int ended = 0;
  double worst_s = 0.0, sum_s = 0.0;
  for (int k = 0; k < kills; ++k) {
    const Pair pair{lossy(3, "FORCE_PROJECTED")};
    Process s = pair.listening_slave("slave", {"--set", "duration_s=20"});
    Process m = pair.master("master", {"--record", pair.at("master.mcap"), "--set", "duration_s=20"});
    ASSERT_TRUE(m.says("paired"));
    const auto start = std::chrono::system_clock::now();
    std::this_thread::sleep_for(std::chrono::milliseconds{600 + random() % 1000});
    m.send(SIGKILL);
    const auto killed = std::chrono::system_clock::now();
    EXPECT_EQ(m.wait(), killed_by(SIGKILL));
    s.send(SIGINT);
    s.wait();
    ASSERT_GT(killed - start, 500ms);

    const Messages there = read_messages(pair.at("master.mcap"));
    ASSERT_FALSE(there.all.empty());
    const double lost_s = std::chrono::duration<double>(killed.time_since_epoch()).count() -
                          1e-9 * static_cast<double>(there.all.back().log_time_ns);
    worst_s = std::max(worst_s, lost_s);
    sum_s += lost_s;
    ended += there.torn ? 0 : 1;
    // Half a second between two flushes, and the time until the thread comes round on a busy machine.
    EXPECT_LT(lost_s, 1.0);
    EXPECT_NE(replayed(pair.at("master.mcap")).find("identical to the bit"), std::string::npos);
  }
  fmt::print("{} of {} files have their end; lost: mean {:.2f} s, most {:.2f} s\n", ended, kills, sum_s / kills,
             worst_s);
}

TEST(RecordedLive, PlaysBackAsDeviceAndRobot) {
  const RecordedPair pair{press(1)};
  const Pair again{press(1)};
  Process s = again.listening_slave("slave", {"--robot", "playback:" + pair.at("slave.mcap")});
  Process m = again.master("master", {"--device", "playback:" + pair.at("master.mcap")});
  EXPECT_EQ(m.wait(), exited(0)) << m.err();
  EXPECT_EQ(s.wait(), exited(0)) << s.err();
  const Trace before = pair.trace("master"), now = again.trace("master");
  // The hand goes 20 to 30 mm, as it did; where both have kept their ticks, at the same time.
  EXPECT_NEAR(now.peak("master_x_0", 0.0, 2.0), before.peak("master_x_0", 0.0, 2.0), 1e-9);
  EXPECT_GT(now.peak("master_x_0", 0.0, 2.0), 0.02);
  EXPECT_NEAR(again.trace("slave").peak("slave_x_0", 0.0, 2.0), pair.trace("slave").peak("slave_x_0", 0.0, 2.0), 1e-9);
}

TEST(RecordedLive, AFileThatCannotBeWrittenIsRefusedAtOnce) {
  const Pair pair;
  Process m = pair.master("master", {"--record", "/dev/null/run.mcap"});
  EXPECT_EQ(m.wait(), exited(2));
  EXPECT_NE(m.err().find("twoport-master: /dev/null/run.mcap: cannot be written: Not a directory"), std::string::npos)
      << m.err();
}

TEST(RecordedLive, ARecordingIsNeitherLostToTheNextRunNorWrittenOverItsOwnHand) {
  const Pair pair{press(1)};
  const std::string file = pair.at("run.mcap");
  const auto lab = [&](const Words& more) {
    Words words{TWOPORT_LAB, "run", pair.scene, "--set", "duration_s=0.3", "--trace", "none", "--out", pair.at("out")};
    words.insert(words.end(), more.begin(), more.end());
    return finished(words);
  };
  Process first = lab({"--record", file});
  ASSERT_EQ(first.wait(), exited(0)) << first.err();
  EXPECT_EQ(count(first.err(), "earlier"), 0) << first.err();
  const std::string before = bytes_of(file);
  Process second = lab({"--record", file, "--set", "seed=2"});
  ASSERT_EQ(second.wait(), exited(0));
  EXPECT_EQ(count(second.err(), file + " of an earlier run is now " + file + "~\n"), 1) << second.err();
  EXPECT_EQ(bytes_of(file + "~"), before);
  replayed(file);

  Process own = lab({"--record", file, "--set", "operator.recording=\"" + file + "\""});
  EXPECT_EQ(own.wait(), exited(2));
  EXPECT_EQ(own.err(), "twoport-lab: " + file + ": is read or written now; give another name\n");
  replayed(file);
  Process live = pair.master("master", {"--record", file, "--set", "operator.recording=\"" + file + "\""});
  EXPECT_EQ(live.wait(), exited(2));
  EXPECT_NE(live.err().find(file + ": is read or written now"), std::string::npos) << live.err();
  Process nameless = lab({"--record", ""}), nameless_live = pair.master("master", {"--record", ""});
  for (Process* each : {&nameless, &nameless_live}) {
    EXPECT_EQ(each->wait(), exited(2));
    EXPECT_NE(each->err().find(": --record is empty; give a value, or leave it out\n"), std::string::npos)
        << each->err();
  }
  const Pair three{press(3)};
  Process other = three.master("master", {"--device", "playback:" + file});
  EXPECT_EQ(other.wait(), exited(2));
  EXPECT_NE(other.err().find(file + ": it is of dof 1, but dof of the scene is 3\n"), std::string::npos) << other.err();
}

TEST(RecordedLive, AFullDiskLeavesTheResultsOfALabRun) {
  const Pair pair{press(3)};
  Process lab{{"/bin/bash", "-c",
               fmt::format("trap '' XFSZ; ulimit -f 400; exec {} run {} --trace none --out {} --record {}", TWOPORT_LAB,
                           pair.scene, pair.at("out"), pair.at("full.mcap"))}};
  EXPECT_EQ(lab.wait(), exited(1));
  EXPECT_EQ(lab.err(), "twoport-lab: --record " + pair.at("full.mcap") + ": cannot be written: File too large\n");
  EXPECT_GE(pair.summary("out").duration_s(), 1.9);
  EXPECT_NE(replayed(pair.at("full.mcap")).find("identical to the bit"), std::string::npos);
}

TEST(RecordedLive, AFullDiskIsSaidAndTheRunGoesOn) {
  const Pair pair{press(3)};
  // Scene, summary and trace are smaller; the trace is left out.
  Process s = pair.listening_slave("slave", {"--trace", "none"});
  Process m{{"/bin/bash", "-c",
             fmt::format("ulimit -f 100; exec {} --scene {} --peer {} --no-spin --trace none --out {} --record {}",
                         TWOPORT_MASTER, pair.scene, pair.address(), pair.at("master"), pair.at("full.mcap"))}};
  EXPECT_EQ(m.wait(), exited(1)) << m.err();
  s.wait();
  EXPECT_EQ(count(m.err(), "the recording ends here; what was written stays readable"), 1) << m.err();
  EXPECT_GE(pair.summary("master").duration_s(), 1.9);
  EXPECT_NE(replayed(pair.at("full.mcap")).find("identical to the bit"), std::string::npos);
}

}  // namespace
}  // namespace twoport::test::live_test
