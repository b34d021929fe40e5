#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <iostream>
#include <optional>
#include <string>
#include <thread>

#include "common/recording/recording.h"
#include "tests/support/live.h"

// The stop: no force at either side from then on, until both programs have ended.
namespace twoport::test::stop_test {
namespace {

/// As scripts/stop, without a program's start in between. When it was sent [ns since 1970].
std::int64_t send_stop(std::uint16_t port) {
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0), yes = 1;
  ::setsockopt(fd, SOL_SOCKET, SO_BROADCAST, &yes, sizeof yes);
  sockaddr_in all{};
  all.sin_family = AF_INET;
  all.sin_port = htons(port);
  all.sin_addr.s_addr = htonl(INADDR_BROADCAST & 0x7fffffff);  // 127.255.255.255
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  EXPECT_EQ(::sendto(fd, "", 0, 0, reinterpret_cast<const sockaddr*>(&all), sizeof all), 0);
  const timeval patience{2, 0};
  ::setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  EXPECT_GT(::recv(fd, nullptr, 0, MSG_TRUNC), 0) << "a program that listens answers";
  ::close(fd);
  return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
}

constexpr double kLead = 1e-3;  // from the start of a recording to tick 0 [s]

/// What a recording says of the stop.
struct Stopped {
  double after_s = -1.0;                             ///< first tick in the mode `stopped`, since the stop was sent
  double force_before_n = 0.0, force_after_n = 0.0;  ///< largest commands
  double applied_after_n = 0.0;                      ///< by the device, from the tick after that
  int ticks_after = 0;
  bool again = false;  ///< another mode after it
};
Stopped read_stop(const std::string& path, std::int64_t sent_ns) {
  RecordingReader recording{path};
  RecordedTick<1> recorded;
  Stopped s;
  for (RecordingReader::Kind kind; (kind = recording.next()) != RecordingReader::Kind::end;) {
    if (kind != RecordingReader::Kind::tick || !recording.tick(recorded)) continue;
    const TickRecord<1>& t = recorded.tick;
    const double force = std::abs(t.command[0]);
    if (s.ticks_after == 0 && t.mode != Mode::stopped) {
      s.force_before_n = std::max(s.force_before_n, force);
      continue;
    }
    if (s.ticks_after++ == 0)
      s.after_s = kLead + 1e-9 * static_cast<double>(recording.header().start_unix_ns + t.now.count() - sent_ns);
    s.again = s.again || t.mode != Mode::stopped;
    s.force_after_n = std::max(s.force_after_n, force);
    if (s.ticks_after > 2 && recording.header().of_master())
      s.applied_after_n = std::max(s.applied_after_n, std::abs(t.f[0]));
  }
  return s;
}

TEST(Stop, OfOneDatagramReleasesBothSidesOfTwoArmsWithinTenMilliseconds) {
  const Pair left, right;
  const std::uint16_t port = free_udp_port();
  const Words listens{"--stop-port", std::to_string(port)}, longer{"--set", "duration_s=3"};
  const auto with = [&](const Pair& pair, const char* name, Words more) {
    more.insert(more.end(), {"--record", pair.at(name) + ".mcap"});
    more.insert(more.end(), longer.begin(), longer.end());
    return more;
  };
  // At one arm the master listens, at the other the slave: the other side of each is told over the link.
  Process left_slave = left.listening_slave("slave", with(left, "slave", {}));
  Process right_slave = right.listening_slave("slave", with(right, "slave", listens));
  Process left_master = left.master("master", with(left, "master", listens));
  Process right_master = right.master("master", with(right, "master", {}));
  for (const Pair* pair : {&left, &right})
    for (const char* side : {"master", "slave"}) pair->await(side, 1.0);
  const std::int64_t sent_ns = send_stop(port);

  const auto expect_stopped = [&](const Pair& pair, Process& program, const char* name, double way_s, bool timely,
                                  const std::string& by) {
    SCOPED_TRACE(pair.at(name));
    EXPECT_EQ(program.wait(), exited(1)) << program.err();
    EXPECT_EQ(count(program.err(), "s: stopped by " + by + ": no force until both programs have ended"), 1)
        << program.err();
    const schema::Summary summary = pair.summary(name);
    EXPECT_EQ(summary.mode(), "stopped");
    EXPECT_EQ(summary.verdict(), "stopped by " + by + "; the hardware was released");
    const Stopped s = read_stop(pair.at(name) + ".mcap", sent_ns);
    std::cout << name << ": stopped after " << 1e3 * s.after_s << " ms, of which " << 1e3 * way_s
              << " ms are the link's; before " << s.force_before_n << " N, after " << s.force_after_n << " N"
              << (timely ? "" : "; time not judged: ticks were left out") << "\n";
    EXPECT_GT(s.force_before_n, 0.5);
    EXPECT_EQ(s.force_after_n, 0.0);
    EXPECT_EQ(s.applied_after_n, 0.0);
    EXPECT_FALSE(s.again);
    EXPECT_GT(s.ticks_after, 100);
    EXPECT_GE(s.after_s, way_s - 1e-3);
    EXPECT_LT(s.after_s, timely ? way_s + 10e-3 : 1.0);
    Process replay = finished({TWOPORT_LAB, "replay", pair.at(name) + ".mcap"});
    EXPECT_EQ(replay.wait(), exited(0)) << replay.out() << replay.err();
  };
  const std::string other = "the other side", own = "--stop-port";
  left_master.wait(), left_slave.wait(), right_master.wait(), right_slave.wait();
  const auto timely = [](const Pair& pair) { return kept_time({pair.summary("master"), pair.summary("slave")}); };
  expect_stopped(left, left_master, "master", 0.0, timely(left), own);
  expect_stopped(left, left_slave, "slave", 10e-3, timely(left), other);
  expect_stopped(right, right_slave, "slave", 0.0, timely(right), own);
  expect_stopped(right, right_master, "master", 10e-3, timely(right), other);
}

TEST(Stop, LastsUntilBothProgramsHaveEnded) {
  const Pair pair;
  const std::uint16_t port = free_udp_port();
  Process slave = pair.listening_slave("slave", {"--set", "duration_s=60"});
  Process first = pair.master("first", {"--set", "duration_s=60", "--stop-port", std::to_string(port)});
  EXPECT_TRUE(first.says("paired with the slave"));
  std::this_thread::sleep_for(500ms);
  Process stop = finished({TWOPORT_SCRIPTS "/stop", std::to_string(port)});
  EXPECT_EQ(stop.wait(), exited(0)) << stop.err();
  EXPECT_TRUE(slave.says("stopped by the other side", 5s)) << slave.err();
  first.send(SIGINT);
  EXPECT_EQ(first.wait(), exited(1)) << first.err();

  // The next master meets the slave that is stopped.
  Process second = pair.master("second", {"--set", "duration_s=1.5"});
  EXPECT_EQ(second.wait(), exited(1)) << second.err();
  EXPECT_NE(second.err().find("stopped by the other side"), std::string::npos) << second.err();
  EXPECT_EQ(pair.trace("second").peak("master_f_0", 0.5, 1.5), 0.0);
  slave.send(SIGINT);
  EXPECT_EQ(slave.wait(), exited(1)) << slave.err();
  const Trace of_slave = pair.trace("slave");
  const std::vector<double>& modes = of_slave["mode"];
  const auto stopped = std::find(modes.begin(), modes.end(), static_cast<double>(Mode::stopped));
  ASSERT_NE(stopped, modes.end());
  const double at_s = of_slave["t_s"][static_cast<std::size_t>(stopped - modes.begin())];
  EXPECT_EQ(of_slave.peak("slave_f_0", at_s + 2e-3, 60.0), 0.0);

  Process slave_again = pair.listening_slave("slave_again"), third = pair.master("third");
  EXPECT_EQ(third.wait(), exited(0)) << third.err();
  EXPECT_EQ(slave_again.wait(), exited(0)) << slave_again.err();
  EXPECT_EQ(pair.summary("third").mode(), "coupled");
}

}  // namespace
}  // namespace twoport::test::stop_test
