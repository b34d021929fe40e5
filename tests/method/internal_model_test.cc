// What internal-model control claims beyond what every method is asked: least energy through the master port for any
// packets, and contact with walls that are damped, left, curved, felt with a bias, stiffer than the device can show.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "common/method/transparency/surface/payload.h"
#include "common/record/high_pass.h"
#include "common/scene/load.h"
#include "lab/engine/simulation.h"
#include "master/master_node.h"
#include "sim/sim_device.h"

namespace twoport::internal_model_test {
namespace {

// ---- hostile packets

struct Hostile {
  int dof;
  double rate_hz;
  std::string hand;
  int seed;
};

Scene hostile_scene(const Hostile& c) {
  const std::string six_hand =
      c.dof == 6 ? " inertia_kg_m2: 1e-4 rotational_stiffness_n_m_per_rad: 2 rotational_damping_n_m_s_per_rad: 0.02"
                 : "";
  // A violent hand: 3 Hz with 5 cm on one axis, 7 Hz with 1 cm by tremor on all: about 1 m/s.
  return parse_scene("dof: " + std::to_string(c.dof) + " duration_s: 20 rate_hz: " + std::to_string(c.rate_hz) +
                         " seed: " + std::to_string(c.seed) + " operator { hand { " + c.hand + six_hand +
                         " } path { sine { axis: 0 amplitude_m: 0.05 frequency_hz: 3 duration_s: 20 } } " +
                         "tremor { rms_m: 0.004 } } device { mass_kg: 0.1 damping_n_s_per_m: 0.05 max_force_n: 20 " +
                         (c.dof == 6 ? "inertia_kg_m2: 1e-4 " : "") +
                         "} control { passivity { method: INTERNAL_MODEL } } robot { mass_kg: 1 " +
                         (c.dof == 6 ? "inertia_kg_m2: 1e-3 " : "") + "}",
                     "hostile");
}

/// Reports that no robot sends: any force, any surface, a set point that jumps.
template <int N>
class HostileSlave {
 public:
  explicit HostileSlave(int seed) : random_{static_cast<unsigned>(seed)} {}

  /// The newest report, for a handle at `x`; a new one comes after 7 to 400 ticks, sometimes after 1500.
  const PeerState<N>& at(int tick, Duration now, const Position<N>& x) {
    peer_.is_new = tick == next_;
    if (tick != next_) return peer_;
    next_ += uniform(0.0, 1.0) < 0.05 ? 1500 : static_cast<int>(uniform(7.0, 400.0));
    peer_.has_report = true;
    peer_.received_at = peer_.proven_at = now;
    peer_.newest.mode = Mode::coupled;
    peer_.newest.echo_ns = (now - to_duration(uniform(0.0, 1.5))).count();
    peer_.newest.f = Force<N>{vector<N>(uniform(3.0, 20.0))};
    constexpr int D = kAxes<N>;
    SurfaceReport<N> said;
    said.contact.value = uniform(0.0, 1.0) < 0.7 ? 1.0 : 0.0;
    said.normal.value = Direction<D>{vector<D>(1.0)};
    said.point.value = Position<D>{Point<D>{x.translation() + vector<D>(uniform(0.0, 0.03))}};
    said.stiffness.value = std::pow(10.0, uniform(1.0, 4.7));
    said.friction.value = uniform(-0.5, 2.0);
    said.curvature.value = uniform(0.0, 1.0) < 0.5 ? 0.0 : uniform(-300.0, 300.0);
    typename Displacement<N>::Vector jump = Displacement<N>::Vector::Zero();
    jump.template head<D>() = vector<D>(uniform(0.0, 0.05));
    said.echo.value = x + Displacement<N>{jump};
    said.robot.value = Position<D>{Point<D>{x.translation() + vector<D>(uniform(0.0, 0.05))}};
    said.lever.value = Displacement<3>{vector<3>(0.1)};
    write(said, peer_.words);
    return peer_;
  }

