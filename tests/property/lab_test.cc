#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/scene/load.h"
#include "lab/engine/simulation.h"
#include "tests/support/rows.h"
#include "tests/support/two_sides.h"

namespace twoport::lab::lab_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

using test::Rows, test::rows, test::numbers, test::same_bits;

// --- no direction is special ---------------------------------------------------------------------

/// A hand that presses a tilted, sticky wall and slides along it, over a link that delays and loses.
const std::string kSlide = R"(
  dof: 3 duration_s: 2 rate_hz: 2000 seed: 7
  operator {
    hand { mass_kg: 0.02 stiffness_n_per_m: 300 damping_n_s_per_m: 1 }
    path { move_to { position_m: [0.03, 0.01, 0] duration_s: 0.2 } }
    path { move_to { position_m: [0.03, -0.02, 0.02] duration_s: 0.3 } }
    path { move_to { position_m: [0, 0, 0] duration_s: 0.5 } }
  }
  device { mass_kg: 0.075 damping_n_s_per_m: 0.05 max_force_n: 8.5 position_m: [0, 0.001, 0] velocity_m_per_s: [0.01, 0, 0.02] }
  control { virtual_coupling { stiffness_n_per_m: 1000 damping_n_s_per_m: 20 } passivity { method: FORCE_PROJECTED } }
  to_slave { delay_ms: 12 jitter_ms: 2 loss: 0.05 }
  to_master { delay_ms: 15 jitter_ms: 2 loss: 0.05 }
  robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { bias_n: [0, 0, 0] } }
  environment { wall { normal: [-2, 1, 2] offset_m: -0.008 stiffness_n_per_m: 5000 damping_n_s_per_m: 5 friction: 0.3 } }
)";

std::string without_link(const std::string& scene) {
  return scene.substr(0, scene.find("to_slave")) + scene.substr(scene.find("robot"));
}

Numbers turned(const Matrix3d& r, Numbers v) {
  if (v.empty()) return v;
  v.resize(3, 0.0);
  const Vector3d out = r * Vector3d{v[0], v[1], v[2]};
  return {out.x(), out.y(), out.z()};
}
/// Every vector of the scene turned by r.
Scene turned(const Matrix3d& r, Scene s) {
  const auto turn = [&](Numbers& v) { v = turned(r, v); };
  for (SegmentSpec& segment : s.operator_model->path) turn(std::get<MoveToSpec>(segment).position_m);
  turn(s.device->position_m), turn(s.device->velocity_m_per_s);
  turn(s.robot->position_m), turn(s.robot->velocity_m_per_s);
  for (EnvironmentSpec& e : s.environment) {
    Eigen::Vector3d& normal = std::get<Wall>(std::get<Surface>(e).shape).normal;
    normal = r * normal;
  }
  return s;
}

TEST(Rotation, OfEveryVectorOfASceneTurnsTheRun) {
  const Scene scene = parse_scene(kSlide, "slide");
  const Rows<3> straight = rows<3>(scene);
  std::mt19937_64 random{20240611};
  std::normal_distribution<double> normal;
  for (int i = 0; i < 10; ++i) {
    const Eigen::Vector4d q{normal(random), normal(random), normal(random), normal(random)};
    const Matrix3d r = Quaterniond{q.normalized()}.toRotationMatrix();
    const Rows<3> tilted = rows<3>(turned(r, scene));
    ASSERT_EQ(tilted.size(), straight.size());
    double worst = 0.0, reach = 0.0;
    for (std::size_t k = 0; k < straight.size(); ++k) {
      const auto apart = [&](const Position<3>& a, const Position<3>& b) {
        return (r * a.translation() - b.translation()).norm();
      };
      worst = std::max(
          {worst, apart(straight[k].master_x, tilted[k].master_x), apart(straight[k].slave_x, tilted[k].slave_x)});
      reach = std::max(reach, straight[k].master_x.translation().norm());
    }
    // Measured: 1e-14 in the first half second, 1e-12 to the end. The switching of the controllers does not amplify it
    // here.
    EXPECT_LT(worst, 1e-9 * reach) << "rotation " << i;
  }
}

// --- nothing that is on its way is dropped -------------------------------------------------------

