#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/loopback/relay.h"
#include "tests/support/live.h"

// Reports that have waited on the way move and feed nothing, and a coupling is one of both sides or of none
// (docs/reference/safety.md, "Old reports").
namespace twoport::test::old_reports_test {
namespace {

using namespace std::chrono_literals;

/// The hand rests for 1.5 s, moves by 100 mm, and rests. `wall_m`: where a wall begins.
std::string away(double wall_m) {
  return R"(name: "away" dof: 1 duration_s: 60 rate_hz: 1000 seed: 7
operator {
  hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 }
  path { hold { duration_s: 1.5 } } path { move_to { position_m: [0.1] duration_s: 1 } } path { hold { duration_s: 100 } }
}
device { mass_kg: 0.075 damping_n_s_per_m: 0.05 max_force_n: 8.5 }
control { virtual_coupling { stiffness_n_per_m: 1000 damping_n_s_per_m: 20 } }
to_slave { delay_ms: 5 } to_master { delay_ms: 5 }
robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { } }
environment { wall { normal: [-1] offset_m: )" +
         std::to_string(-wall_m) + " stiffness_n_per_m: 5000 } }\n";
}

constexpr double kStill_m = 1e-3, kNoForce_n = 0.5;

/// Of a column from t_s on: largest difference to the first value.
double moved(const Trace& trace, const std::string& name, double from_s) {
  const auto &t = trace["t_s"], &x = trace[name];
  const auto first = static_cast<std::size_t>(std::lower_bound(t.begin(), t.end(), from_s) - t.begin());
  double most = 0.0;
  for (std::size_t k = first; k < x.size(); ++k) most = std::max(most, std::abs(x[k] - x[first]));
  return most;
}
bool was_in(const Trace& trace, double mode, double from_s) {
  const auto &t = trace["t_s"], &modes = trace["mode"];
  for (std::size_t k = 0; k < t.size(); ++k)
    if (t[k] >= from_s && modes[k] == mode) return true;
  return false;
}

/// Both programs with a key, and a relay without it between them.
struct Between {
  explicit Between(const std::string& scene, Words of_master = {}, std::function<void(Relay&)> each_ms = {})
      : pair{scene} {
    pair.share_key();
    slave.emplace(pair.listening_slave());
    const std::uint16_t slave_port = pair.port;
    pair.port = free_udp_port();
    relay.emplace(pair.port, slave_port, std::move(each_ms),
                  [this](bool to_slave) { return to_slave ? !cut_to_slave : !cut_to_master; });
    master.emplace(pair.master("master", of_master));
  }
  void end() {
    for (auto* program : {&*master, &*slave}) {
      program->send(SIGINT);
      EXPECT_EQ(program->wait(), exited(0)) << program->err();
    }
    relay->stop();
  }

