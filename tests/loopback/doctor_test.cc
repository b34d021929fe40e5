#include <gtest/gtest.h>
#include <poll.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <deque>
#include <sstream>
#include <string>
#include <thread>
#include <utility>

#include "tests/loopback/relay.h"
#include "tests/support/live.h"
#include "tests/support/process.h"

// `twoport-lab doctor` as its users run it.
namespace twoport::test::doctor_test {
namespace {

using Clock = std::chrono::steady_clock;

/// The number behind `"name": ` after the first `after` in a JSON text.
double number(const std::string& json, const std::string& after, const std::string& name) {
  const std::size_t from = json.find(after), at = json.find("\"" + name + "\": ", from);
  if (from == std::string::npos || at == std::string::npos) return -1e9;
  return std::strtod(json.c_str() + at + name.size() + 4, nullptr);
}

/// A network between two doctors: a constant delay each way; every tenth datagram towards the slave is lost.
class Network {
 public:
  Network(std::uint16_t port, std::uint16_t slave_port, std::chrono::milliseconds there, std::chrono::milliseconds back)
      : near_{port}, slave_port_{slave_port}, there_{there}, back_{back}, thread_{[this] { run(); }} {}
  ~Network() {
    stop_ = true;
    thread_.join();
  }
  Network(const Network&) = delete;

 private:
  void run() {
    std::deque<std::pair<Clock::time_point, Datagram>> to_slave, to_master;
    std::uint16_t master_port = 0;
    std::uint64_t count = 0;
    while (!stop_) {
      std::this_thread::sleep_for(std::chrono::microseconds{100});
      const auto now = Clock::now();
      while (auto d = near_.receive()) {
        master_port = d->second;
        if (++count % 10 != 0) to_slave.emplace_back(now + there_, std::move(d->first));
      }
      while (auto d = far_.receive()) to_master.emplace_back(now + back_, std::move(d->first));
      for (; !to_slave.empty() && to_slave.front().first <= now; to_slave.pop_front())
        far_.send(to_slave.front().second, slave_port_);
      for (; !to_master.empty() && to_master.front().first <= now; to_master.pop_front())
        near_.send(to_master.front().second, master_port);
    }
  }