TEST(DelayLines, HaveRoomForAllThatIsOnItsWay) {
  struct Case {
    double master_hz, slave_hz, drift;
    std::vector<std::string> set;
  };
  const std::string hundred = "={ delay_ms: 100 }",
                    varied = "={ delay_ms: 100 jitter_ms: 30 duplicate: 0.5 reorder: 0.2 }";
  for (const auto& [master_hz, slave_hz, drift, set] :
       {Case{1000, 1000, 0.0, {"to_slave" + hundred, "to_master" + hundred}},
        Case{1000, 1000, 0.0, {"to_slave" + varied, "to_master" + varied}},
        Case{1000, 1000, 0.02, {"to_slave={ delay_ms: 1000 }", "to_master={ delay_ms: 1000 }"}},
        Case{1000, 50, 0.0, {"to_slave" + hundred, "to_master" + hundred, "slave_rate_hz=50"}},
        Case{50, 1000, 0.0, {"to_slave" + hundred, "to_master" + hundred, "slave_rate_hz=1000"}}}) {
    std::vector<std::string> all = set;
    all.push_back(fmt::format("rate_hz={}", master_hz));
    all.push_back(fmt::format("slave_clock.drift_ppm={}", 1e6 * drift));
    const Scene scene = parse_scene("dof: 1 duration_s: 3 device { mass_kg: 1 } robot { mass_kg: 1 }", "test", all);
    DelayLines<1> lines{scene};
    auto master = mailbox_of<1>(Side::master, scene, lines.master_end());
    auto slave = mailbox_of<1>(Side::slave, scene, lines.slave_end());
    const auto tick = [](auto& mail, Duration now) {
      mail.collect(now);
      mail.post(PortReport<1>{}, now);
      return true;
    };
    TickOrder{scene}.run(
        std::chrono::seconds{3}, [&](TickAt at) { tick(slave, at.now); },
        [&](TickAt at) { return tick(master, at.now); });
    EXPECT_EQ(lines.overflowed(), 0u) << master_hz << " and " << slave_hz << " Hz, drift " << drift;
    EXPECT_GT(slave.counts().received, 0u);
  }
}

// --- a run repeats -------------------------------------------------------------------------------

const std::string kEverythingRandom = R"(
  to_slave { delay_ms: 20 jitter_ms: 6 loss: 0.2 duplicate: 0.1 reorder: 0.1 burst { p: 0.01 r: 0.2 } }
  to_master { delay_ms: 10 jitter_ms: 6 jitter_distribution: PARETO loss: 0.3 duplicate: 0.1 reorder: 0.1 }
)";
const std::string kSixDof = R"(
  dof: 6 duration_s: 1 rate_hz: 2000 slave_rate_hz: 1700
  operator {
    hand { mass_kg: 0.02 stiffness_n_per_m: 300 damping_n_s_per_m: 1 inertia_kg_m2: 2e-5 rotational_stiffness_n_m_per_rad: 0.5
           rotational_damping_n_m_s_per_rad: 1e-3 }
    path { move_to { position_m: [0.02, 0, -0.03, 0.8, 0.2, -0.4, 0.4] duration_s: 0.4 } }
  }
  device { mass_kg: 0.075 inertia_kg_m2: 1e-4 coulomb_friction_n: 0.04 position_resolution_m: 3e-5 velocity_estimate: FILTERED }
  control { virtual_coupling { rotational_stiffness_n_m_per_rad: 1 rotational_damping_n_m_s_per_rad: 0.01 }
            passivity { method: FORCE_PROJECTED } }
  robot { mass_kg: 0.5 inertia_kg_m2: [1e-3, 2e-3, 2.5e-3] force_sensor { noise_n: 0.05 latency_ms: 2 } }
  environment { wall { normal: [0, 0, 1] offset_m: -0.02 stiffness_n_per_m: 3000 damping_n_s_per_m: 5 friction: 0.3 } }
  tool { contact_point { position_m: [0.02, 0, 0] } contact_point { position_m: [-0.02, 0.01, 0] } }
)";
const std::string kOneDof = R"(
  dof: 1 duration_s: 1 rate_hz: 2000
  operator { hand { mass_kg: 0.02 stiffness_n_per_m: 300 damping_n_s_per_m: 1 } path { move_to { position_m: 0.03 duration_s: 0.3 } } }
  device { mass_kg: 0.075 damping_n_s_per_m: 0.05 coulomb_friction_n: 0.04 position_resolution_m: 3e-5 velocity_estimate: BACKWARD_DIFFERENCE }
  control { architecture: POSITION_POSITION passivity { method: CLASSIC } }
  robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { noise_n: 0.05 } }
  environment { wall { normal: -1 offset_m: -0.01 stiffness_n_per_m: 5000 } }
)";

