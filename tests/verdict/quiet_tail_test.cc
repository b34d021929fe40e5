#include "lab/engine/quiet_tail.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "common/record/columns.h"
#include "common/record/run_judge.h"
#include "common/scene/load.h"
#include "lab/engine/simulation.h"
#include "lab/run.h"

// What the verdict stands on: a simulation can be copied while it runs, and what is run for the verdict changes nothing else.
namespace twoport::lab::quiet_tail_test {
namespace {

const std::string kLink = R"(
duration_s: 0.4 rate_hz: 1000 seed: 5
operator { hand { mass_kg: 0.02 stiffness_n_per_m: 300 damping_n_s_per_m: 1 } tremor { rms_m: 1e-4 }
  path { sine { amplitude_m: 0.01 frequency_hz: 3 duration_s: 0.3 } } }
device { mass_kg: 0.1 damping_n_s_per_m: 1 position_resolution_m: 1e-5 }
to_slave { delay_ms: 7 jitter_ms: 2 loss: 0.1 duplicate: 0.1 reorder: 0.1 blackout { start_s: 0.25 duration_s: 0.1 } }
to_master { delay_ms: 5 jitter_ms: 1 burst { p: 0.1 r: 0.5 } }
robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { noise_n: 0.01 latency_ms: 3 } }
)";

template <int N>
std::vector<double> numbers_until(Simulation<N>& simulation, double end_s) {
  std::vector<double> all;
  simulation.run_until(to_duration(end_s), [&](const Row<N>& row) {
    for_each_column(row, [&]<class Value>(const Column&, const Value& value) {
      if constexpr (std::is_same_v<Value, double>)
        all.push_back(value);
      else
        all.insert(all.end(), value.data(), value.data() + value.size());
    });
    return true;
  });
  return all;
}

template <int N>
void expect_copies_go_on(const std::string& text, const std::vector<std::string>& set = {}) {
  SCOPED_TRACE(text);
  const Scene scene = parse_scene("dof: " + std::to_string(N) + " " + text, "copied", set);
  const auto whole = make_simulation<N>(scene), simulation = make_simulation<N>(scene);
  std::vector<double> all = numbers_until(*whole, 0.4), first = numbers_until(*simulation, 0.2173);
  const auto copy = simulation->copy();
  const std::vector<double> of_copy = numbers_until(*copy, 0.4), of_original = numbers_until(*simulation, 0.4);
  EXPECT_EQ(of_copy, of_original);
  first.insert(first.end(), of_original.begin(), of_original.end());
  EXPECT_EQ(first, all) << "in two parts";

  const auto kicked = copy->copy();
  typename Velocity<N>::Vector dv = Velocity<N>::Vector::Constant(1e-3);
  kicked->kick(Velocity<N>{dv}, Velocity<N>{dv});
  EXPECT_NE(numbers_until(*kicked, 0.6), numbers_until(*copy, 0.6));
}

TEST(Simulation, CanBeCopiedWhileItRuns) {
  const std::string wall = "environment { wall { normal: [1, 0, 0] stiffness_n_per_m: 1000 } }";
  for (const std::string method : {"NONE", "CLASSIC", "FORCE_PROJECTED"})
    for (const std::string architecture : {"POSITION_FORCE", "POSITION_POSITION", "POSITION_MEASURED_FORCE"}) {
      const std::string control =
          "control { architecture: " + architecture + " passivity { method: " + method + " } } ";
      expect_copies_go_on<3>(kLink + control + wall);
      expect_copies_go_on<6>(kLink + control + wall,
                             {"device.inertia_kg_m2=1e-3", "robot.inertia_kg_m2=[1e-3, 1e-3, 1e-3]"});
    }
  expect_copies_go_on<1>(kLink + "environment { wall { normal: [1] stiffness_n_per_m: 1000 } }");
  expect_copies_go_on<3>("duration_s: 0.4 device { mass_kg: 0.1 velocity_m_per_s: [-0.1, 0.02, 0] } " + wall +
                         " control { architecture: RENDER passivity { method: CLASSIC } }");
  expect_copies_go_on<6>(
      "duration_s: 0.4 robot { mass_kg: 0.1 inertia_kg_m2: [1e-3, 1e-3, 1e-3] velocity_m_per_s: [-0.1, 0, 0, 1, 2, 3] "
      "} " +
      wall + " control { architecture: UNCONTROLLED }");
}