  Pair pair;
  std::atomic<bool> cut_to_slave{false}, cut_to_master{false};
  std::optional<Process> slave, master;
  std::optional<Relay> relay;
};

/// From t_s on, when the hand rests: the robot stays where it is, and nobody presses.
void expect_at_rest(const Between& run, double from_s, const char* when) {
  const Trace slave = run.pair.trace("slave");
  EXPECT_LT(moved(slave, "slave_x_0", from_s), kStill_m) << when;
  EXPECT_LT(slave.peak("slave_f_0", from_s, 1e9), kNoForce_n) << when;
}

TEST(OldReports, OfAStallMoveNothingWhenTheyArrive) {
  // All that the master says for 3 s waits in the relay, and comes at once.
  std::atomic<bool> waits{false}, drains{false}, drained{false};
  std::size_t next = 0;
  Between run{away(1.0), {}, [&](Relay& r) {
                if (!waits) return void(next = r.from_master.size());
                if (!drains) return;
                for (int i = 0; i < 20 && next < r.from_master.size(); ++i) r.to_slave(r.from_master[next++]);
                drained = next == r.from_master.size();
              }};
  run.pair.await("slave", 1.0);
  run.cut_to_slave = true, waits = true;
  std::this_thread::sleep_for(3s);
  drains = true;
  EXPECT_TRUE(comes_true([&] { return drained.load(); }));
  drains = false, run.cut_to_slave = false;
  std::this_thread::sleep_for(2s);
  run.end();
  expect_at_rest(run, 3.5, "after the stall");
  EXPECT_GT(run.pair.summary("slave").packets().to_slave().stale(), 1000u);
  EXPECT_GE(count(run.slave->err(), "too old to count"), 1) << run.slave->err();
  EXPECT_TRUE(was_in(run.pair.trace("slave"), 1.0, 5.0)) << "coupled again\n" << run.slave->err();
  EXPECT_TRUE(was_in(run.pair.trace("master"), 1.0, 5.0)) << "coupled again\n" << run.master->err();
}

TEST(OldReports, KeptFromBeforeASilenceBeginNoCoupling) {
  std::vector<Datagram> kept;
  std::atomic<bool> keeps{false}, says{false};
  Between run{away(0.05), {}, [&](Relay& r) {
                if (keeps && kept.size() < 5) kept.push_back(r.from_master.back());
                if (says.exchange(false))
                  for (const Datagram& d : kept) r.to_slave(d);
              }};
  run.pair.await("slave", 1.0);
  run.cut_to_slave = run.cut_to_master = true, keeps = true;
  std::this_thread::sleep_for(3s);
  says = true;
  EXPECT_TRUE(comes_true([&] { return !says; }));
  run.cut_to_slave = run.cut_to_master = false;
  std::this_thread::sleep_for(2s);
  run.end();
  EXPECT_EQ(kept.size(), 5u);
  expect_at_rest(run, 3.5, "after the silence");
}

TEST(OldReports, ASlaveThatStoodStillLeavesTheRobotWhereItIs) {
  Between run{away(0.05)};
  run.pair.await("slave", 1.0);
  run.slave->send(SIGSTOP);
  std::this_thread::sleep_for(3s);
  run.slave->send(SIGCONT);
  std::this_thread::sleep_for(2s);
  run.end();
  expect_at_rest(run, 3.5, "after SIGCONT");
  EXPECT_TRUE(was_in(run.pair.trace("slave"), 1.0, 5.0)) << "coupled again\n" << run.slave->err();
}

TEST(OldReports, SaidSlowlyDoNotKeepARobotPressing) {
  // The hand presses; then the relay says one of the master's reports each 80 ms. The master is killed.
  std::atomic<bool> slowly{false};
  std::size_t next = 0;
  int ms = 0;
  Between run{away(0.05), {}, [&](Relay& r) {
                if (!slowly) return void(next = r.from_master.size());
                if (++ms % 80 == 0 && next < r.from_master.size()) r.to_slave(r.from_master[next++]);
              }};
  run.pair.await("slave", 3.0);
  run.cut_to_slave = true, slowly = true;
  std::this_thread::sleep_for(300ms);
  run.master->send(SIGKILL);
  run.master->wait();
  std::this_thread::sleep_for(3s);
  run.slave->send(SIGINT);
  run.slave->wait();
  const Trace slave = run.pair.trace("slave");
  EXPECT_GT(slave.peak("slave_f_0", 2.5, 3.0), 3.0) << "it pressed";
  EXPECT_LT(slave.peak("slave_f_0", 3.0 + 1.7, 1e9), kNoForce_n) << run.slave->err();
}

/// The way to one side is dead from 3 s on, while the hand presses. Both let go within release_after_s, 1 s, and a round trip.
void one_way(bool to_master) {
  Between run{away(0.05)};
  run.pair.await("slave", 3.0);
  (to_master ? run.cut_to_master : run.cut_to_slave) = true;
  std::this_thread::sleep_for(2500ms);
  (to_master ? run.cut_to_master : run.cut_to_slave) = false;
  std::this_thread::sleep_for(1s);
  run.end();
  const Trace slave = run.pair.trace("slave"), master = run.pair.trace("master");
  EXPECT_GT(slave.peak("slave_f_0", 2.5, 3.0), 3.0) << "it pressed";
  EXPECT_GT(master.peak("master_f_0", 2.5, 3.0), 3.0) << "it was felt";
  // await() is late by up to the trace's buffer, 0.3 s.
  EXPECT_LT(slave.peak("slave_f_0", 4.6, 5.2), kNoForce_n) << run.slave->err();
  EXPECT_LT(master.peak("master_f_0", 4.6, 5.2), kNoForce_n) << run.master->err();
  const Process& deaf = to_master ? *run.slave : *run.master;
  EXPECT_GE(count(deaf.err(), "hears nothing of this side"), 1) << deaf.err();
  EXPECT_TRUE(was_in(slave, 1.0, 5.8)) << "coupled again\n" << run.slave->err();
}
TEST(OldReports, ADeadWayToTheMasterEndsTheCouplingAtBothSides) {
  one_way(true);
}
TEST(OldReports, ADeadWayToTheSlaveEndsTheCouplingAtBothSides) {
  one_way(false);
}

TEST(OldReports, AGoodbyeLetsTheRobotGoAtOnce) {
  for (const int signal : {SIGINT, SIGTERM}) {
    Between run{away(0.05)};
    run.pair.await("slave", 3.0);
    run.master->send(signal);
    run.master->wait();
    std::this_thread::sleep_for(500ms);
    run.slave->send(SIGINT);
    run.slave->wait();
    const Trace slave = run.pair.trace("slave");
    const auto &mode = slave["mode"], &f = slave["slave_f_0"];
    EXPECT_GT(slave.peak("slave_f_0", 2.5, 3.0), 3.0) << "it pressed";
    EXPECT_EQ(mode.back(), 3.0) << "released";
    if (kept_time({run.pair.summary("slave")})) {
      const auto held = std::count(mode.begin(), mode.end(), 2.0);
      EXPECT_LE(held, 50) << "ms; without a goodbye 900";
    }
    EXPECT_EQ(f.back(), 0.0);
    EXPECT_GE(count(run.slave->err(), "the master has ended"), 1) << run.slave->err();
  }
}

}  // namespace
}  // namespace twoport::test::old_reports_test