template <int N>
void expect_same_twice(const std::string& text) {
  const Scene scene = parse_scene(text + kEverythingRandom, "twice");
  const auto once = numbers<N>(rows<N>(scene)), again = numbers<N>(rows<N>(scene));
  EXPECT_GT(once.size(), 30'000u);
  EXPECT_TRUE(same_bits(once, again));
  // The comparison sees another seed, and would see one bit.
  EXPECT_FALSE(same_bits(once, numbers<N>(rows<N>(parse_scene(text + kEverythingRandom, "twice", {{"seed=99"}})))));
}
TEST(TwoRuns, AreTheSameToTheBit1Dof) {
  expect_same_twice<1>(kOneDof);
}
TEST(TwoRuns, AreTheSameToTheBit3Dof) {
  expect_same_twice<3>(without_link(kSlide));
}
TEST(TwoRuns, AreTheSameToTheBit6Dof) {
  expect_same_twice<6>(kSixDof);
}

// --- nobody knows more than there is -------------------------------------------------------------

/// What has gone through a port since the start: in and out of the link, each of which only grows.
struct Flow {
  double in_j = 0.0, out_j = 0.0, net_j = 0.0;
  void follow(double net) {
    const double by = net - net_j;
    (by > 0.0 ? in_j : out_j) += std::abs(by);
    net_j = net;
  }
};

/// A network in memory that remembers the most energy that was ever claimed in it.
template <int N>
struct WitnessedTransport {
  typename DelayLines<N>::Transport line;
  double* claimed;
  template <class Visit>
  void poll(Duration now, Visit visit) noexcept {
    line.poll(now, visit);
  }
  void send(const Report<N>& r, Duration now) noexcept {
    *claimed = std::max(*claimed, r.energy_in_j);
    line.send(r, now);
  }
};

template <int N>
struct WitnessedNetwork {
  using Transport = WitnessedTransport<N>;
  explicit WitnessedNetwork(const Scene& scene) : lines{scene} {}
  Transport master_end() { return {lines.master_end(), &claimed_by_master}; }
  Transport slave_end() { return {lines.slave_end(), &claimed_by_slave}; }
  DelayLines<N> lines;
  double claimed_by_master = 0.0, claimed_by_slave = 0.0;
};

/// Both sides of a link of equal rates, and what is said and known between them.
template <int N>
class Witness {
 public:
  explicit Witness(const Scene& scene) : scene_{scene}, sides_{scene} {}

  /// Calls visit() after each tick of both.
  template <class Visit>
  void run(Visit visit) {
    const Duration end = to_duration(scene_.duration_s);
    std::int64_t k = 0;
    for (Duration now{0}; now < end; now = tick_time(++k, scene_.rate_hz)) {
      // What a side may know at this tick was said before it.
      said_by_master = sides_.network.claimed_by_master, said_by_slave = sides_.network.claimed_by_slave;
      sides_.slave_tick(now);
      sides_.master_tick(now);
      known_at_slave = sides_.slave_mail.collect(now).energy_in_j;
      known_at_master = sides_.master_mail.collect(now).energy_in_j;
      // The master's port as the world has it; the slave's as it has booked it, the coming tick included.
      hand.follow(sides_.device.port_energy().si());
      coupling.follow(-sides_.slave.delivered().si());
      visit();
    }
  }

  /// What the master has kept of the energy that the hand put in, to cancel a deficit [J].
  [[nodiscard]] double kept_by_master() const { return hand.in_j - sides_.network.claimed_by_master; }
  double said_by_master = 0.0, said_by_slave = 0.0, known_at_slave = 0.0, known_at_master = 0.0;
  Flow hand, coupling;

 private:
  Scene scene_;
  test::TwoSides<N, WitnessedNetwork<N>> sides_;
};

TEST(WhatASideKnows, NeverExceedsWhatTheOtherHasSent) {
  double most_at_master = 0.0;
  for (const char* link : {"delay_ms: 0", "delay_ms: 0.5", "delay_ms: 20 loss: 0.4", "delay_ms: 10 jitter_ms: 20",
                           "delay_ms: 5 jitter_ms: 3 jitter_distribution: PARETO duplicate: 0.4",
                           "delay_ms: 5 reorder: 0.3 reorder_ms: 20", "delay_ms: 5 burst { p: 0.02 r: 0.05 }",
                           "delay_ms: 15 jitter_ms: 10 loss: 0.3 duplicate: 0.3 reorder: 0.3 blackout { start_s: 0.3 "
                           "duration_s: 0.08 }"}) {
    Witness<3> w{
        parse_scene(without_link(kSlide) + " to_slave { " + link + " } to_master { " + link + " }", "witnessed")};
    double at_master = 0.0, at_slave = 0.0;
    int learnt = 0, invented = 0, forgotten = 0;
    w.run([&] {
      invented += w.known_at_slave > w.said_by_master || w.known_at_master > w.said_by_slave;
      forgotten += w.known_at_slave < at_slave || w.known_at_master < at_master;
      learnt += w.known_at_slave > at_slave;
      at_slave = w.known_at_slave, at_master = w.known_at_master;
    });
    EXPECT_EQ(invented, 0) << "ticks with " << link;
    EXPECT_EQ(forgotten, 0) << "ticks with " << link;
    EXPECT_GT(learnt, 100) << link;
    EXPECT_GT(at_slave, 1e-3) << link;
    most_at_master = std::max(most_at_master, at_master);
  }
  EXPECT_GT(most_at_master, 1e-3);
}

// --- the channel is passive ----------------------------------------------------------------------

/// A scene of its number: everything that may matter to the channel is drawn.
std::string random_scene(int number) {
  std::mt19937_64 random{static_cast<std::uint64_t>(1000 + number)};
  const auto uniform = [&](double from, double to) { return std::uniform_real_distribution<double>{from, to}(random); };
  const auto log_uniform = [&](double from, double to) { return std::exp(uniform(std::log(from), std::log(to))); };
  const auto field = [](const char* name, double value) {
    return std::string{name} + ": " + std::to_string(value) + " ";
  };
  const auto point = [&](double size) {
    return "[" + std::to_string(uniform(-size, size)) + ", " + std::to_string(uniform(-size, size)) + ", " +
           std::to_string(uniform(-size, size)) + "] ";
  };
  const auto link = [&] {
    return field("delay_ms", uniform(0, 100)) + field("jitter_ms", uniform(0, 1) < 0.5 ? 0.0 : uniform(0, 20)) +
           field("loss", uniform(0, 0.5));
  };
  return "dof: 3 duration_s: 2 rate_hz: 2000 seed: " + std::to_string(number) + " operator { hand { " +
         field("mass_kg", log_uniform(0.005, 0.1)) + field("stiffness_n_per_m", log_uniform(50, 800)) +
         field("damping_n_s_per_m", log_uniform(0.3, 5)) + "} path { move_to { position_m: " + point(0.05) +
         field("duration_s", uniform(0.2, 0.6)) + "} } path { sine { axis: 1 " +
         field("amplitude_m", uniform(0.005, 0.04)) + field("frequency_hz", uniform(0.5, 3)) +
         "duration_s: 0.8 } } } device { " + field("mass_kg", log_uniform(0.05, 0.3)) +
         field("damping_n_s_per_m", uniform(0, 0.5)) + "} control { virtual_coupling { " +
         field("stiffness_n_per_m", log_uniform(100, 3000)) + field("damping_n_s_per_m", log_uniform(2, 40)) +
         "} passivity { method: FORCE_PROJECTED } } to_slave { " + link() + "} to_master { " + link() + "} robot { " +
         field("mass_kg", log_uniform(0.2, 2)) + field("damping_n_s_per_m", uniform(0, 5)) +
         "} environment { wall { normal: " + point(1) + field("offset_m", uniform(-0.02, 0)) +
         field("stiffness_n_per_m", log_uniform(300, 10000)) + field("damping_n_s_per_m", uniform(0, 20)) +
         field("friction", uniform(0, 1) < 0.5 ? 0.0 : uniform(0, 0.5)) + "} }";
}

class RandomScene : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Of, RandomScene, ::testing::Range(0, 30));