  Socket near_, far_;
  std::uint16_t slave_port_;
  std::chrono::milliseconds there_, back_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

TEST(Doctor, GradesTheLoopAndEveryCheck) {
  Process doctor{{TWOPORT_LAB, "doctor", "--seconds", "0.5", "--json"}};
  const Exit end = doctor.wait();
  EXPECT_TRUE(end == exited(0) || end == exited(3)) << end;  // of a busy machine
  const std::string json = doctor.out();
  EXPECT_NEAR(number(json, "\"loop\"", "ticks") + number(json, "\"loop\"", "skipped"), 500.0, 60.0) << json;
  EXPECT_GE(number(json, "\"late_us\"", "p99"), number(json, "\"late_us\"", "p50"));
  for (const std::string name :
       {"real-time priority", "locked memory", "idle latency", "timer slack", "idle states", "frequency governor",
        "kernel", "real-time throttling", "processors", "processor quota", "virtual machine", "clock source", "load",
        "temperature", "UDP queue"})
    EXPECT_NE(json.find("{\"name\": \"" + name + "\", \"grade\": \""), std::string::npos) << name << json;

  Process unprivileged{{TWOPORT_LAB, "doctor", "--seconds", "0.1"}, {.unprivileged = true}};
  unprivileged.wait();
  const std::string text = unprivileged.out();
  EXPECT_NE(text.find("bad     real-time priority: SCHED_FIFO 80 is not permitted"), std::string::npos) << text;
  EXPECT_NE(text.find("without: no SCHED_FIFO priority 80"), std::string::npos) << text;
  EXPECT_NE(text.find("cure: sudo groupadd -f realtime"), std::string::npos) << text;
}

TEST(Doctor, MeasuresALinkAndSaysWhatASceneNeeds) {
  const std::uint16_t port = free_udp_port(), slave_port = free_udp_port();
  const Network network{port, slave_port, std::chrono::milliseconds{20}, std::chrono::milliseconds{30}};
  Process answer{{TWOPORT_LAB, "doctor", "--answer", std::to_string(slave_port)}};
  ASSERT_TRUE(answer.says("listening on"));
  Process doctor{{TWOPORT_LAB, "doctor", "--link", "127.0.0.1:" + std::to_string(port), "--seconds", "2", "--json"}};
  EXPECT_EQ(doctor.wait(120s), exited(0)) << doctor.err();
  const std::string json = doctor.out();
  // Delays are exact but for the relay's and the doctors' polling, 0.1 and 0.25 ms each way, on an idle machine.
  const double round_trip = number(json, "\"round_trip_ms\"", "p50");
  EXPECT_GT(round_trip, 49.9) << json;
  EXPECT_LT(round_trip, 70.0) << json;
  // Nothing tells 20 + 30 from 25 + 25: the estimate is the half, and its bound holds the truth.
  const double back = number(json, "\"one_way_ms\"", "to_master"), bound = number(json, "\"one_way_ms\"", "bound");
  EXPECT_NEAR(back, 0.5 * round_trip, 5.0);
  EXPECT_LE(std::abs(back - 30.0), bound + 0.5 * (round_trip - 50.0) + 0.5);
  EXPECT_NEAR(number(json, "\"to_slave\": {", "loss"), 0.1, 0.01) << json;
  EXPECT_NEAR(number(json, "\"to_slave\": {", "burst_packets"), 1.0, 0.2);
  EXPECT_EQ(number(json, "\"to_master\": {", "lost"), 0.0);
  EXPECT_EQ(number(json, "\"to_master\": {", "duplicated"), 0.0);
  EXPECT_NE(json.find("\"method\": \""), std::string::npos);
  EXPECT_GE(number(json, "\"advice\"", "control.hold_after_s"), 0.1);
  answer.send(SIGINT);
  EXPECT_EQ(answer.wait(), exited(0)) << answer.err();
}

TEST(Doctor, SavesALinkThatASceneReplays) {
  const Folder folder;
  const std::uint16_t port = free_udp_port(), slave_port = free_udp_port();
  const Network network{port, slave_port, std::chrono::milliseconds{20}, std::chrono::milliseconds{30}};
  Process answer{{TWOPORT_LAB, "doctor", "--answer", std::to_string(slave_port)}};
  ASSERT_TRUE(answer.says("listening on"));
  const std::string file = folder / "link.csv";
  Process doctor{
      {TWOPORT_LAB, "doctor", "--link", "127.0.0.1:" + std::to_string(port), "--seconds", "2", "--save", file}};
  EXPECT_EQ(doctor.wait(120s), exited(0)) << doctor.err();
  EXPECT_NE(doctor.out().find("For a scene over this link"), std::string::npos) << doctor.out();

  // Every packet of both ways has a row, lost ones too.
  std::istringstream rows{read_text(file)};
  std::string row;
  std::getline(rows, row);
  EXPECT_EQ(row, "direction,sequence,sent_s,delay_ms");
  int there = 0, back = 0, lost_there = 0, lost_back = 0;
  while (std::getline(rows, row)) {
    const bool to_slave = row.starts_with("to_slave,"), lost = row.ends_with(',');
    ASSERT_TRUE(to_slave || row.starts_with("to_master,")) << row;
    ++(to_slave ? there : back);
    if (lost) ++(to_slave ? lost_there : lost_back);
  }
  EXPECT_LE(there, 2100);
  EXPECT_GE(there, 1500) << "a loop that is late skips ticks";
  EXPECT_NEAR(back, there, 500) << "those of the slave that arrived by then";
  EXPECT_NEAR(lost_there, 0.1 * there, 0.01 * there);
  EXPECT_EQ(lost_back, 0);

  // A scene that has the file in place of delay and loss loses the same share.
  std::string text = press();
  for (const std::string way : {"to_slave", "to_master"}) {
    const std::string delay = way + " { delay_ms: 10 }";
    text.replace(text.find(delay), delay.size(), way + " { trace_file: \"link.csv\" }");
  }
  Process run = finished({TWOPORT_LAB, "run", folder.write("scene.textproto", text), "--out", folder / "run"});
  EXPECT_EQ(run.wait(), exited(0)) << run.err();
  const schema::Summary s = summary_in(folder / "run");
  const auto& packets = s.packets().to_slave();
  EXPECT_NEAR(static_cast<double>(packets.lost()), 0.1 * static_cast<double>(packets.sent()),
              0.02 * static_cast<double>(packets.sent()));
  EXPECT_EQ(s.packets().to_master().lost(), 0u);

  Process advice = finished({TWOPORT_LAB, "recommend", "--link", file, "--methods", "INTERNAL_MODEL"});
  EXPECT_EQ(advice.wait(), exited(0)) << advice.err();
  EXPECT_NE(advice.out().find("passivity { method: INTERNAL_MODEL"), std::string::npos) << advice.out();
  answer.send(SIGINT);
  EXPECT_EQ(answer.wait(), exited(0)) << answer.err();
}

TEST(Doctor, LeavesASlaveThatWaitsAsItWas) {
  for (const bool key : {false, true}) {
    Pair pair;
    if (key) pair.share_key();
    Process slave = pair.listening_slave();
    Words call{TWOPORT_LAB, "doctor", "--link", pair.address()};
    if (key) call.insert(call.end(), {"--key", pair.at("key")});
    Process doctor{call};
    EXPECT_EQ(doctor.wait(), exited(1));
    EXPECT_EQ(doctor.err(), "twoport-lab: " + pair.address() +
                                " is a program with a scene; end it, and start twoport-lab doctor --answer there\n");
    EXPECT_TRUE(slave.running()) << slave.err();
    // Its master comes, and both run the scene to its end.
    Process master = pair.master();
    EXPECT_EQ(master.wait(), exited(0)) << master.err();
    EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  }
}

TEST(Doctor, SaysThatTheOtherSideIsBusyOrAtAnotherRate) {
  const Pair pair;
  Process slave = pair.listening_slave("slave", {"--set", "duration_s=20"});
  Process master = pair.master("master", {"--set", "duration_s=20"});
  ASSERT_TRUE(master.says("paired"));
  Process doctor{{TWOPORT_LAB, "doctor", "--link", pair.address()}};
  EXPECT_EQ(doctor.wait(), exited(1));
  EXPECT_EQ(doctor.err(),
            "twoport-lab: " + pair.address() + " is busy with another program; try again when that has ended\n");
  EXPECT_TRUE(slave.running() && master.running());
  for (Process* each : {&master, &slave}) {
    each->send(SIGINT);
    each->wait();
  }
  EXPECT_EQ(pair.summary("slave").reconnects(), 0.0);

  const std::string port = std::to_string(free_udp_port());
  Process answer{{TWOPORT_LAB, "doctor", "--answer", port, "--rate-hz", "500"}};
  ASSERT_TRUE(answer.says("listening on"));
  Process other{{TWOPORT_LAB, "doctor", "--link", "127.0.0.1:" + port}};
  EXPECT_EQ(other.wait(), exited(1));
  EXPECT_EQ(other.err(), "twoport-lab: 127.0.0.1:" + port +
                             " answers at another rate than 1000 Hz; give both doctors the same --rate-hz\n");
  EXPECT_TRUE(answer.running());
  // A program with a scene calls: it ends, the doctor goes on.
  Process wrong = finished({TWOPORT_MASTER, "--scene", pair.scene, "--peer", "127.0.0.1:" + port});
  EXPECT_EQ(wrong.wait(), exited(1));
  EXPECT_NE(wrong.err().find("twoport-lab doctor runs at the slave's address, and has no scene"), std::string::npos)
      << wrong.err();
  EXPECT_TRUE(answer.running());
  answer.send(SIGINT);
  EXPECT_EQ(answer.wait(), exited(0));
}

TEST(Doctor, SaysWhatIsMissing) {
  Process nobody{{TWOPORT_LAB, "doctor", "--link", "127.0.0.1:" + std::to_string(free_udp_port()), "--seconds", "1"}};
  EXPECT_EQ(nobody.wait(), exited(1));
  EXPECT_NE(nobody.err().find("start twoport-lab doctor --answer 127.0.0.1:"), std::string::npos) << nobody.err();
  Process outside{{TWOPORT_LAB, "doctor", "--link", "192.0.2.1:45000"}};
  EXPECT_EQ(outside.wait(), exited(2));
  EXPECT_NE(outside.err().find("--key"), std::string::npos) << outside.err();
  Process wrong{{TWOPORT_LAB, "doctor", "--answer", "x"}};
  EXPECT_EQ(wrong.wait(), exited(2));
  EXPECT_EQ(wrong.err().rfind("twoport-lab: --answer: '127.0.0.1:x' is not ADDR:PORT", 0), 0U) << wrong.err();
  Process empty{{TWOPORT_LAB, "doctor", "--link", ""}};
  EXPECT_EQ(empty.wait(), exited(2));
  EXPECT_EQ(empty.err(), "twoport-lab: --link is empty; give a value, or leave it out\n");
  Process both{{TWOPORT_LAB, "doctor", "--link", "127.0.0.1:1", "--answer", "2"}};
  EXPECT_EQ(both.wait(), exited(2));
}

}  // namespace
}  // namespace twoport::test::doctor_test
