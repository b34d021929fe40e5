#include "common/record/metrics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "tests/support/known_numbers.h"

namespace twoport::metrics_test {
namespace {

constexpr double kRate = 2000.0;
constexpr double kRounding = 1e-12;  // of sums of some 1e5 terms of order 1, relative

/// What the rows of one part of a run have in common.
template <int N>
struct Part {
  double seconds;
  Row<N> row;
};

/// Rows of one part after the other, as a summary sees them.
template <int N>
Summary summary_of(const std::vector<Part<N>>& parts, KnownParts known = {}, double energy_scale = 1.0) {
  double duration = 0.0;
  for (const auto& part : parts) duration += part.seconds;
  Metrics<N> metrics{
      {.rate_hz = kRate, .duration_s = duration, .quiet_from_s = 0.0, .initial_energy_j = 1e-3}, energy_scale, known};
  std::int64_t k = 0;
  for (auto part : parts)
    for (int i = 0; i < static_cast<int>(part.seconds * kRate); ++i) {
      part.row.t_s = static_cast<double>(k++) / kRate;
      metrics.add(part.row);
    }
  Summary s;
  metrics.fill(s);
  return s;
}

Force<1> newtons(double f) {
  return Force<1>{Force<1>::Vector{f}};
}
/// The robot takes `environment`, the hand should feel `reference` and feels `felt`.
Row<1> contact(double felt, double reference, double environment) {
  return {.master_f = newtons(felt),
          .master_f_wanted = newtons(reference),
          .env_f = newtons(-environment),
          .reference = newtons(reference),
          .touching = true,
          .coupled = true,
          .following = true};
}
/// Nothing touches; `felt` is drag.
Row<1> free_space(double felt) {
  return {.master_f = newtons(felt), .master_f_wanted = newtons(felt), .coupled = true, .following = true};
}

TEST(ContactFigures, OfAHeldPressAreItsForces) {
  const Summary s = summary_of<1>({{2.0, contact(2.4, 3.0, 6.0)}});
  EXPECT_NEAR(s.felt_force_error_rms_n(), 0.6, kRounding);
  EXPECT_NEAR(s.held_force_ratio(), 0.8, kRounding);
  EXPECT_NEAR(s.environment_force_mean_n(), 6.0, 6.0 * kRounding);
  EXPECT_EQ(s.touching_share(), 1.0);
  EXPECT_EQ(s.contact_s(), 2.0);
  EXPECT_EQ(s.muted_share(), 0.0);
  EXPECT_FALSE(s.has_free_force_rms_n());
}

TEST(ContactFigures, AreNotImprovedByFreeSpaceOrByTime) {
  const Summary alone = summary_of<1>({{1.0, contact(2.4, 3.0, 6.0)}});
  const Summary among =
      summary_of<1>({{30.0, free_space(0.1)}, {1.0, contact(2.4, 3.0, 6.0)}, {60.0, free_space(0.3)}});
  const Summary longer = summary_of<1>({{100.0, contact(2.4, 3.0, 6.0)}});
  for (const Summary& s : {among, longer}) {
    EXPECT_NEAR(s.felt_force_error_rms_n(), alone.felt_force_error_rms_n(), kRounding);
    EXPECT_NEAR(s.environment_force_mean_n(), alone.environment_force_mean_n(), 6.0 * kRounding);
    EXPECT_NEAR(s.held_force_ratio(), alone.held_force_ratio(), kRounding);
    EXPECT_EQ(s.muted_share(), alone.muted_share());
  }
  EXPECT_NEAR(among.touching_share(), 1.0 / 91.0, kRounding);
  EXPECT_NEAR(among.free_force_rms_n(), std::sqrt((30.0 * 0.01 + 60.0 * 0.09) / 90.0), kRounding);
}

TEST(ContactFigures, CountAsMutedWhatIsLessThanATenthOfALoudForce) {
  const Summary s = summary_of<1>({{1.0, contact(0.099, 1.0, 1.0)},   // muted
                                   {1.0, contact(0.101, 1.0, 1.0)},   // felt
                                   {1.0, contact(-0.5, 1.0, 1.0)},    // wrong, not muted
                                   {1.0, contact(0.0, 0.21, 1.0)},    // muted
                                   {5.0, contact(0.0, 0.19, 9.0)}});  // too small, as scaled, to count
  EXPECT_NEAR(s.muted_share(), 0.5, kRounding);
  EXPECT_FALSE(summary_of<1>({{1.0, contact(0.0, 0.19, 9.0)}}).has_muted_share());
}

/// A hand that rests after a second; both sides are coupled for `coupled_s`, then this side is in `mode` to the end of 3 s.
Summary ends_apart(double coupled_s, Mode mode, bool peer_coupled) {
  Metrics<1> metrics{{.rate_hz = kRate, .duration_s = 3.0, .quiet_from_s = 1.0, .link = true}};
  for (int k = 0; k < static_cast<int>(3.0 * kRate); ++k) {
    Row<1> row;
    row.t_s = k / kRate;
    const bool coupled = row.t_s < coupled_s;
    row.master_v = Velocity<1>{Velocity<1>::Vector{std::exp(-5.0 * row.t_s)}};
    row.mode = coupled ? Mode::coupled : mode;
    row.following = coupled || peer_coupled;
    row.coupled = coupled;
    metrics.add(row);
  }
  Summary s;
  metrics.fill(s);
  return s;
}

TEST(Metrics, JudgeOnlyWhatWasCoupled) {
  EXPECT_EQ(ends_apart(3.0, Mode::coupled, true).verdict_kind(), "STABLE");
  for (const double coupled_s : {0.5, 1.5, 2.8}) {
    const Summary silent = ends_apart(coupled_s, Mode::holding, true);
    EXPECT_EQ(silent.verdict_kind(), "UNDECIDED") << coupled_s;
    EXPECT_FALSE(silent.coupled_at_end()) << coupled_s;
  }
  EXPECT_EQ(ends_apart(1.5, Mode::coupled, false).verdict(),
            "undecided: the two sides were not coupled in the last 1.50 s, which are not judged");
  // A side that releases by itself, at whatever time.
  const Summary failed = ends_apart(2.98, Mode::released, true);
  EXPECT_EQ(failed.verdict(), "undecided: a plug-in or a reading failed at 2.98 s, after which there was no force");
  EXPECT_FALSE(failed.coupled_at_end());
  // A few ticks of silence at the end, or a handle that was let go, leave the rest what it is.
  EXPECT_EQ(ends_apart(2.95, Mode::holding, true).verdict_kind(), "STABLE");
  EXPECT_EQ(ends_apart(1.5, Mode::let_go, false).verdict_kind(), "STABLE");
  EXPECT_TRUE(ends_apart(1.5, Mode::let_go, false).coupled_at_end());
}

TEST(ContactFigures, TakeTheRatioAtTheEndOfTheLastRest) {
  Row<1> rests = contact(2.0, 4.0, 4.0), later = contact(3.0, 4.0, 4.0);
  later.master_x = Position<1>{Position<1>::Vector{0.01}};
  const Summary two_rests = summary_of<1>({{0.5, rests}, {0.5, later}, {0.5, free_space(0.0)}});
  EXPECT_NEAR(two_rests.held_force_ratio(), 0.75, kRounding);

  // A hand or a robot that moves by 0.15 mm in 50 ms does not rest.
  for (Position<1> Row<1>::*moves : {&Row<1>::master_x, &Row<1>::slave_x}) {
    Metrics<1> metrics{{.rate_hz = kRate, .duration_s = 1.0, .quiet_from_s = 0.0}};
    for (int k = 0; k < 2000; ++k) {
      Row<1> row = rests;
      row.*moves = Position<1>{Position<1>::Vector{3e-3 * k / kRate}};
      metrics.add(row);
    }
    Summary s;
    metrics.fill(s);
    EXPECT_FALSE(s.has_held_force_ratio());
  }
}

TEST(ContactFigures, TakeTheHeldRatioBeforeTheIntendedMotionGoesOn) {
  // The hand holds for a second; then the force falls off at once, long before the hand has moved visibly.
  const Row<1> held = contact(2.0, 4.0, 4.0), fading = contact(0.001, 4.0, 4.0);
  const std::vector<Part<1>> run{{1.0, held}, {0.3, fading}, {0.7, free_space(0.0)}};
  EXPECT_NEAR(summary_of<1>(run, {.rests = {{{0.0, 1.0}, {1.5, 2.0}}}}).held_force_ratio(), 0.5, kRounding);
  // A rest without contact, one that is shorter than the window, and one with little force do not replace it.
  const std::vector<Part<1>> more{{1.0, held}, {0.5, fading}, {0.09, fading}, {0.5, contact(0.1, 0.1, 0.1)}};
  EXPECT_NEAR(summary_of<1>(more, {.rests = {{{0.0, 1.0}, {1.5, 1.59}, {1.6, 3.0}}}}).held_force_ratio(), 0.5,
              kRounding);
  // Nor is there one without a rest.
  EXPECT_FALSE(summary_of<1>(run, {.rests = {std::vector<Rest>{}}}).has_held_force_ratio());
}

TEST(ContactFigures, TakeTheHeldRatioBeforeContactIsLost) {
  const std::vector<Part<1>> run{{1.0, contact(1.0, 4.0, 4.0)}, {0.1, contact(3.0, 4.0, 4.0)}, {1.0, free_space(0.0)}};
  EXPECT_NEAR(summary_of<1>(run, {.rests = {{{0.0, 9.0}}}}).held_force_ratio(), 0.75, kRounding);
}

TEST(ContactFigures, AverageTheHeldForceOverEveryTickOfATenthOfASecond) {
  // A force that alternates from tick to tick, 2.5 N and 0.5 N, on a slow slope; 1.5 N on average, 0.1 N of which is slope.
  Metrics<1> metrics{{.rate_hz = kRate, .duration_s = 1.0, .quiet_from_s = 0.0}, 1.0, {.rests = {{{0.0, 9.0}}}}};
  for (int k = 0; k < 2000; ++k) {
    Row<1> row = contact((k % 2 == 0 ? 2.5 : 0.5) + 2.0 * (k - 1999) / kRate, 3.0, 3.0);
    row.t_s = k / kRate;
    metrics.add(row);
  }
  Summary s;
  metrics.fill(s);
  EXPECT_NEAR(s.held_force_ratio(), (1.5 - 2.0 * 0.5 * 199 / kRate) / 3.0, kRounding);  // of 200 ticks
}

TEST(Rests, AreHoldsAndTheEndOfThePathOneRoundTripLater) {
  Scene scene;
  EXPECT_FALSE(rests(scene));
  scene.operator_model.emplace();
  constexpr double kForever = std::numeric_limits<double>::infinity();
  const auto of = [&] {
    std::vector<std::pair<double, double>> all;
    const std::optional<std::vector<Rest>> found = rests(scene);
    for (const Rest& rest : found.value()) all.emplace_back(rest.from_s, rest.to_s);
    return all;
  };
  using Intervals = std::vector<std::pair<double, double>>;
  EXPECT_EQ(of(), (Intervals{{0.0, kForever}}));
  scene.to_slave.delay_s = 0.25;
  scene.to_master.delay_s = 0.25;
  const HoldSpec hold{1.0};
  const MoveToSpec move{{0.1}, 2.0};
  scene.operator_model->path = {hold, hold, move, hold, move, HoldSpec{0.5}, move};
  EXPECT_EQ(of(), (Intervals{{0.0, 2.0}, {4.5, 5.0}, {9.5 + 0.5, kForever}}));
  scene.control.architecture = Architecture::render;  // no link
  EXPECT_EQ(of(), (Intervals{{0.0, 2.0}, {4.0, 5.0}, {7.0, 7.5}, {9.5, kForever}}));
}

TEST(ContactFigures, LeaveWhatTheDelayStillBringsOutOfTheDrag) {
  Row<1> echo = free_space(5.0);
  echo.reference = newtons(5.0);
  EXPECT_NEAR(summary_of<1>({{1.0, free_space(0.5)}, {1.0, echo}}).free_force_rms_n(), 0.5, kRounding);
}

TEST(ContactFigures, OfSilenceAreNotPerfect) {
  // The robot presses 5 N, and nothing comes back.
  Row<1> silent = contact(0.0, 5.0, 5.0);
  silent.master_f_wanted = newtons(0.0);
  silent.coupled = silent.following = false;
  const Summary s = summary_of<1>({{1.0, silent}});
  EXPECT_NEAR(s.felt_force_error_rms_n(), 5.0, 5.0 * kRounding);
  EXPECT_EQ(s.muted_share(), 1.0);
  EXPECT_EQ(s.coupled_share(), 0.0);
  EXPECT_EQ(s.held_force_ratio(), 0.0);
  for (const auto& [name, value] : known_numbers(s))
    if (name == "position_error_rms_m" || name == "drift_m" || name == "free_force_rms_n" ||
        name == "force_direction_error_max_deg" || name == "force_direction_error_rms_deg") {
      EXPECT_FALSE(value) << name;
    }
}

TEST(ContactFigures, OfARunOfNothingAreNotOfACoupledOne) {
  const Summary s = summary_of<1>({});
  EXPECT_EQ(s.steps(), 0U);
  ASSERT_TRUE(s.has_coupled_share());
  EXPECT_EQ(s.coupled_share(), 0.0);
  EXPECT_EQ(s.touching_share(), 0.0);
}

TEST(ContactFigures, AreAbsentWhereNothingTouches) {
  const Summary s = summary_of<1>({{1.0, free_space(0.1)}});
  EXPECT_EQ(s.touching_share(), 0.0);
  EXPECT_EQ(s.contact_s(), 0.0);  // a wanted force of 0.1 N is drag, not contact
  for (const auto& [name, value] : known_numbers(s))
    if (name == "environment_force_mean_n" || name == "felt_force_error_rms_n" || name == "muted_share" ||
        name == "held_force_ratio" || name == "penetration_max_m") {
      EXPECT_FALSE(value) << name;
    }
}

TEST(ContactFigures, MeasureTheHandBehindTheRobotAlongTheForce) {
  Row<3> row{.env_f = Force<3>{Eigen::Vector3d{-2.0, 0.0, 0.0}},
             .ahead = Displacement<3>{Eigen::Vector3d{0.003, 0.5, 0.0}},
             .touching = true,
             .coupled = true,
             .following = true};
  EXPECT_NEAR(summary_of<3>({{1.0, row}}).penetration_max_m(), 0.003, 0.003 * kRounding);
  row.ahead = -row.ahead;
  EXPECT_EQ(summary_of<3>({{1.0, row}}).penetration_max_m(), 0.0);
}

TEST(ContactFigures, OfTorquesAreThoseOfRotation) {
  using Wrench = Eigen::Matrix<double, 6, 1>;
  const auto wrench = [](double force, const Eigen::Vector3d& torque) {
    Wrench w;
    w << force, 0.0, 0.0, torque;
    return Force<6>{w};
  };
  // A torque of 30 mN m where 40 mN m across it should be and half a right angle is asked for, with a hum of 100 Hz and
  // 2 mN m.
  Metrics<6> metrics{{.rate_hz = kRate, .duration_s = 20.0, .quiet_from_s = 0.0}};
  for (int k = 0; k < 40000; ++k) {
    const double hum = 2e-3 * std::sin(2.0 * std::numbers::pi * 100.0 * k / kRate);
    Row<6> row{.t_s = k / kRate,
               .master_f = wrench(1.0, {0.0, 0.0, 0.03 + hum}),
               .master_f_wanted = wrench(1.0, {0.0, 0.03, 0.03}),
               .env_f = wrench(-1.0, {0.0, -0.04, 0.0}),
               .position_error = Displacement<6>{Wrench{Wrench::Unit(4) * 0.02}},
               .figures = {k < 30000 ? 1.0 : 0.5},
               .reference = wrench(1.0, {0.0, 0.04, 0.0}),
               .touching = true,
               .coupled = true,
               .following = true};
    metrics.add(row);
  }
  Summary s;
  metrics.fill(s);
  EXPECT_NEAR(s.felt_torque_error_rms_n_m(), std::sqrt(0.03 * 0.03 + 0.04 * 0.04 + 0.5 * 2e-3 * 2e-3), 1e-9);
  EXPECT_NEAR(s.torque_direction_error_max_deg(), 45.0, 1e-9);
  // The filter passes 100 Hz but for 0.4 %, and rings at the start.
  EXPECT_NEAR(s.torque_chatter_rms_n_m(), 2e-3 / std::numbers::sqrt2, 0.02 * 2e-3);
  EXPECT_NEAR(s.attitude_error_rms_rad(), 0.02, 0.02 * kRounding);
  EXPECT_EQ(s.contact_spring_share(), 0.875);
  EXPECT_EQ(s.felt_force_error_rms_n(), 0.0);
  EXPECT_EQ(s.force_direction_error_max_deg(), 0.0);
  const Summary three = summary_of<3>({{1.0, {.touching = true, .following = true}}});
  EXPECT_FALSE(three.has_attitude_error_rms_rad());
  EXPECT_FALSE(three.has_felt_torque_error_rms_n_m());
}

TEST(Energies, AreEachOfItsOwnPort) {
  Metrics<1> metrics{{.rate_hz = kRate, .duration_s = 1.0, .quiet_from_s = 0.0, .initial_energy_j = 1e-3}, 25.0};
  for (const auto& [hand, slave, coupling] : {std::tuple{0.5, 0.01, 0.2}, {-0.25, 0.02, -0.125}, {0.0, 0.03, 0.0}})
    metrics.add({.master_energy_j = hand, .slave_energy_j = slave, .coupling_energy_j = coupling});
  Summary s;
  metrics.fill(s);
  EXPECT_EQ(s.hand_min_energy_j(), -0.25);
  EXPECT_EQ(s.min_port_energy_j(), 1e-3 - 0.25);
  EXPECT_EQ(s.initial_energy_j(), 1e-3);
  EXPECT_EQ(s.two_port_min_energy_j(), std::min(-0.25 - 25.0 * 0.02, 0.0 - 25.0 * 0.03));
  EXPECT_EQ(s.robot_min_energy_j(), -0.125);
}

TEST(DirectionFigures, SayInHowManyTicksThereIsAnAngle) {
  Row<1> muted = contact(0.0, 1.0, 1.0);
  const Summary s = summary_of<1>({{1.0, contact(1.0, 1.0, 1.0)}, {3.0, muted}});
  EXPECT_NEAR(s.force_direction_share(), 0.25, kRounding);
  EXPECT_EQ(s.force_direction_error_max_deg(), 0.0);
  EXPECT_FALSE(summary_of<1>({{3.0, muted}}).has_force_direction_error_max_deg());
}

TEST(PositionFigures, AreOfTheTicksInWhichTheSlaveFollows) {
  Row<1> off = free_space(0.0), on = free_space(0.0);
  on.position_error = Displacement<1>{Displacement<1>::Vector{0.004}};
  off.following = off.coupled = false;
  const Summary s = summary_of<1>({{1.0, off}, {1.0, on}});
  EXPECT_NEAR(s.position_error_rms_m(), 0.004, 0.004 * kRounding);
  EXPECT_EQ(s.drift_m(), 0.004);
  EXPECT_NEAR(s.coupled_share(), 0.5, kRounding);
  EXPECT_FALSE(summary_of<1>({{1.0, on}, {1.0, off}}).has_drift_m());
}

TEST(KnownParts, AreAllThatASideSays) {
  const auto says = [](KnownParts known) {
    std::set<std::string> names;
    for (const auto& [name, value] : known_numbers(summary_of<1>({{1.0, contact(1.0, 1.0, 1.0)}}, known)))
      if (value) names.insert(name);
    return names;
  };
  // No controller that keeps an account: its deficit is not known.
  EXPECT_FALSE(says({.account = false}).count("energy_owed_j"));
  const auto all = says({}), master = says({.robot_energy = false}), slave = says({.stability = false, .hand = false}),
             rendering = says({.link = false, .robot = false, .robot_energy = false});
  for (const char* name : {"robot_min_energy_j", "two_port_min_energy_j"}) {
    EXPECT_TRUE(all.count(name)) << name;
    EXPECT_FALSE(master.count(name)) << name;
  }
  for (const char* name : {"stable", "min_port_energy_j", "hand_min_energy_j", "two_port_min_energy_j", "max_force_n",
                           "felt_force_error_rms_n", "muted_share", "held_force_ratio", "force_error_rms_n",
                           "chatter_rms_n", "energy_owed_j"}) {
    EXPECT_TRUE(all.count(name)) << name;
    EXPECT_FALSE(slave.count(name)) << name;
  }
  for (const char* name : {"robot_min_energy_j", "robot_max_force_n", "robot_max_speed_m_per_s", "touching_share",
                           "environment_force_mean_n", "penetration_max_m", "position_error_rms_m"})
    EXPECT_TRUE(slave.count(name)) << name;
  for (const char* name :
       {"robot_max_force_n", "penetration_max_m", "coupled_share", "position_error_rms_m", "drift_m"})
    EXPECT_FALSE(rendering.count(name)) << name;
}

}  // namespace
}  // namespace twoport::metrics_test