TEST_P(RandomScene, GivesNoMoreThanItTook) {
  const Scene scene = parse_scene(random_scene(GetParam()), "random");
  const double granted = scene.control.initial_energy.si();
  Witness<3> w{scene};
  double to_robot = granted, to_hand = granted, together = 2 * granted;
  w.run([&] {
    const double robot = granted + w.hand.in_j - w.coupling.out_j,
                 hand = granted + w.coupling.in_j + w.kept_by_master() - w.hand.out_j;
    to_robot = std::min(to_robot, robot);
    to_hand = std::min(to_hand, hand);
    together = std::min(together, robot + granted + w.coupling.in_j - w.hand.out_j);
  });
  // The slave decides on force and velocity of the coming tick together, so its port is exact: 5e-16 J.
  EXPECT_GE(to_robot, -1e-12) << random_scene(GetParam());
  // The master predicts how the hand will move. What goes out beyond the account in one tick is at most
  // |f| max(0, |e| - error_bound) T, with e the error of that tick: a jerk of the hand that no tick before has shown. In 400
  // such scenes 2.3e-5 J was undissipated at most, more than 5e-6 J in 25.
  EXPECT_GE(to_hand, -5e-5) << random_scene(GetParam());
  EXPECT_GE(together, -5e-5) << random_scene(GetParam());
}