TEST(Verdict, ChangesNoOtherFigure) {
  const Scene scene = parse_scene("dof: 3 " + kLink, "link");
  Summary with = run(scene), without = run(scene, {.verdict = VerdictFrom::plain});
  for (Summary* s : {&with, &without}) {
    s->set_stable(false), s->set_step_ns(0.0);
    s->clear_verdict(), s->clear_verdict_kind();
  }
  EXPECT_EQ(to_json(with), to_json(without));
}

/// The tails of drawn scenes, from a copy in contact and from the end: those of another run to the same moment.
template <int N>
void expect_same_verdicts(int cells, unsigned seed) {
  std::mt19937 random{seed};
  const auto among = [&](double low, double high) { return std::uniform_real_distribution{low, high}(random); };
  const std::array methods{"NONE", "CLASSIC", "FORCE_PROJECTED", "INTERNAL_MODEL", "FIXED_DAMPING"};
  for (int cell = 0; cell < cells; ++cell) {
    std::vector<std::string> set{
        std::string{"control.passivity.method="} + methods[static_cast<std::size_t>(cell) % methods.size()],
        "to_slave.delay_ms=" + std::to_string(among(1.0, 30.0)),
        "to_master.loss=" + std::to_string(cell % 3 == 0 ? 0.0 : among(0.0, 0.4)),
        "environment[0].wall.stiffness_n_per_m=" + std::to_string(std::exp(among(5.0, 9.0)))};
    if (N == 6) set.insert(set.end(), {"device.inertia_kg_m2=1e-3", "robot.inertia_kg_m2=[1e-3, 1e-3, 1e-3]"});
    const std::string zeros = N == 1 ? "" : ", 0, 0";
    const Scene scene = parse_scene("dof: " + std::to_string(N) + R"( duration_s: 3 rate_hz: 500 seed: 5
operator { hand { mass_kg: 0.1 stiffness_n_per_m: 300 damping_n_s_per_m: 4 } tremor { rms_m: 1e-4 }
  path { move_to { position_m: [0.03)" + zeros +
                                        R"(] duration_s: 0.5 } } path { hold { duration_s: 2 } } }
device { mass_kg: 0.1 damping_n_s_per_m: 1 }
to_slave { loss: 0.1 blackout { start_s: 1.5 duration_s: 0.1 } } to_master { delay_ms: 5 jitter_ms: 1 }
robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { noise_n: 0.01 } }
environment { wall { normal: [-1)" + zeros +
                                        R"(] offset_m: -0.02 stiffness_n_per_m: 1000 } })",
                                    "drawn", set);
    SCOPED_TRACE(set[0] + " " + set[1] + " " + set[2] + " " + set[3]);
    RunJudge<N> judge{{.rate_hz = 500.0, .duration_s = 3.0, .quiet_from_s = 2.5, .trends = false}};
    const auto simulation = make_simulation<N>(scene), again = make_simulation<N>(scene);
    const auto see = [&](const Row<N>& row) { return judge.add(row); };
    simulation->run_until(to_duration(2.0), see);
    const auto pressed = simulation->copy();
    simulation->run(see);
    if (judge.diverged()) continue;
    for (const auto& [at, at_s] : {std::pair{pressed.get(), 2.0}, {simulation.get(), 3.0}}) {
      const Verdict found = judge_tail(*at, scene, judge.scale()).verdict;
      numbers_until(*again, at_s);
      const Verdict other = judge_tail(*again, scene, judge.scale()).verdict;
      EXPECT_EQ(found.kind, other.kind) << found.text << "; " << other.text;
      EXPECT_EQ(found.text, other.text);
    }
    EXPECT_EQ(numbers_until(*simulation, 3.5), numbers_until(*again, 3.5)) << "judging changes nothing";
  }
}

TEST(Verdict, OfTheSameStateIsTheSameAndLeavesTheRunAsItIs) {
  expect_same_verdicts<1>(30, 1);
  expect_same_verdicts<3>(30, 2);
  expect_same_verdicts<6>(5, 3);
}

TEST(Verdict, IsUndecidedWhereNothingCanBeSaid) {
  const std::string link = "dof: 1 duration_s: 2 device { mass_kg: 0.1 velocity_m_per_s: [0.1] } robot { mass_kg: 1 } ";
  const auto judged = [](const std::string& text) { return run(parse_scene(text, "scene")); };
  const Summary alone = judged(link + "to_slave { loss: 1 } to_master { loss: 1 }");
  EXPECT_EQ(alone.verdict_kind(), "UNDECIDED") << alone.verdict();
  EXPECT_NE(alone.verdict().find("never met"), std::string::npos) << alone.verdict();
  EXPECT_FALSE(alone.stable());
  const Summary still = judged("dof: 1 duration_s: 2 device { mass_kg: 0.1 } robot { mass_kg: 1 } ");
  EXPECT_EQ(still.verdict_kind(), "UNDECIDED") << still.verdict();
  EXPECT_NE(still.verdict().find("nothing moved"), std::string::npos) << still.verdict();
}

/// A hand taps a wall of 5 kN/m by a sine, without control over 5 ms each way: the loop grows in each contact.
std::string tapped(double sine_s, const std::string& more = {}) {
  return "dof: 1 duration_s: 10 rate_hz: 1000 operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: "
         "8 } path { sine { "
         "amplitude_m: 0.03 frequency_hz: 0.5 duration_s: " +
         std::to_string(sine_s) + " } } " + more +
         " } device { mass_kg: 0.2 "
         "damping_n_s_per_m: 0.1 max_force_n: 20 } control { architecture: POSITION_MEASURED_FORCE virtual_coupling { "
         "stiffness_n_per_m: "
         "1000 damping_n_s_per_m: 30 } passivity { method: NONE } } to_slave { delay_ms: 5 } to_master { delay_ms: 5 } "
         "robot { mass_kg: "
         "0.5 damping_n_s_per_m: 3 force_sensor { } } environment { wall { normal: [-1] offset_m: -0.01 "
         "stiffness_n_per_m: 5000 } }";
}
TEST(Verdict, IsThatOfTheSceneNotOfAScheduledDelayBeyondItsEnd) {
  const std::vector<std::string> calm{"control.passivity.method=INTERNAL_MODEL"},
      later{calm[0], "to_slave.delay_step={at_s: 11 delay_ms: 400}"};
  const Summary as_is = run(parse_scene(tapped(8.0), "tapped", calm)),
                stepped = run(parse_scene(tapped(8.0), "tapped", later));
  EXPECT_EQ(stepped.verdict(), as_is.verdict());
}
TEST(Verdict, FromTheRunItselfCountsARestFromTheLastMotionOn) {
  const RunOptions plain{.verdict = VerdictFrom::plain};
  const Summary moves = run(parse_scene(tapped(4.5), "tapped"), plain),
                holds = run(parse_scene(tapped(4.5, "path { hold { duration_s: 9 } }"), "tapped"), plain);
  EXPECT_EQ(holds.verdict(), moves.verdict());
  EXPECT_EQ(holds.verdict_kind(), "UNSTABLE") << holds.verdict();
}

// The robot comes 150 ms after the hand: it touches the wall when the hand is on its way back.
TEST(Verdict, CountsAContactThatTheDelayMakesLate) {
  const Summary s = run(parse_scene(R"(
dof: 1 duration_s: 2.5 rate_hz: 1000
operator { hand { mass_kg: 0.05 stiffness_n_per_m: 2000 damping_n_s_per_m: 15 }
  path { sine { axis: 0 amplitude_m: 0.03 frequency_hz: 1 duration_s: 2 } } }
device { mass_kg: 0.05 damping_n_s_per_m: 0.5 }
control { architecture: POSITION_MEASURED_FORCE virtual_coupling { stiffness_n_per_m: 2000 damping_n_s_per_m: 30 }
  passivity { method: NONE } }
to_slave { delay_ms: 150 } to_master { delay_ms: 150 }
robot { mass_kg: 0.3 damping_n_s_per_m: 2 force_sensor { } }
environment { wall { normal: [-1] offset_m: -0.024 stiffness_n_per_m: 3000 } }
)",
                                    "late"));
  EXPECT_EQ(s.verdict_kind(), "UNSTABLE") << s.verdict();
  EXPECT_NE(s.verdict().find("held in contact"), std::string::npos) << s.verdict();
}

// A wrench that turns nothing as long as the run lasts, and turns the handle a little in the tail, decaying: what was at rest has
// the speed of the other kind of motion as its measure.
TEST(Verdict, CallsAnAxisThatBeginsToMoveInTheTailNotDiverged) {
  const Summary s = run(parse_scene(R"(
dof: 6 duration_s: 3 rate_hz: 1000 seed: 50647
operator {
  hand { stiffness_n_per_m: 72.5 damping_n_s_per_m: 0.8001 inertia_kg_m2: 1e-4 rotational_stiffness_n_m_per_rad: 4.13
    rotational_damping_n_m_s_per_rad: 0.00304 }
  path { hold { duration_s: 0.3 } }
  path { move_to { position_m: [0.1, 0, 0] duration_s: 0.05 } }
  path { hold { duration_s: 0.5 } }
  path { sine { axis: 1 amplitude_m: 0.00325 frequency_hz: 1.91 duration_s: 1.5 } }
  path { move_to { position_m: [0, 0, 0] duration_s: 0.3 } }
}
device { mass_kg: 1.643 damping_n_s_per_m: 0.05 inertia_kg_m2: 0.000203 rotational_damping_n_m_s_per_rad: 1e-4
  velocity_estimate: FILTERED }
control { architecture: POSITION_POSITION virtual_coupling { stiffness_n_per_m: 60.59 damping_n_s_per_m: 1.594 }
  passivity { method: MODEL_MEDIATED } }
to_slave { delay_ms: 17.84 jitter_ms: 0.208 jitter_distribution: UNIFORM }
to_master { delay_ms: 22.16 loss: 0.3 delay_step { at_s: 1.72 delay_ms: 5 }
  deadband { ratio: 0.0673 position_m: 0.000139 silence_ms: 1.26 } }
robot { mass_kg: 2.32 damping_n_s_per_m: 1 inertia_kg_m2: [0.0246] rotational_damping_n_m_s_per_rad: .01 force_sensor { } }
tool { contact_point { position_m: [0,0,0] } contact_point { position_m: [0.03,0.02,-0.01] } }
environment { cylinder { point_m: [.04,0.001,0] axis: [0,0,1] radius_m: 0.00979 stiffness_n_per_m: 198.5 } }
)",
                                    "turns in the tail"));
  EXPECT_NE(s.verdict_kind(), "UNSTABLE") << s.verdict();
}

// An encoder of 30 um and dry friction keep a light handle moving by 1 mrad/s for ever, irregularly: no trend is seen, and nobody notices.
TEST(Verdict, CallsTheDitherOfAnEncoderStable) {
  const std::vector<std::string> set{"control.passivity.method=INTERNAL_MODEL", "to_slave.delay_ms=25",
                                     "to_master.delay_ms=25", "seed=4"};
  const Summary s = run(load_scene(TWOPORT_SCENES "/six_dof_light_handle.textproto", set));
  EXPECT_EQ(s.verdict_kind(), "STABLE") << s.verdict();
}

// Joints with dry friction stick, slip and stick again at 1e-4 rad/s: a stretch of that grows, and no part of the loop does.
TEST(Verdict, CallsDryJointsThatComeToRestStable) {
  std::vector<std::string> set{"control.architecture=POSITION_POSITION", "control.passivity.method=NONE",
                               "control.force_scale=0.2", "to_slave.delay_ms=0", "to_master.delay_ms=0"};
  for (const std::string side : {"device", "robot"})
    for (const std::string field : {"file=../arms/fr3.textproto", "joint_damping_n_m_s_per_rad=1",
                                    "joint_coulomb_friction_n_m=[0.273,0.436,0.32,0.64,0.42,0.152,0.282]"})
      set.push_back(side + ".arm." + field);
  const Summary s = run(load_scene(TWOPORT_SCENES "/leader_follower.textproto", set));
  EXPECT_EQ(s.verdict_kind(), "STABLE") << s.verdict();
}

// Positions beyond a hundred metres are no divergence where nothing drives.
TEST(Verdict, LetsAFreeBodyGo) {
  const Summary s = run(parse_scene(
      "dof: 1 duration_s: 100 robot { mass_kg: 1 velocity_m_per_s: [20] } control { architecture: UNCONTROLLED }",
      "free"));
  EXPECT_EQ(s.verdict_kind(), "STABLE") << s.verdict();
  EXPECT_EQ(s.steps(), 100000U);
}

}  // namespace
}  // namespace twoport::lab::quiet_tail_test