 private:
  double uniform(double from, double to) { return std::uniform_real_distribution<>{from, to}(random_); }
  template <int K>
  Eigen::Matrix<double, K, 1> vector(double length) {
    Eigen::Matrix<double, K, 1> v;
    for (int i = 0; i < K; ++i) v[i] = std::normal_distribution<>{}(random_);
    return v * (length / v.norm());
  }

  std::mt19937 random_;
  PeerState<N> peer_;
  int next_ = 0;
};

template <int N>
double least_energy_j(const Hostile& c) {
  const Scene scene = hostile_scene(c);
  const Seconds dt{1.0 / c.rate_hz};
  sim::SimDevice<N> device{scene, dt};
  MasterNode<N> master{scene.control};
  HostileSlave<N> slave{c.seed};
  double least = 0.0, largest = 0.0;
  for (int k = 0; k < static_cast<int>(scene.duration_s * c.rate_hz); ++k) {
    const Duration now = tick_time(k, c.rate_hz);
    if (k > 0) device.advance();
    const auto out =
        master.step(Tick<MasterClock>{Instant<MasterClock>{now}, dt}, device.sense(), slave.at(k, now, device.x()));
    EXPECT_TRUE(all_finite(out.command)) << "tick " << k;
    device.actuate(out.command);
    least = std::min(least, device.port_energy().si());
    largest = std::max(largest, std::sqrt(out.command.squared_norm()));
  }
  // At 100 Hz and below the energy spring's reach leaves little force to a path this wild.
  EXPECT_GT(largest, c.rate_hz <= 100.0 ? 0.02 : 1.0) << "the packets must matter";
  return least;
}

class HostilePackets : public testing::TestWithParam<Hostile> {};

// The bound is -E(0) = -1 mJ where every tick is predicted or moves no more than twice as far as one of the last half second
// (docs/reference/energy-bound.md, steps 5 and 6): 10 µJ for the account of the dampers.
TEST_P(HostilePackets, NeverTakeMoreThanE0FromThePort) {
  const Hostile& c = GetParam();
  const double least = c.dof == 1 ? least_energy_j<1>(c) : c.dof == 3 ? least_energy_j<3>(c) : least_energy_j<6>(c);
  EXPECT_GE(least, -1e-3 - 1e-5);
}

std::vector<Hostile> hostiles() {
  std::vector<Hostile> all;
  for (const int dof : {1, 3, 6})
    for (const double rate_hz : {50.0, 100.0, 1000.0, 4000.0})
      for (const char* hand :
           {"stiffness_n_per_m: 100 damping_n_s_per_m: 0.3", "mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8",
            "mass_kg: 0.05 stiffness_n_per_m: 1500 damping_n_s_per_m: 3"})
        for (const int seed : {1, 2, 3}) all.push_back({dof, rate_hz, hand, seed});
  return all;
}
INSTANTIATE_TEST_SUITE_P(Of, HostilePackets, testing::ValuesIn(hostiles()));

// ---- contacts: approach, press, slide, rest, leave

struct Contact {
  double delay_ms = 50.0;
  std::string surface = "wall { normal: [-1, 0, 0] offset_m: -0.02 stiffness_n_per_m: 5000 }";
  std::string sensor{}, device = "max_force_n: 20", control{}, to_master{};
  double rate_hz = 1000.0;
};

constexpr double kRestFrom_s = 5.0, kRest_s = 6.0;
constexpr double kCoupling_n_per_m = 1000.0;

Scene contact_scene(const Contact& c) {
  const std::string way = "delay_ms: " + std::to_string(c.delay_ms);
  return parse_scene(
      "dof: 3 duration_s: 8.5 rate_hz: " + std::to_string(c.rate_hz) +
          " operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 } path { move_to { position_m: "
          "[0.03, 0, 0] duration_s: 1 } } path { hold { duration_s: 0.5 } } path { move_to { position_m: [0.03, 0.02, "
          "0] "
          "duration_s: 1 } } path { hold { duration_s: 3.5 } } path { move_to { position_m: [0, 0, 0] duration_s: 1 } "
          "} } "
          "device { mass_kg: 0.075 damping_n_s_per_m: 0.05 " +
          c.device + " } control { " + c.control +
          " virtual_coupling { stiffness_n_per_m: 1000 damping_n_s_per_m: 20 } " +
          "passivity { method: INTERNAL_MODEL initial_energy_j: 5e-3 } } robot { mass_kg: 0.5 damping_n_s_per_m: 2 " +
          "force_sensor { " + c.sensor + " } } environment { " + c.surface + " } to_slave { " + way +
          " } to_master { " + way + " " + c.to_master + " }",
      "contact");
}

struct Figures {
  double pressed_n = 0.0, felt_n = 0.0;  ///< mean size at rest
  double error_n = 0.0;                  ///< mean |felt - environment| at rest
  double drift_m = 0.0;                  ///< mean |x_m - x_s - f_e/K_c| at rest: the coupling's stretch does not count
  double direction_deg = 0.0;            ///< rms between felt and delayed environment force while sliding
  double late_n = 0.0;                   ///< largest force felt after robot and hand have left the surface
  double chatter_n = 0.0;                ///< rms at rest about the mean
  double moving_chatter_n = 0.0;         ///< rms above 30 Hz over the whole run
  double contact_error_n = 0.0;          ///< rms felt against delayed environment force in contact
  double least_felt_n = 1e9;             ///< between 2.6 s and kRest_s
  double least_j = 0.0;
  double farthest_m = 0.0;  ///< robot from hand
  double most_pressed_n = 0.0;
};

Figures run(const Contact& c) {
  const Scene scene = contact_scene(c);
  const auto loop = lab::make_simulation<3>(scene);
  Figures out;
  double rests = 0.0, slides = 0.0, direction2 = 0.0, felt2 = 0.0;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  HighPass<3> high_pass{30.0, c.rate_hz};
  double fast2 = 0.0, contact2 = 0.0, ticks = 0.0, contacts = 0.0;
  const double scale = scene.control.force_scale, motion = scene.control.motion_scale;
  loop->run([&](const Row<3>& row) {
    const Eigen::Vector3d felt = row.master_f.vec(), environment = -scale * row.env_f.vec(),
                          delayed = row.reference.vec();
    const Eigen::Vector3d apart = row.master_x.translation() - row.slave_x.translation() / motion;
    out.least_j = std::min(out.least_j, row.master_energy_j);
    out.farthest_m = std::max(out.farthest_m, apart.norm());
    out.most_pressed_n = std::max(out.most_pressed_n, environment.norm());
    if (row.t_s >= kRestFrom_s && row.t_s < kRest_s) {
      ++rests;
      out.pressed_n += environment.norm();
      out.felt_n += felt.norm();
      out.error_n += (felt - environment).norm();
      out.drift_m += (apart - environment / (scale * motion * kCoupling_n_per_m)).norm();
      mean += felt;
      felt2 += felt.squaredNorm();
    }
    ++ticks;
    fast2 += high_pass.step(felt).squaredNorm();
    if (delayed.norm() > 0.05) {
      ++contacts;
      contact2 += (felt - delayed).squaredNorm();
    }
    if (row.t_s >= 2.6 && row.t_s < kRest_s) out.least_felt_n = std::min(out.least_felt_n, felt.norm());
    if (row.t_s >= 1.7 && row.t_s < 2.5 && felt.norm() > 0.3 && delayed.norm() > 0.3) {
      ++slides;
      const double cosine = std::clamp(felt.dot(delayed) / (felt.norm() * delayed.norm()), -1.0, 1.0);
      direction2 += std::pow(std::acos(cosine) * 180.0 / 3.14159265358979, 2);
    }
    if (row.t_s > 7.3 && row.master_x.translation()[0] < 0.01) out.late_n = std::max(out.late_n, felt.norm());
    return true;
  });
  for (double* each : {&out.pressed_n, &out.felt_n, &out.error_n, &out.drift_m}) *each /= rests;
  out.chatter_n = std::sqrt(std::max(0.0, felt2 / rests - (mean / rests).squaredNorm()));
  out.moving_chatter_n = std::sqrt(fast2 / ticks);
  out.contact_error_n = std::sqrt(contact2 / contacts);
  out.direction_deg = slides > 0.0 ? std::sqrt(direction2 / slides) : 180.0;
  return out;
}

std::string wall(const std::string& more) {
  return "wall { normal: [-1, 0, 0] offset_m: -0.02 stiffness_n_per_m: 5000 " + more + " }";
}
constexpr const char* kBall = "sphere { center_m: [0.05, 0.01, 0] radius_m: 0.03 stiffness_n_per_m: 5000 }";

// Figures of the prototype's order: 0.02 N is below what a hand tells apart, 0.5 mm a tenth of the coupling's stretch.
TEST(InternalModel, FeelsAtRestWhatTheRobotPresses) {
  const Figures f = run({});
  EXPECT_GT(f.pressed_n, 2.5);
  EXPECT_LT(f.error_n, 0.02);
  EXPECT_LT(f.drift_m, 0.5e-3);
  EXPECT_LT(f.direction_deg, 2.0);
  EXPECT_LT(f.chatter_n, 0.01);
  EXPECT_GE(f.least_j, -5e-3 - 1e-6);
}

// Half a second of round trip: the hand goes on 10 mm into a wall that it does not feel, and K* of 833 N/m presses 8.4 N. As a
// hand of 700 N/m would yield it is 3.8 N; a quarter more for what the estimate of K* and the low pass of 50 ms leave. At rest nothing is left of it: 2.05 N,
// without the yield 2.09 N, what 5 mJ allow.
TEST(InternalModel, PressesASurfaceThatTheHandDoesNotFeelYetAsAHandWould) {
  const Figures f = run({.delay_ms = 250.0, .surface = wall("")});
  EXPECT_LT(f.most_pressed_n, 4.75);
  EXPECT_NEAR(f.pressed_n, 2.09, 0.1);
  EXPECT_LT(f.error_n, 0.02);
}

// A damped wall: x - f/K alone is no point on it while the robot moves.
TEST(InternalModel, KeepsTheRobotAtTheHandOnAWallWithDamping200) {
  const Figures f = run({.surface = wall("damping_n_s_per_m: 200")});
  EXPECT_GT(f.pressed_n, 2.4);
  EXPECT_LT(f.error_n, 0.02);
  EXPECT_LT(f.drift_m, 1e-3);
  EXPECT_LT(f.farthest_m, 6e-3);
}

TEST(InternalModel, CountsFrictionOnceWhereTheHandSlides) {
  const Figures f = run({.surface = wall("friction: 0.5")});
  EXPECT_GT(f.pressed_n, 2.5);
  EXPECT_LT(f.error_n, 0.1);
  EXPECT_LT(f.direction_deg, 10.0);
}

TEST(InternalModel, FollowsACurvedSurface) {
  const Figures f = run({.surface = kBall});
  EXPECT_GT(f.pressed_n, 1.8);
  EXPECT_LT(f.error_n, 0.02);
  EXPECT_LT(f.direction_deg, 5.0);
}

// Half a second of round trip: the force of a surface that both have left fades within 3 mm.
TEST(InternalModel, LeavesASurfaceWithoutAForceThatStays) {
  const Figures f = run({.delay_ms = 250.0, .surface = kBall});
  EXPECT_LT(f.late_n, 0.05);
}

// A bias of 0.25 N and noise of 0.1 N per axis: free space is told from contact.
TEST(InternalModel, LearnsTheBiasOfTheSensor) {
  const Figures f = run({.sensor = "noise_n: 0.1 bias_n: [0.2, -0.1, 0.1]"});
  EXPECT_LT(f.error_n, 0.05);
  EXPECT_LT(f.late_n, 0.05);
}

TEST(InternalModel, PressesNoHarderThanTheDeviceShows) {
  const Figures f = run({.device = "max_force_n: 2"});
  EXPECT_NEAR(f.felt_n, 2.0, 0.01);
  EXPECT_LT(f.error_n, 0.02);
}

// 0.6 s without reports while pressing: the local model goes on.
TEST(InternalModel, GoesOnThroughAShortSilence) {
  const Figures f = run({.to_master = "blackout { start_s: 4 duration_s: 0.6 }"});
  EXPECT_GT(f.least_felt_n, 2.4);
}

TEST(InternalModel, DoesNotChatterOnAnEncoder) {
  const Figures f =
      run({.device = "max_force_n: 20 position_resolution_m: 30e-6 velocity_estimate: FILTERED", .rate_hz = 4000.0});
  EXPECT_LT(f.moving_chatter_n, 0.06);
  EXPECT_LT(f.error_n, 0.02);
}

// Lengths halved, forces times three: the model's stiffness is s_f s_x K.
TEST(InternalModel, ScalesTheModelWithTheWorlds) {
  const Figures f = run({.surface = "wall { normal: [-1, 0, 0] offset_m: -0.01 stiffness_n_per_m: 5000 }",
                         .control = "force_scale: 3 motion_scale: 0.5"});
  EXPECT_GT(f.pressed_n, 2.5);
  EXPECT_LT(f.error_n, 0.02);
  EXPECT_LT(f.direction_deg, 3.0);
  EXPECT_LT(f.contact_error_n, 0.8);
}

// No sensor: the coupling's force takes its place.
TEST(InternalModel, NeedsNoSensorUnderPositionPosition) {
  const Figures f = run({.sensor = "bias_n: [5, 5, 5]", .control = "architecture: POSITION_POSITION"});
  EXPECT_GT(f.pressed_n, 2.0);
  EXPECT_LT(f.error_n, 0.02);
}

// ---- joints

// Two Pandas whose fingers take a box and lift it, 100 ms there and back. While the fingers alone press, from 3.8 s to 4.4 s, the hand feels
// what they press; after the first 0.5 s of the lift, 2 N of weight and little more; and nothing where the box was, once it is left.
TEST(InternalModel, ShowsWhatFingersHoldAndCarry) {
  Scene scene = load_scene(TWOPORT_SCENES "/leader_follower_gripper.textproto");
  const auto loop = lab::make_simulation<kJointPort>(scene);
  constexpr int kFingers = 7;
  const double scale = scene.control.joint_scale[kFingers];
  double pressed_n = 0.0, error_n = 0.0, carried2 = 0.0, lifted2 = 0.0, free2 = 0.0;
  int holds = 0, lifts = 0, frees = 0;
  loop->run([&](const Row<kJointPort>& row) {
    const auto felt = row.master_f.vec(), pressed = row.env_f.vec();
    const double felt2 = felt.head<kFingers>().squaredNorm();
    if (row.t_s > 3.8 && row.t_s < 4.4) {
      ++holds;
      pressed_n += pressed[kFingers] * scale;
      error_n += std::abs(felt[kFingers] + pressed[kFingers]) * scale;
    } else if (row.t_s > 5.5 && row.t_s < 6.5) {
      ++lifts;
      lifted2 += felt2;
      carried2 += pressed.head<kFingers>().squaredNorm();
    } else if (row.t_s > 12.5) {
      ++frees;
      free2 += felt2;
    }
    return true;
  });
  EXPECT_GT(pressed_n / holds, 5.0);
  EXPECT_LT(error_n, 0.05 * pressed_n);
  EXPECT_GT(lifted2, 0.5 * carried2);
  EXPECT_LT(lifted2, 4.0 * carried2);
  EXPECT_LT(free2 / frees, 0.1 * carried2 / lifts);
}

// ---- six degrees of freedom

// A plate pressed on a wall, turned, and held on its edge: the model's force acts at the contact point, so torque comes with it.
TEST(InternalModel, ShowsTheTorqueOfAPlateOnItsEdge) {
  const Scene scene = parse_scene(
      "dof: 6 duration_s: 6 rate_hz: 2000 operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 "
      "inertia_kg_m2: 1e-4 rotational_stiffness_n_m_per_rad: 5 rotational_damping_n_m_s_per_rad: 0.05 } path { move_to "
      "{ "
      "position_m: [0.03, 0, 0] duration_s: 1 } } path { sine { axis: 5 amplitude_m: 0.2 frequency_hz: 0.5 duration_s: "
      "2.5 "
      "} } } device { mass_kg: 0.3 damping_n_s_per_m: 0.1 max_force_n: 20 inertia_kg_m2: 1e-3 "
      "rotational_damping_n_m_s_per_rad: 1e-3 } control { virtual_coupling { damping_n_s_per_m: 30 "
      "rotational_stiffness_n_m_per_rad: 10 rotational_damping_n_m_s_per_rad: 0.3 } passivity { method: INTERNAL_MODEL "
      "} } "
      "robot { mass_kg: 1 damping_n_s_per_m: 4 inertia_kg_m2: [2e-3, 3e-3, 4e-3] rotational_damping_n_m_s_per_rad: "
      "0.02 } "
      "to_slave { delay_ms: 20 } to_master { delay_ms: 20 } environment { wall { normal: [-1, 0, 0] offset_m: -0.07 "
      "stiffness_n_per_m: 3000 } } tool { contact_point { position_m: [0.05, 0.03, 0.03] } contact_point { position_m: "
      "[0.05, -0.03, 0.03] } contact_point { position_m: [0.05, 0.03, -0.03] } contact_point { position_m: [0.05, "
      "-0.03, "
      "-0.03] } }",
      "plate");
  const auto loop = lab::make_simulation<6>(scene);
  double force_n = 0.0, torque_n_m = 0.0, moving2 = 0.0, pressed_n = 0.0, rests = 0.0, moves = 0.0;
  loop->run([&](const Row<6>& row) {
    const Force<6> error = row.master_f + row.env_f;
    if (row.t_s > 5.0) {
      ++rests;
      pressed_n += row.env_f.vec().head<3>().norm();
      force_n += error.vec().head<3>().norm();
      torque_n_m += error.vec().tail<3>().norm();
    } else if (row.t_s > 1.5 && row.t_s < 3.5) {
      ++moves;
      moving2 += (row.master_f - row.reference).vec().tail<3>().squaredNorm();
    }
    return true;
  });
  EXPECT_GT(pressed_n / rests, 2.0);
  EXPECT_LT(force_n / rests, 0.02);
  EXPECT_LT(torque_n_m / rests, 1e-3);
  EXPECT_LT(std::sqrt(moving2 / moves), 0.06);  // the spring about the axes is a tenth of the coupling's
}

// The two worlds turned against each other: the hand feels the same, turned. 1e-6: rounding, carried through a contact.
TEST(InternalModel, IsTheSameInATurnedWorld) {
  const auto felt = [](const std::string& rotation, const std::string& normal) {
    const Scene scene = contact_scene(
        {.surface = "wall { normal: " + normal + " offset_m: -0.02 stiffness_n_per_m: 5000 friction: 0.2 }",
         .control = rotation});
    const auto loop = lab::make_simulation<3>(scene);
    std::vector<Eigen::Vector3d> all;
    loop->run([&](const Row<3>& row) {
      all.push_back(row.master_f.vec());
      return true;
    });
    return all;
  };
  // A quarter turn about z: the master's x is the robot's y.
  const auto plain = felt("", "[-1, 0, 0]"), turned = felt(
                                                 "registration { rotation: [0.70710678118654752, 0, 0, "
                                                 "0.70710678118654752] }",
                                                 "[0, -1, 0]");
  ASSERT_EQ(plain.size(), turned.size());
  double most = 0.0;
  for (std::size_t k = 0; k < plain.size(); ++k) most = std::max(most, (plain[k] - turned[k]).norm());
  EXPECT_LT(most, 1e-6);
}

// ---- plane or spring in all axes

struct Choice {
  double mean = 0.0, last = 0.0, largest_change = 0.0;
  int turns = 0;  ///< how often the share begins to rise or to fall
};
Choice choice_of(const Scene& scene) {
  const auto loop = lab::make_simulation<6>(scene);
  Choice c;
  double sum = 0.0, touching = 0.0, way = 0.0;
  loop->run([&](const Row<6>& row) {
    const double change = row.figures[layer_figure("contact_spring_share")] - c.last;
    c.largest_change = std::max(c.largest_change, std::abs(change));
    if (change != 0.0 && change * way <= 0.0) ++c.turns;
    if (change != 0.0) way = change;
    c.last = row.figures[layer_figure("contact_spring_share")];
    if (row.touching) sum += c.last, touching += 1.0;
    return true;
  });
  c.mean = sum / touching;
  return c;
}

// 10 % more than T/0.1 s for a tick of rounding.
TEST(ContactModel, GoesToTheSpringForAPegInAHoleAndStays) {
  for (const char* seed : {"seed=101", "seed=102"}) {
    const std::string overrides[] = {seed};
    const Choice c = choice_of(load_scene(TWOPORT_SCENES "/assembly.textproto", overrides));
    EXPECT_GT(c.mean, 0.9);
    EXPECT_EQ(c.last, 1.0);
    EXPECT_LE(c.turns, 3);
    EXPECT_LE(c.largest_change, 1.1 / (0.1 * 2000.0));
  }
}
TEST(ContactModel, KeepsThePlaneOnASmoothWallAtOnePoint) {
  const Scene scene = parse_scene(
      "dof: 6 duration_s: 6 operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 inertia_kg_m2: "
      "1e-4 "
      "rotational_stiffness_n_m_per_rad: 5 rotational_damping_n_m_s_per_rad: 0.05 } path { move_to { position_m: "
      "[0.03, 0, 0] "
      "duration_s: 1 } } path { sine { axis: 1 amplitude_m: 0.02 frequency_hz: 0.5 duration_s: 4 } } } device { "
      "mass_kg: 0.3 "
      "damping_n_s_per_m: 0.1 inertia_kg_m2: 1e-3 rotational_damping_n_m_s_per_rad: 1e-3 } control { architecture: "
      "POSITION_FORCE } robot { mass_kg: 1 damping_n_s_per_m: 4 inertia_kg_m2: [2e-3, 3e-3, 4e-3] "
      "rotational_damping_n_m_s_per_rad: 0.02 force_sensor { } } environment { wall { normal: [-1, 0, 0] offset_m: "
      "-0.02 "
      "stiffness_n_per_m: 3000 } } to_slave { delay_ms: 50 loss: 0.05 } to_master { delay_ms: 50 loss: 0.05 }",
      "wall at one point");
  const Choice c = choice_of(scene);
  EXPECT_LT(c.mean, 0.15);  // at the first touch the plane is not known yet
  EXPECT_EQ(c.last, 0.0);
}

// A plate of 20 cm spends its energy, so the hand feels less than is wanted. At rest the robot presses no more than the hand feels: 5 %
// for what still settles. With an anchor that slips all the same it presses six times as much.
TEST(ContactSpring, PressesWhatTheHandFeelsWhereTheEnergyIsSpent) {
  std::vector<std::string> overrides{"control.passivity.method=INTERNAL_MODEL", "to_slave.delay_ms=50",
                                     "to_master.delay_ms=50"};
  for (int i = 0; const char* corner : {"0.1, 0.1", "-0.1, 0.1", "0.1, -0.1", "-0.1, -0.1"})
    overrides.push_back("tool.contact_point[" + std::to_string(i++) + "].position_m=[0.05, " + corner + "]");
  const Scene scene = load_scene(TWOPORT_SCENES "/six_dof_plate.textproto", overrides);
  const auto loop = lab::make_simulation<6>(scene);
  double felt = 0.0, pressed = 0.0, wanted = 0.0;
  loop->run([&](const Row<6>& row) {
    if (row.t_s < 6.0) return true;
    felt += row.master_f.vec().head<3>().norm(), pressed += row.env_f.vec().head<3>().norm();
    wanted += row.master_f_wanted.vec().head<3>().norm();
    return true;
  });
  EXPECT_GT(wanted, 1.5 * felt);
  EXPECT_NEAR(felt, pressed, 0.05 * pressed);
}

}  // namespace
}  // namespace twoport::internal_model_test