TEST_P(RandomScene, NeverGivesTheHandMoreThanItPutIn) {
  const auto simulation = make_simulation<3>(parse_scene(random_scene(GetParam()), "random"));
  double least = 0.0;
  simulation->run([&](const Row<3>& row) {
    least = std::min(least, row.master_energy_j);
    return true;
  });
  EXPECT_GE(simulation->initial_energy().si() + least, -1e-4) << random_scene(GetParam());
}

// --- a held press ----------------------------------------------------------------------------------

/// A hand of so many times the device's mass presses a wall for a minute; delays are one way.
std::string held_press(double delay_ms, double hand_per_device) {
  return fmt::format(
      "dof: 1 duration_s: 62 rate_hz: 2000 operator {{ hand {{ mass_kg: {} stiffness_n_per_m: 300 damping_n_s_per_m: 4 "
      "}} "
      "path {{ move_to {{ position_m: 0.03 duration_s: 1 }} }} path {{ hold {{ duration_s: 61 }} }} }} "
      "device {{ mass_kg: 0.1 damping_n_s_per_m: 0.05 max_force_n: 8.5 }} control {{ architecture: POSITION_FORCE "
      "virtual_coupling {{ stiffness_n_per_m: 1000 damping_n_s_per_m: 20 }} passivity {{ method: FORCE_PROJECTED }} }} "
      "to_slave {{ delay_ms: {} }} to_master {{ delay_ms: {} }} robot {{ mass_kg: 0.5 damping_n_s_per_m: 2 }} "
      "environment {{ wall {{ normal: -1 offset_m: -0.015 stiffness_n_per_m: 5000 }} }}",
      std::max(1e-6, 0.1 * hand_per_device), delay_ms, delay_ms);
}

struct Press {
  double delay_ms, hand_per_device;
  double kept;  ///< least part of the force that is left after a minute
};
class HeldPress : public ::testing::TestWithParam<Press> {};
INSTANTIATE_TEST_SUITE_P(Of, HeldPress,
                         ::testing::Values(Press{5, 0, 0.95}, Press{5, 0.5, 0.95}, Press{5, 1, 0.95}, Press{5, 2, 0.95},
                                           Press{5, 5, 0.95}, Press{10, 0, 0.93}, Press{10, 0.5, 0.95},
                                           Press{10, 1, 0.90}, Press{10, 2, 0.88},
                                           // A heavy hand: the prediction errs, and its bound takes force away.
                                           Press{10, 5, 0.4}));

// At rest no energy flows: nothing entitles a controller to take force away. It did as long as a deficit was never
// cancelled: max_gain then damped the hand for good, and the force fell by 2 % a second.
TEST_P(HeldPress, KeepsItsForceForAMinute) {
  const auto [delay_ms, hand_per_device, kept] = GetParam();
  double after_two_s = 0.0, last = 0.0, deficit = 0.0;
  make_simulation<1>(parse_scene(held_press(delay_ms, hand_per_device), "held press"))->run([&](const Row<1>& row) {
    if (row.t_s < 2.0) after_two_s = row.master_f[0];
    last = row.master_f[0];
    deficit = std::max(deficit, row.undissipated_j);
    return true;
  });
  EXPECT_GT(after_two_s, 2.5);
  EXPECT_GE(last, kept * after_two_s);
  EXPECT_LE(deficit, 1e-4);
}

