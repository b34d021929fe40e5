#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "common/base/built_for.h"
#include "common/link/impaired_socket.h"
#include "common/scene/load.h"
#include "common/wire/link_transport.h"
#include "lab/engine/simulation.h"
#include "tests/support/memory_network.h"
#include "tests/support/rows.h"
#include "tests/support/two_sides.h"

// The laboratory carries reports as values through a delay line. Here the same scenes run with all that a live link has:
// nodes, mailboxes, handshake, codec and bytes through sockets in memory. The rows are the same to the bit.
namespace twoport::lab {
namespace {

using test::Rows;

/// Where the scene's network does what it does to the packets.
enum class Impaired { between_the_sockets, in_the_filters };

/// A scene over bytes, in a session that both sides are in from the start.
template <int N>
class OverBytes {
 public:
  OverBytes(const Scene& scene, Impaired where)
      : scene_{scene},
        network_{1, std::max(packets_in_flight(scene.to_slave, scene.master_rate_hz),
                             packets_in_flight(scene.to_master, scene.slave_rate_hz))},
        master_filter_{master_socket_,
                       {.incoming = where == Impaired::in_the_filters ? scene.to_master : ImpairmentOptions{},
                        .seed = scene.seed ^ kToMasterStream,
                        .peer_rate_hz = scene.slave_rate_hz,
                        .peer = kSlave}},
        slave_filter_{slave_socket_,
                      {.incoming = where == Impaired::in_the_filters ? scene.to_slave : ImpairmentOptions{},
                       .seed = scene.seed ^ kToSlaveStream,
                       .peer_rate_hz = scene.master_rate_hz}},
        sides_{scene,
               {master_filter_,
                {.side = Side::master, .peer = kSlave},
                numbers(),
                {kSlave, kMasterSession, kSlaveSession}},
               {slave_filter_, {.side = Side::slave}, numbers(), {kMaster, kSlaveSession, kMasterSession}}},
        registration_{scene.control} {
    if (where == Impaired::in_the_filters) return;
    network_.set_conditions(kSlave, {scene.to_slave}, scene.seed ^ kToSlaveStream);
    network_.set_conditions(kMaster, {scene.to_master}, scene.seed ^ kToMasterStream);
  }

  /// The columns of lab::LinkLoop.
  template <class Visit>
  void run(Visit visit) {
    auto& [master_dt, slave_dt, device, robot, master, slave, master_mail, slave_mail] = sides_;
    const Duration end = to_duration(scene_.duration_s);
    std::int64_t m = 0, s = 0;
    Duration next_m{0}, next_s{0};
    Energy dissipated_by_slave;
    while (next_m < end) {
      if (next_s <= next_m) {
        dissipated_by_slave += registration_.to_master(sides_.slave_tick(next_s).dissipated);
        next_s = tick_time(++s, scene_.slave_rate_hz);
        continue;
      }
      while (switch_times_.due(to_seconds(next_m).si(), master.epoch())) master.switch_to_next();
      const auto out = sides_.master_tick(next_m);
      const Row<N> row = columns<N>(next_m, out, out.dissipated + std::exchange(dissipated_by_slave, {}),
                                    robot.environment_force(), device, robot, master, slave);
      if (!visit(row)) return;
      next_m = tick_time(++m, scene_.master_rate_hz);
    }
  }

  test::TwoSides<N, LinkTransport<N>>& sides() { return sides_; }

 private:
  static SessionNumbers numbers() {
    return [random = std::mt19937_64{3}]() mutable { return random(); };
  }
  static constexpr std::uint64_t kMasterSession = 11, kSlaveSession = 22;
  const Endpoint kMaster = MemoryNetwork::address(1, 1), kSlave = MemoryNetwork::address(2, 2);

