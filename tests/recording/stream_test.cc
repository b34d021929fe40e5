#include <google/protobuf/struct.pb.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/loopback/relay.h"
#include "tests/support/live.h"

// --stream: rows of a live run as JSON in UDP datagrams.
namespace twoport::test::stream_test {
namespace {

using google::protobuf::Struct;

/// The datagrams at a port, from now on.
class Listener {
 public:
  explicit Listener(std::uint16_t port) : socket_{port}, thread_{[this] { listen(); }} {}
  ~Listener() { end(); }
  Listener(const Listener&) = delete;
  /// All that have come.
  const std::vector<std::string>& end() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
    return texts_;
  }

 private:
  void listen() {
    while (!stop_) {
      while (const auto d = socket_.receive())
        texts_.emplace_back(reinterpret_cast<const char*>(d->first.data()), d->first.size());
      std::this_thread::sleep_for(std::chrono::milliseconds{1});
    }
  }
  Socket socket_;
  std::atomic<bool> stop_{false};
  std::vector<std::string> texts_;
  std::thread thread_;
};

Struct parsed(const std::string& text) {
  Struct object;
  const auto status = google::protobuf::util::JsonStringToMessage(text, &object);
  EXPECT_TRUE(status.ok()) << status.ToString() << text;
  return object;
}

TEST(Stream, SendsTheColumnsOfTheTraceOneObjectADatagram) {
  const std::uint16_t port = free_udp_port();
  Listener listener{port};
  const Pair pair{press(6)};
  const std::string to = "127.0.0.1:" + std::to_string(port);
  Process s = pair.listening_slave("slave", {"--stream", to, "--stream-hz", "20"});
  Process m = pair.master("master", {"--stream", to});
  EXPECT_EQ(m.wait(), exited(0)) << m.err();
  EXPECT_EQ(s.wait(), exited(0)) << s.err();
  const double ran_s = pair.summary("master").duration_s();
  int of_master = 0, of_slave = 0;
  double last_s = -1.0, pressed_n = 0.0;
  for (const std::string& text : listener.end()) {
    EXPECT_EQ(text.find('\n'), text.size() - 1) << text;
    const Struct object = parsed(text);
    const auto& fields = object.fields();
    ASSERT_EQ(fields.count("timestamp"), 1u) << text;
    const double t_s = fields.at("timestamp").number_value();
    if (fields.count("slave") == 1) {
      ++of_slave;
      continue;
    }
    ++of_master;
    const auto& columns = fields.at("master").struct_value().fields();
    EXPECT_EQ(columns.at("t_s").number_value(), t_s);
    EXPECT_EQ(columns.at("master_x").list_value().values_size(), 6);
    EXPECT_EQ(columns.at("env_f").list_value().values_size(), 6);
    EXPECT_EQ(columns.count("round_trip_ms") + columns.count("lost") + columns.count("late_us"), 3u);
    pressed_n = std::max(pressed_n, std::abs(columns.at("env_f").list_value().values(0).number_value()));
    // One that left-out ticks have delayed does not delay the next: only their number has a bound.
    EXPECT_GT(t_s, last_s);
    last_s = t_s;
  }
  EXPECT_GT(pressed_n, 0.5) << "the wall is in the stream";
  // Those of ticks that a busy machine left out are missing.
  EXPECT_LE(of_master, 100.0 * ran_s + 2.0);
  EXPECT_GE(of_master, 60.0 * ran_s);
  EXPECT_GE(of_slave, 12.0 * ran_s);
  EXPECT_LT(of_slave, of_master / 3);
}

TEST(Stream, BeyondThisMachineIsAWarning) {
  const std::string warning = ": positions and forces of this side leave this machine unencrypted";
  const auto said = [](const std::string& address) {
    const Pair pair{press(1)};
    Process alone = pair.master("alone", {"--stream", address, "--duration", "0.2"});
    alone.wait();
    return alone.err();
  };
  EXPECT_NE(said("192.0.2.1:9870").find("--stream 192.0.2.1:9870" + warning), std::string::npos);
  EXPECT_EQ(said("127.0.0.1:" + std::to_string(free_udp_port())).find(warning), std::string::npos);
}

TEST(Stream, ToNobodyChangesNothing) {
  const Pair pair{press(1)};
  Process s = pair.listening_slave();
  Process m = pair.master("master", {"--stream", "127.0.0.1:" + std::to_string(free_udp_port())});
  EXPECT_EQ(m.wait(), exited(0)) << m.err();
  EXPECT_EQ(s.wait(), exited(0)) << s.err();
  for (const auto& [address, says] :
       {std::pair{"", "--stream is empty; give a value, or leave it out"},
        {"127.0.0.1:0", "--stream 127.0.0.1:0: the port is 0; it must be from 1 to 65535"},
        {"127.0.0.1", "--stream: '127.0.0.1' is not ADDR:PORT"}}) {
    Process wrong = pair.master("wrong", {"--stream", address});
    EXPECT_EQ(wrong.wait(), exited(2));
    EXPECT_NE(wrong.err().find(says), std::string::npos) << wrong.err();
  }
}

}  // namespace
}  // namespace twoport::test::stream_test