// --- reference energy over a link ----------------------------------------------------------------

/// Speed of the handle in the last second, rms [m/s]; for twelve seeds, from small to large.
std::vector<double> unrest(std::vector<std::string> set) {
  std::vector<double> all;
  set.emplace_back("control.passivity.method=FORCE_PROJECTED");
  set.emplace_back("control.passivity.initial_energy_j=1e-3");
  set.emplace_back("seed=0");
  for (int seed = 1; seed <= 12; ++seed) {
    set.back() = "seed=" + std::to_string(seed);
    const Scene scene = load_scene(TWOPORT_SCENES "/demo.textproto", set);
    double sum = 0.0;
    int ticks = 0;
    make_simulation<3>(scene)->run([&](const Row<3>& row) {
      if (row.t_s >= scene.duration_s - 1.0) sum += row.master_v.squared_norm(), ++ticks;
      return true;
    });
    all.push_back(std::sqrt(sum / ticks));
  }
  std::sort(all.begin(), all.end());
  return all;
}

// What the coupling's damper dissipated while the hand slid pays for what the late damper creates at rest: passive, and for
// most seeds it swings on for minutes. With the reference energy nothing is saved up, and no seed swings.
TEST(ReferenceEnergy, EndsASwingThatLivesOnWhatWasDissipatedBefore) {
  EXPECT_GT(unrest({"duration_s=16"})[6], 3e-3);
  EXPECT_LT(unrest({"duration_s=16", "control.passivity.reference_energy=true"}).back(), 1e-4);
}

TEST_P(RandomScene, GivesNoMoreThanItTookUnderReferenceEnergyEither) {
  const std::vector<std::string> set{"control.passivity.reference_energy=true"};
  const Scene scene = parse_scene(random_scene(GetParam()), "random", set);
  const double granted = scene.control.initial_energy.si();
  Witness<3> w{scene};
  double to_robot = granted, to_hand = granted;
  w.run([&] {
    to_robot = std::min(to_robot, granted + w.hand.in_j - w.coupling.out_j);
    to_hand = std::min(to_hand, granted + w.coupling.in_j + w.kept_by_master() - w.hand.out_j);
    ASSERT_LE(w.said_by_slave, w.coupling.in_j + 1e-12);
  });
  EXPECT_GE(to_robot, -1e-12);
  EXPECT_GE(to_hand, -5e-5);
}

// --- what an observer sees -----------------------------------------------------------------------

std::string rendering(int dof, const std::string& control, const std::string& device) {
  const std::string hand = "operator { hand { mass_kg: 0.01 stiffness_n_per_m: 300 damping_n_s_per_m: 0.5 ";
  if (dof == 1)
    return "dof: 1 duration_s: 2 rate_hz: 2000 " + hand +
           "} path { move_to { position_m: -0.006 duration_s: 0.3 } } path { sine { "
           "amplitude_m: 0.008 frequency_hz: 2 duration_s: 1 } } } device { mass_kg: 0.075 damping_n_s_per_m: 0.02 "
           "position_m: 0.01 " +
           device + "} control { architecture: RENDER " + control +
           "} environment { wall { normal: 1 stiffness_n_per_m: 5000 } }";
  if (dof == 3)
    return "dof: 3 duration_s: 2 rate_hz: 2000 " + hand +
           "} path { move_to { position_m: [0.054, 0, 0] duration_s: 0.3 } } path { sine { axis: "
           "1 amplitude_m: 0.03 frequency_hz: 1 duration_s: 1 } } } device { mass_kg: 0.075 damping_n_s_per_m: 0.02 "
           "position_m: [0.07, 0, 0] " +
           device + "} control { architecture: RENDER " + control +
           "} environment { cylinder { axis: [0, 0, 1] radius_m: 0.06 stiffness_n_per_m: 5000 friction: 0.2 } }";
  return "dof: 6 duration_s: 2 rate_hz: 2000 " + hand +
         "inertia_kg_m2: 2e-5 rotational_stiffness_n_m_per_rad: 0.5 rotational_damping_n_m_s_per_rad: 1e-3 } path { "
         "move_to { position_m: "
         "[0, 0, -0.006, 0.98, 0.1, 0.1, 0.14] duration_s: 0.3 } } path { sine { axis: 4 amplitude_m: 0.3 "
         "frequency_hz: 2 duration_s: 1 } } } "
         "device { mass_kg: 0.075 inertia_kg_m2: 1e-4 damping_n_s_per_m: 0.02 position_m: [0, 0, 0.01] " +
         device + "} control { architecture: RENDER " + control +
         "} environment { wall { normal: [0, 0, 1] stiffness_n_per_m: 3000 friction: 0.2 } } tool { contact_point { "
         "position_m: [0.03, 0, "
         "0] } contact_point { position_m: [-0.02, 0.02, 0] } contact_point { position_m: [0, -0.03, 0.01] } }";
}

