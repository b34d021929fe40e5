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
#include "lab/engine/loops.h"
#include "lab/engine/simulation.h"
#include "tests/support/memory_network.h"
#include "tests/support/rows.h"
#include "tests/support/two_sides.h"

// The laboratory carries reports as values through a delay line. Here the same scenes run with all that a live link has:
// nodes, mailboxes, handshake, codec and bytes through sockets in memory. The rows are the same to the bit.
namespace twoport::lab::bytes_test {
namespace {

using test::Rows;

/// Where the scene's network does what it does to the packets.
enum class Impaired { between_the_sockets, in_the_filters };

/// A scene's network with sockets in memory, and a session that both sides are in from the start.
template <int N>
class BytesNetwork {
 public:
  using Transport = LinkTransport<N>;
  BytesNetwork(const Scene& scene, Impaired where)
      : network_{1, std::max(packets_in_flight(scene.to_slave, scene.master_rate_hz),
                             packets_in_flight(scene.to_master, scene.slave_rate_hz))},
        master_filter_{master_socket_,
                       {.incoming = where == Impaired::in_the_filters ? scene.to_master : ImpairmentOptions{},
                        .seed = scene.seed ^ kToMasterStream,
                        .peer_rate_hz = scene.slave_rate_hz,
                        .peer = kSlave}},
        slave_filter_{slave_socket_,
                      {.incoming = where == Impaired::in_the_filters ? scene.to_slave : ImpairmentOptions{},
                       .seed = scene.seed ^ kToSlaveStream,
                       .peer_rate_hz = scene.master_rate_hz}} {
    if (where == Impaired::in_the_filters) return;
    network_.set_conditions(kSlave, {scene.to_slave}, scene.seed ^ kToSlaveStream);
    network_.set_conditions(kMaster, {scene.to_master}, scene.seed ^ kToMasterStream);
  }
  Transport master_end() {
    return {master_filter_, {.side = Side::master, .peer = kSlave}, numbers(), {kSlave, kMasterSession, kSlaveSession}};
  }
  Transport slave_end() {
    return {slave_filter_, {.side = Side::slave}, numbers(), {kMaster, kSlaveSession, kMasterSession}};
  }

 private:
  static SessionNumbers numbers() {
    return [random = std::mt19937_64{3}]() mutable { return random(); };
  }
  static constexpr std::uint64_t kMasterSession = 11, kSlaveSession = 22;
  const Endpoint kMaster = MemoryNetwork::address(1, 1), kSlave = MemoryNetwork::address(2, 2);

  MemoryNetwork network_;
  MemorySocket master_socket_ = network_.open(kMaster, Duration{0}), slave_socket_ = network_.open(kSlave, Duration{0});
  ImpairedSocket master_filter_, slave_filter_;
};

/// Calls visit(row) for every row of a scene over bytes, with the columns of lab::LinkLoop, until it returns false.
template <int N, class Visit>
void run_over_bytes(const Scene& scene, test::TwoSides<N, BytesNetwork<N>>& sides, Visit visit) {
  const Registration<N> registration{scene.control};
  Energy dissipated_by_slave;
  TickOrder{scene}.run(
      to_duration(scene.duration_s),
      [&](TickAt at) { dissipated_by_slave += registration.to_master(sides.slave_tick(at.now).dissipated); },
      [&](TickAt at) {
        const auto out = sides.master_tick(at.now);
        return visit(columns<N>(at.now, out, out.dissipated + std::exchange(dissipated_by_slave, {}),
                                sides.robot.environment_force(), sides.device, sides.robot, sides.master, sides.slave));
      });
}

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
  row.object = {};
  row.touching = row.coupled = row.following = false;
  return row;
}

template <int N>
void expect_same_over_bytes(const Scene& scene) {
  const auto simulation = make_simulation<N>(scene);
  const Rows<N> expected = test::rows(*simulation);
  const LinkUse use = *simulation->link();
  for (const Impaired where : {Impaired::between_the_sockets, Impaired::in_the_filters}) {
    test::TwoSides<N, BytesNetwork<N>> sides{scene, scene, where};
    std::size_t k = 0;
    run_over_bytes<N>(scene, sides, [&](const Row<N>& row) {
      const bool same =
          k < expected.size() && test::same_bits(test::numbers(row), test::numbers(without_figures(expected[k])));
      EXPECT_TRUE(same) << "row " << k << " of " << expected.size() << ", impaired in place "
                        << static_cast<int>(where);
      ++k;
      return same;
    });
    EXPECT_EQ(k, expected.size());
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
}  // namespace twoport::lab::bytes_test