  Scene scene_;
  MemoryNetwork network_;
  MemorySocket master_socket_ = network_.open(kMaster, Duration{0}), slave_socket_ = network_.open(kSlave, Duration{0});
  ImpairedSocket master_filter_, slave_filter_;
  test::TwoSides<N, LinkTransport<N>> sides_;
  SwitchTimes switch_times_{scene_.schedule};
  Registration<N> registration_;
};

void expect_same(const PacketCounts& a, const PacketCounts& b) {
  EXPECT_EQ(a.sent, b.sent);
  EXPECT_EQ(a.received, b.received);
  EXPECT_EQ(a.lost, b.lost);
  EXPECT_EQ(a.late, b.late);
  EXPECT_EQ(a.duplicated, b.duplicated);
  EXPECT_EQ(a.rejected, b.rejected);
}

/// `row` without what only the summary uses.
template <int N>
Row<N> without_figures(Row<N> row) {
  row.reference = {};
  row.ahead = {};
  row.coupling_energy_j = 0.0;
  row.touching = row.coupled = row.following = false;
  return row;
}

template <int N>
void expect_same_over_bytes(const Scene& scene) {
  const auto simulation = make_simulation<N>(scene);
  const Rows<N> expected = test::rows(*simulation);
  const LinkUse use = *simulation->link();
  for (const Impaired where : {Impaired::between_the_sockets, Impaired::in_the_filters}) {
    OverBytes<N> bytes{scene, where};
    std::size_t k = 0;
    bytes.run([&](const Row<N>& row) {
      const bool same =
          k < expected.size() && test::same_bits(test::numbers(row), test::numbers(without_figures(expected[k])));
      EXPECT_TRUE(same) << "row " << k << " of " << expected.size() << ", impaired in place "
                        << static_cast<int>(where);
      ++k;
      return same;
    });
    EXPECT_EQ(k, expected.size());
    auto& sides = bytes.sides();
    expect_same(sides.master_mail.counts(), use.master);
    expect_same(sides.slave_mail.counts(), use.slave);
    // Every report went through the handshake, and none was turned away.
    for (const LinkTransport<N>* link : {&sides.master_mail.transport(), &sides.slave_mail.transport()}) {
      EXPECT_EQ(link->counts().rejected.total() + link->counts().handshake + link->counts().overflowed, 0U);
      EXPECT_EQ(link->pairings(), 1U);
    }
  }
}

/// Every scene with a link whose two sides have one clock, as they have here.
std::vector<std::string> scenes() {
  std::vector<std::string> all;
  for (const auto& entry : std::filesystem::recursive_directory_iterator{TWOPORT_SCENES}) {
    if (entry.path().extension() != ".textproto") continue;
    const Scene scene = load_scene(entry.path());
    if (scene.slave_clock.offset_s != 0.0 || scene.slave_clock.drift != 0.0) continue;
    if (scene.control.architecture != Architecture::render && scene.control.architecture != Architecture::uncontrolled)
      all.push_back(std::filesystem::relative(entry.path(), TWOPORT_SCENES).replace_extension().string());
  }
  std::sort(all.begin(), all.end());
  return all;
}

class EveryScene : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(OverBytes, EveryScene, ::testing::ValuesIn(scenes()), [](const auto& instance) {
  std::string name = instance.param;
  std::replace(name.begin(), name.end(), '/', '_');
  return name;
});

TEST_P(EveryScene, RunsTheSameToTheBit) {
  const Scene scene = load_scene(std::string{TWOPORT_SCENES} + "/" + GetParam() + ".textproto");
  for_dof(scene.dof, [&]<int N>() { expect_same_over_bytes<N>(scene); });
}

// All that a network can do at once, two rates, and each architecture: POSITION_POSITION adds words of its own.
TEST(OverBytesAndValues, ARunThroughEverythingRandomIsTheSame) {
  for (const std::string architecture : {"POSITION_FORCE", "POSITION_MEASURED_FORCE", "POSITION_POSITION"})
    for (const std::string dof : {"1", "6"}) {
      const bool six = dof == "6";
      const std::string inertia = six ? " inertia_kg_m2: 1e-3" : "", normal = six ? "[0, 0, 1]" : "-1";
      const Scene scene = parse_scene(
          "dof: " + dof +
              " duration_s: 2 rate_hz: 2000 slave_rate_hz: 1700 seed: 5 operator { path { sine { axis: 0 amplitude_m: "
              "0.03 frequency_hz: 1 duration_s: 2 } } } device { mass_kg: 0.1" +
              inertia + " } control { architecture: " + architecture +
              " passivity { method: FORCE_PROJECTED } } robot { mass_kg: 0.5" + inertia +
              " damping_n_s_per_m: 2 } environment { wall { normal: " + normal +
              " offset_m: -0.01 stiffness_n_per_m: 2000 } } "
              "to_slave { delay_ms: 20 jitter_ms: 6 loss: 0.2 duplicate: 0.1 reorder: 0.1 burst { p: 0.01 r: 0.2 } "
              "blackout { start_s: 0.7 duration_s: 0.3 } } "
              "to_master { delay_ms: 10 jitter_ms: 6 jitter_distribution: PARETO loss: 0.3 duplicate: 0.1 reorder: "
              "0.1 }",
          "random");
      if (six) {
        expect_same_over_bytes<6>(scene);
      } else {
        expect_same_over_bytes<1>(scene);
      }
    }
}

}  // namespace
}  // namespace twoport::lab