template <int N>
void expect_exact(const std::string& control, const std::string& device) {
  double most = 0.0;
  for (const Row<N>& row : rows<N>(parse_scene(rendering(N, control, device), "rendering"))) {
    // The classic correction of a wrench can run away, and no observer sees more than half a turn between two ticks.
    if (N == 6 && row.master_v.vec().template tail<(N == 6 ? 3 : 1)>().norm() > 0.9 * 3.14 * 2000.0) break;
    most = std::max(most, std::abs(row.master_energy_j));
    ASSERT_NEAR(row.observed_energy_j, row.master_energy_j, 1e-12 * std::max(1.0, most))
        << row.t_s << " s, " << control << device;
  }
  EXPECT_GT(most, 1e-3);
}
TEST(ExactObserver, SeesTheTrueEnergyThroughAnIdealEncoder) {
  for (const char* control :
       {"passivity { method: NONE }", "passivity { method: FORCE_PROJECTED }", "passivity { method: CLASSIC }",
        "passivity { method: FORCE_PROJECTED reference_energy: true }",
        "passivity { method: FORCE_PROJECTED accounts: PER_CONTACT }"})
    for (const char* device : {"", "max_force_n: 3 ", "velocity_estimate: BACKWARD_DIFFERENCE "}) {
      // With accounts apart a limited force is booked part by part in proportion: the sum is the limited force again.
      expect_exact<1>(control, device);
      expect_exact<3>(control, device);
      expect_exact<6>(control, std::string{device} == "velocity_estimate: BACKWARD_DIFFERENCE " ? "" : device);
    }
}

/// Largest error of the observer behind an encoder of resolution q, and how near it comes to its bound
///
///     |E_obs - E_true| <= Σ_axes (q/2) (|f_0| + |f_n| + Σ |Δf|)
template <int N>
std::pair<double, double> expect_bounded(double q, const std::string& control) {
  const std::string device =
      "position_resolution_m: " + std::to_string(q) + " coulomb_friction_n: 0.04 velocity_estimate: FILTERED ";
  double worst = 0.0, share = 0.0, swing = 0.0, excess = 0.0;
  Eigen::Matrix<double, N, 1> first = Eigen::Matrix<double, N, 1>::Zero(), last = first;
  bool started = false;
  for (const Row<N>& row : rows<N>(parse_scene(rendering(N, control, device), "encoder"))) {
    const double error = std::abs(row.observed_energy_j - row.master_energy_j);
    const double bound = 0.5 * q * (first.cwiseAbs().sum() + last.cwiseAbs().sum() + swing);
    excess = std::max(excess, error - bound);
    worst = std::max(worst, error);
    if (bound > 0.0) share = std::max(share, error / bound);
    const Eigen::Matrix<double, N, 1> f = row.master_f.vec();
    if (started) {
      swing += (f - last).cwiseAbs().sum();
    } else {
      first = f;
    }
    last = f;
    started = true;
  }
  EXPECT_LT(excess, 1e-12) << control;
  return {worst, share};
}
TEST(ExactObserver, ThroughAnEncoderErrsByNoMoreThanHalfACountPerSwingOfForce) {
  for (const char* control : {"passivity { method: NONE }", "passivity { method: FORCE_PROJECTED }",
                              "passivity { method: FORCE_PROJECTED reference_energy: true }"})
    for (const double q : {3e-5, 2e-4}) {
      const auto [one, share_of_one] = expect_bounded<1>(q, control);
      const auto [three, share_of_three] = expect_bounded<3>(q, control);
      EXPECT_GT(one, 1e-6);  // it does err
      EXPECT_GT(three, 1e-6);
      EXPECT_GT(std::max(share_of_one, share_of_three), 0.1);  // and the bound is not idle
    }
}

}  // namespace
}  // namespace twoport::lab::lab_test
