#include "lab/study/boundary.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <iterator>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "common/record/summary.h"
#include "common/scene/load.h"
#include "common/scene/scene.h"
#include "lab/run.h"
#include "tests/support/process.h"
#include "tests/theory/oracle.h"

// The laboratory's own runs against theory: where `boundary` finds that a scene stops being stable, and where the
// eigenvalues of the same loop leave the unit circle. Each set of parameters is drawn from a written seed and printed.
namespace twoport::lab::boundary_test {
namespace {

using test::exited;
using test::finished;
using test::Folder;
using Words = std::vector<std::string>;

class Draw {
 public:
  explicit Draw(std::uint64_t seed) : rng_{seed} {}
  double between(double low, double high) {
    return low + (high - low) * (static_cast<double>(rng_() >> 11) * 0x1.0p-53);
  }
  /// Evenly in the logarithm.
  double about(double low, double high) { return low * std::pow(high / low, between(0.0, 1.0)); }
  int one_of(int low, int high) { return low + static_cast<int>(rng_() % static_cast<std::uint64_t>(high - low + 1)); }

 private:
  std::mt19937_64 rng_;
};

constexpr double kWidth = 2e-4;  // to which the boundary is bisected: well within what is asked of it

/// How far theory lies outside of the two values that the search has ended with, relative; 0 between them.
double distance(const Boundary& found, double theory) {
  const auto [low, high] = std::minmax(found.stable, found.unstable);
  if (theory < low) return low / theory - 1.0;
  if (theory > high) return high / theory - 1.0;
  return 0.0;
}

/// Searches along `path` around the theory's value, prints the result and holds it to `tolerance`. Not too far up: some
/// loops are stable again beyond an interval that is not.
void expect_boundary(const std::string& what, double theory, const std::string& scene, const Words& set,
                     const std::string& path, double tolerance) {
  SCOPED_TRACE(what);
  const Boundary found = find_boundary(
      {.scene = scene, .set = set, .vary = {{path}, 0.8 * theory, 1.25 * theory}, .tolerance = kWidth, .scan = 2});
  EXPECT_LT(found.stable, found.unstable);
  const double off = distance(found, theory);
  fmt::print("    {:<104} theory {:<10.6g} laboratory {:<10.6g} to {:<10.6g} off by {:.1e}\n", what, theory,
             found.stable, found.unstable, off);
  EXPECT_LE(std::abs(off), tolerance);
}

// ---- a held spring

TEST(HeldSpring, LosesStabilityWhereTheEigenvaluesSay) {
  Draw draw{20261101};
  for (int i = 0; i < 14; ++i) {
    const double rate = 500.0 * (1 << draw.one_of(0, 3));
    SampledWall wall{.mass_kg = draw.about(0.03, 2.0),
                     .damping_n_s_per_m = draw.about(0.1, 10.0),
                     .hand_stiffness_n_per_m = 0.0,
                     .stiffness_n_per_m = 0.0,
                     .wall_damping_n_s_per_m = 0.0,
                     .period_s = 1.0 / rate};
    if (i % 3 > 0) wall.wall_damping_n_s_per_m = draw.about(1e-3, 0.6) * wall.mass_kg * rate;
    wall.true_velocity = i % 2 == 1;
    const std::string estimate = wall.true_velocity ? "TRUE_VELOCITY" : "BACKWARD_DIFFERENCE";
    expect_boundary(fmt::format("m {:.4g} b {:.4g} B {:.4g} 1/T {} {}", wall.mass_kg, wall.damping_n_s_per_m,
                                wall.wall_damping_n_s_per_m, rate, estimate),
                    critical_stiffness(wall), TWOPORT_SCENES "/held_spring.textproto",
                    {"duration_s=15", fmt::format("rate_hz={}", rate), fmt::format("device.mass_kg={}", wall.mass_kg),
                     fmt::format("device.damping_n_s_per_m={}", wall.damping_n_s_per_m),
                     fmt::format("environment[0].spring.damping_n_s_per_m={}", wall.wall_damping_n_s_per_m),
                     "device.velocity_estimate=" + estimate},
                    "environment[0].spring.stiffness_n_per_m", 5e-3);
  }
}

TEST(HeldSpring, InAHandLosesStabilityWhereTheEigenvaluesSay) {
  Draw draw{20261102};
  for (int i = 0; i < 3; ++i) {
    const double hand_mass = draw.about(0.005, 0.05), hand_damping = draw.about(0.2, 3.0);
    const SampledWall wall{.mass_kg = 0.075 + hand_mass,
                           .damping_n_s_per_m = 0.05 + hand_damping,
                           .hand_stiffness_n_per_m = draw.about(100.0, 5000.0),
                           .period_s = 5e-4};
    expect_boundary(
        fmt::format("m {:.4g} b {:.4g} k_h {:.4g}", wall.mass_kg, wall.damping_n_s_per_m, wall.hand_stiffness_n_per_m),
        critical_stiffness(wall), TWOPORT_SCENES "/held_spring.textproto",
        {"duration_s=15", "device.damping_n_s_per_m=0.05", fmt::format("operator.hand.mass_kg={}", hand_mass),
         fmt::format("operator.hand.damping_n_s_per_m={}", hand_damping),
         fmt::format("operator.hand.stiffness_n_per_m={}", wall.hand_stiffness_n_per_m)},
        "environment[0].spring.stiffness_n_per_m", 5e-3);
  }
}

// ---- bilateral loops

// The handle is given a push. Nothing ramps, and the tracker follows at any speed: the loop is linear from the first
// tick.
constexpr const char* kLoop = R"(
dof: 1 duration_s: 12
operator { hand { } }
device { velocity_m_per_s: [0.001] }
control { virtual_coupling { catch_up_m_per_s: 1e6 } passivity { method: NONE } engage_s: 0 }
environment { spring { stiffness_n_per_m: 500 anchor_m: [0] } }
)";

Words overrides(const BilateralLoop& l) {
  const auto set = [](const char* path, double value) { return fmt::format("{}={}", path, value); };
  Words all{set("rate_hz", 1.0 / l.period_s),
            "control.architecture=" + to_string(l.architecture),
            set("device.mass_kg", l.master_mass_kg),
            set("device.damping_n_s_per_m", l.master_damping_n_s_per_m),
            set("operator.hand.stiffness_n_per_m", l.hand_stiffness_n_per_m),
            set("environment[0].spring.stiffness_n_per_m", l.environment_stiffness_n_per_m),
            set("environment[0].spring.damping_n_s_per_m", l.environment_damping_n_s_per_m),
            set("control.virtual_coupling.stiffness_n_per_m", l.coupling_stiffness_n_per_m),
            set("control.virtual_coupling.damping_n_s_per_m", l.coupling_damping_n_s_per_m),
            set("control.force_scale", l.force_scale),
            set("control.motion_scale", l.motion_scale),
            set("to_slave.delay_ms", 1e3 * l.to_slave_ticks * l.period_s),
            set("to_master.delay_ms", 1e3 * l.to_master_ticks * l.period_s)};
  if (l.backward_difference) all.emplace_back("device.velocity_estimate=BACKWARD_DIFFERENCE");
  if (!l.ideal_robot) {
    all.push_back(set("robot.mass_kg", l.robot_mass_kg));
    all.push_back(set("robot.damping_n_s_per_m", l.robot_damping_n_s_per_m));
    all.emplace_back("robot.force_sensor={}");
  }
  return all;
}

std::string words(const BilateralLoop& l) {
  return fmt::format(
      "m {:.3g}|{:.3g} b {:.3g}|{:.3g} k_h {:.3g} k_e {:.3g} b_e {:.2g} K {:.3g} B {:.3g} d {}+{} T {} s_x "
      "{:.2g}{}{}",
      l.master_mass_kg, l.robot_mass_kg, l.master_damping_n_s_per_m, l.robot_damping_n_s_per_m,
      l.hand_stiffness_n_per_m, l.environment_stiffness_n_per_m, l.environment_damping_n_s_per_m,
      l.coupling_stiffness_n_per_m, l.coupling_damping_n_s_per_m, l.to_slave_ticks, l.to_master_ticks, l.period_s,
      l.motion_scale, l.backward_difference ? " difference" : "", l.ideal_robot ? " ideal" : "");
}

BilateralLoop drawn(Draw& draw, Architecture architecture, int i) {
  return {.architecture = architecture,
          .master_mass_kg = draw.about(0.07, 1.0),
          .master_damping_n_s_per_m = draw.about(0.5, 10.0),
          .hand_stiffness_n_per_m = draw.about(50.0, 800.0),
          .robot_mass_kg = draw.about(0.2, 3.0),
          .robot_damping_n_s_per_m = draw.about(1.0, 20.0),
          .environment_stiffness_n_per_m = draw.about(100.0, 5000.0),
          .environment_damping_n_s_per_m = i % 3 == 0 ? draw.between(0.0, 5.0) : 0.0,
          .coupling_stiffness_n_per_m = draw.about(300.0, 3000.0),
          .coupling_damping_n_s_per_m = draw.about(10.0, 60.0),
          .force_scale = 1.0,
          .motion_scale = i % 4 == 0 ? draw.between(0.5, 2.0) : 1.0,
          .period_s = i % 2 == 0 ? 1e-3 : 5e-4,
          .to_slave_ticks = draw.one_of(1, 12),
          .to_master_ticks = i == 3 ? 40 : draw.one_of(1, 12),
          .backward_difference = i % 5 == 1,
          .ideal_robot = false};
}

TEST(PositionForce, LosesStabilityWhereTheEigenvaluesSay) {
  const Folder folder;
  const std::string scene = folder.write("loop.textproto", kLoop);
  Draw draw{20261103};
  for (int i = 0; i < 12; ++i) {
    const BilateralLoop loop = drawn(draw, Architecture::position_force, i);
    expect_boundary(words(loop), critical_force_scale(loop), scene, overrides(loop), "control.force_scale", 1e-2);
  }
}

TEST(PositionMeasuredForce, LosesStabilityWhereTheEigenvaluesSay) {
  const Folder folder;
  const std::string scene = folder.write("loop.textproto", kLoop);
  Draw draw{20261104};
  for (int i = 0; i < 12; ++i) {
    const BilateralLoop loop = drawn(draw, Architecture::position_measured_force, i);
    expect_boundary(words(loop), critical_force_scale(loop), scene, overrides(loop), "control.force_scale", 1e-2);
  }
}

TEST(PositionPosition, LosesStabilityWhereTheEigenvaluesSay) {
  const Folder folder;
  const std::string scene = folder.write("loop.textproto", kLoop);
  Draw draw{20261105};
  for (int i = 0; i < 12; ++i) {
    BilateralLoop loop = drawn(draw, Architecture::position_position, i);
    if (i % 3 == 0) loop.force_scale = draw.between(0.4, 2.5);
    expect_boundary(words(loop), critical_coupling_stiffness(loop), scene, overrides(loop),
                    "control.virtual_coupling.stiffness_n_per_m", 1e-2);
  }
}

TEST(IdealRobot, LosesStabilityWhereTheEigenvaluesSay) {
  const Folder folder;
  const std::string scene = folder.write("loop.textproto", kLoop);
  Draw draw{20261106};
  for (int i = 0; i < 4; ++i) {
    BilateralLoop loop =
        drawn(draw, i % 2 == 0 ? Architecture::position_force : Architecture::position_measured_force, i);
    loop.ideal_robot = true;
    expect_boundary(words(loop), critical_force_scale(loop), scene, overrides(loop), "control.force_scale", 1e-2);
  }
}

// Between ticks a packet is as late as the next tick; and a link without delay has one.
TEST(PositionForce, CountsDelaysInWholeTicks) {
  const Folder folder;
  const std::string scene = folder.write("loop.textproto", kLoop);
  BilateralLoop loop{.architecture = Architecture::position_force};
  for (const auto& [there, back] : {std::pair{0.0, 0.0}, std::pair{2.3e-3, 4e-4}, std::pair{7e-3, 1.001e-3}}) {
    loop.to_slave_ticks = ticks_of_delay(there, loop.period_s);
    loop.to_master_ticks = ticks_of_delay(back, loop.period_s);
    Words set = overrides(loop);
    set.push_back(fmt::format("to_slave.delay_ms={}", 1e3 * there));
    set.push_back(fmt::format("to_master.delay_ms={}", 1e3 * back));
    expect_boundary(fmt::format("delay {} and {} ms", 1e3 * there, 1e3 * back), critical_force_scale(loop), scene, set,
                    "control.force_scale", 1e-2);
  }
}

// ---- what a sampled spring gives away

constexpr const char* kImposed = R"(
dof: 1 duration_s: 1
operator { path { hold { duration_s: 1 } } }
control { architecture: RENDER passivity { method: NONE } }
environment { spring { stiffness_n_per_m: 500 anchor_m: [0] } }
)";

void expect_leak(const std::string& what, double theory, const Words& set) {
  SCOPED_TRACE(what);
  const Summary s = run(parse_scene(kImposed, "imposed", set));
  const double off = -s.min_port_energy_j() / theory - 1.0;
  fmt::print("    {:<60} theory {:<12.8g} J laboratory {:<12.8g} J off by {:.1e}\n", what, theory,
             -s.min_port_energy_j(), off);
  EXPECT_LE(std::abs(off), 1e-9);
}

TEST(SampledSpring, GivesAwayInASineWhatTheClosedFormSays) {
  Draw draw{20261107};
  for (int i = 0; i < 8; ++i) {
    const double rate = 500.0 * (1 << draw.one_of(0, 3)), k = draw.about(100.0, 20000.0), a = draw.about(1e-4, 0.05);
    const int ticks = draw.one_of(10, 500), periods = draw.one_of(1, 5);
    const double all = ticks * periods / rate;
    expect_leak(
        fmt::format("K {:.4g} A {:.4g} N {} 1/T {} periods {}", k, a, ticks, rate, periods),
        periods * sine_leak(k, a, ticks),
        {fmt::format("rate_hz={}", rate), fmt::format("duration_s={:.17g}", all + 0.5 / rate),
         fmt::format("environment[0].spring.stiffness_n_per_m={}", k),
         fmt::format("operator.path[0]={{ sine {{ amplitude_m: {:.17g} frequency_hz: {:.17g} duration_s: {:.17g} }} }}",
                     a, rate / ticks, all)});
  }
}

TEST(SampledSpring, GivesAwayWhenPressedAndReleasedWhatItsStepsSay) {
  Draw draw{20261108};
  for (int i = 0; i < 4; ++i) {
    const double rate = 500.0 * (1 << draw.one_of(0, 3)), k = draw.about(100.0, 20000.0),
                 depth = draw.about(1e-3, 0.05);
    const int ticks = draw.one_of(20, 800);
    std::vector<double> x;
    for (int t = 0; t <= 2 * ticks; ++t) {
      const double s = static_cast<double>(t <= ticks ? t : 2 * ticks - t) / ticks;
      x.push_back(depth * s * s * s * (10.0 - s * (15.0 - 6.0 * s)));
    }
    const auto move = [&](double to) {
      return fmt::format("{{ move_to {{ position_m: {:.17g} duration_s: {:.17g} }} }}", to, ticks / rate);
    };
    expect_leak(fmt::format("K {:.4g} D {:.4g} ticks {} 1/T {}", k, depth, ticks, rate), spring_leak(k, x),
                {fmt::format("rate_hz={}", rate), fmt::format("duration_s={:.17g}", (2 * ticks + 0.5) / rate),
                 fmt::format("environment[0].spring.stiffness_n_per_m={}", k), "operator.path[0]=" + move(depth),
                 "operator.path[1]=" + move(0.0)});
  }
}

// ---- what is stable though no eigenvalue says so

/// A light hand presses a rendered wall for half a second and keeps on.
constexpr const char* kPressed = R"(
dof: 3 duration_s: 6 rate_hz: 2000
operator {
  hand { mass_kg: 0.01 damping_n_s_per_m: 0.5 stiffness_n_per_m: 300 }
  path { move_to { position_m: [-0.006, 0, 0] duration_s: 0.5 } }
}
device { mass_kg: 0.075 damping_n_s_per_m: 0.02 }
control { architecture: RENDER passivity { method: NONE } }
environment { wall { normal: [1, 0, 0] stiffness_n_per_m: 5000 } }
)";

TEST(Stable, IsNotALimitCycleThatTheRenderingFeeds) {
  const Summary s = run(parse_scene(kPressed, "pressed"));
  EXPECT_FALSE(s.stable()) << s.verdict();
  EXPECT_NE(s.verdict().find("fed by the rendering"), std::string::npos) << s.verdict();
  EXPECT_LT(s.max_force_n(), 1000.0);  // bounded all the same
}

TEST(Stable, IsWhatPaysForItsOwnWay) {
  for (const char* cure : {"operator.hand.damping_n_s_per_m=3", "control.passivity.method=FORCE_PROJECTED"}) {
    const Words set{cure};
    const Summary s = run(parse_scene(kPressed, "pressed", set));
    EXPECT_TRUE(s.stable()) << cure << ": " << s.verdict();
  }
}

TEST(Stable, IsAPassiveControllerThatBuzzesOnCredit) {
  const std::string scene = TWOPORT_SCENES "/stiff_wall_50ms.textproto";
  for (const char* method : {"CLASSIC", "FORCE_PROJECTED"}) {
    const Words set{std::string{"control.passivity.method="} + method};
    const Summary s = run(load_scene(scene, set));
    EXPECT_TRUE(s.stable()) << method << ": " << s.verdict();
    EXPECT_GT(s.chatter_rms_n(), 0.1) << method;
    EXPECT_GE(s.min_port_energy_j(), 0.0) << method;
  }
  const Words none{"control.passivity.method=NONE"};
  EXPECT_FALSE(run(load_scene(scene, none)).stable());
}

TEST(Stable, IsAHandThatMovesThoughTheSpringGivesAwayEnergy) {
  // The path never ends, the port energy falls for ever, and nothing swings but what the hand swings.
  const Words set{"duration_s=4", "operator.path[0]={ sine { amplitude_m: 0.01 frequency_hz: 2 duration_s: 10 } }",
                  "environment[0].spring.stiffness_n_per_m=5000", "rate_hz=2000"};
  const Summary s = run(parse_scene(kImposed, "imposed", set));
  EXPECT_TRUE(s.stable()) << s.verdict();
  EXPECT_LT(s.min_port_energy_j(), -0.01);
}

// ---- the program

std::string last_line(const std::string& text) {
  const std::size_t end = text.find_last_not_of('\n');
  const std::size_t start = text.rfind('\n', end);
  return text.substr(start == text.npos ? 0 : start + 1, end - start);
}

const std::string kHeld = TWOPORT_SCENES "/held_spring.textproto";
const std::string kStiffness = "environment[0].spring.stiffness_n_per_m";

TEST(BoundaryProgram, EndsWithPathAndValue) {
  const test::Process p = finished({TWOPORT_LAB, "boundary", kHeld, "--vary", kStiffness + "=500:8000", "--set",
                                    "duration_s=15", "--tolerance", "5e-4"});
  const std::string line = last_line(p.out()), name = kStiffness + " = ";
  ASSERT_EQ(line.rfind(name, 0), 0U) << p.out() << p.err();
  const double theory = critical_stiffness({.period_s = 5e-4});
  EXPECT_NEAR(std::stod(line.substr(name.size())), theory, 5e-4 * theory);
  EXPECT_NE(p.out().find("contact decides: without its environment the run is not unstable at "), std::string::npos)
      << p.out();
  EXPECT_EQ(p.err(), "");
}

// Positions exchanged over a delay, with springs alone, feed themselves where a soft wall is touched and where not.
TEST(BoundaryProgram, SaysThatFreeSpaceDecides) {
  const test::Process p =
      finished({TWOPORT_LAB, "boundary", TWOPORT_SCENES "/one_axis_wall.textproto", "--set",
                "control.passivity.method=NONE", "--set", "control.architecture=POSITION_POSITION", "--set",
                "control.virtual_coupling.damping_n_s_per_m=1", "--set", "environment[0].wall.stiffness_n_per_m=20",
                "--vary", "to_slave.delay_ms,to_master.delay_ms=0.5:100", "--tolerance", "0.05"});
  EXPECT_NE(p.out().find("free space decides: without its environment the run is unstable at "), std::string::npos)
      << p.out() << p.err();
}

TEST(BoundaryProgram, SaysSoWhereAValueIsTheLeastThatIsStable) {
  const test::Process p = finished({TWOPORT_LAB, "boundary", "--set", "duration_s=15", kHeld, "--vary",
                                    "device.damping_n_s_per_m=0.05:5", "--set", kStiffness + "=2000"});
  EXPECT_NE(p.out().find("stable from here up"), std::string::npos) << p.out();
  const std::string line = last_line(p.out()), name = "device.damping_n_s_per_m = ";
  ASSERT_EQ(line.rfind(name, 0), 0U) << p.out() << p.err();
  EXPECT_NEAR(std::stod(line.substr(name.size())), 0.5, 1e-3);
}

// Two springs side by side hold together what one holds alone.
TEST(BoundaryProgram, MovesLinkedPathsTogether) {
  const std::string other = "environment[1].spring.stiffness_n_per_m";
  const test::Process p =
      finished({TWOPORT_LAB, "boundary", kHeld, "--vary", kStiffness + "," + other + "=250:4000", "--set",
                "environment[1].spring.anchor_m=[0]", "--set", "duration_s=15", "--tolerance", "5e-4"});
  const std::string line = last_line(p.out()), name = kStiffness + "," + other + " = ";
  ASSERT_EQ(line.rfind(name, 0), 0U) << p.out() << p.err();
  const double theory = 0.5 * critical_stiffness({.period_s = 5e-4});
  EXPECT_NEAR(std::stod(line.substr(name.size())), theory, 5e-4 * theory);
}

/// Two modes that meet: unstable by a hair from 0.54 to 0.79, then stable again up to beyond 1.1.
const BilateralLoop kIsland{.architecture = Architecture::position_force,
                            .master_mass_kg = 0.331178,
                            .master_damping_n_s_per_m = 0.582512,
                            .hand_stiffness_n_per_m = 459.931,
                            .robot_mass_kg = 0.536161,
                            .robot_damping_n_s_per_m = 2.8019,
                            .environment_stiffness_n_per_m = 1642.66,
                            .coupling_stiffness_n_per_m = 1231.63,
                            .coupling_damping_n_s_per_m = 54.8651,
                            .period_s = 5e-4,
                            .to_slave_ticks = 9,
                            .to_master_ticks = 12};

TEST(Boundary, IsTheFirstOfSeveralChanges) {
  const Folder folder;
  const std::string scene = folder.write("loop.textproto", kLoop);
  const double first = critical_force_scale(kIsland);
  BilateralLoop beyond = kIsland;
  beyond.force_scale = 1.7 * first;
  ASSERT_LT(spectral_radius(beyond), 1.0);
  BoundaryOptions options{
      .scene = scene, .set = overrides(kIsland), .vary = {{"control.force_scale"}, 0.5 * first, 5.0 * first}};
  EXPECT_LE(std::abs(distance(find_boundary(options), first)), 1e-2);
  options.scan = 0;
  EXPECT_GT(find_boundary(options).stable, 1.7 * first);  // bisection alone steps over it
}

TEST(BoundaryProgram, SaysThatWhatLiesBetweenDiffersFromEndsThatAgree) {
  const Folder folder;
  const std::string scene = folder.write("loop.textproto", kLoop);
  Words command{TWOPORT_LAB, "boundary", scene, "--vary", fmt::format("control.force_scale={}:{}", 0.3, 1.0)};
  for (const std::string& each : overrides(kIsland)) command.insert(command.end(), {"--set", each});
  test::Process p = finished(command);
  EXPECT_EQ(p.wait(), exited(2)) << p.out();
  EXPECT_NE(p.err().find("both ends are stable"), std::string::npos) << p.err();
  EXPECT_NE(p.err().find("is not"), std::string::npos) << p.err();
}

void expect_refused(const Words& arguments, const Words& parts) {
  Words command{TWOPORT_LAB, "boundary"};
  command.insert(command.end(), arguments.begin(), arguments.end());
  test::Process p = finished(command);
  EXPECT_EQ(p.wait(), exited(2)) << p.out() << p.err();
  EXPECT_EQ(p.err().rfind("twoport-lab: ", 0), 0U) << p.err();
  EXPECT_EQ(test::count(p.err(), "\n"), 1) << p.err();
  for (const std::string& part : parts) EXPECT_NE(p.err().find(part), std::string::npos) << p.err();
}

// ---- curves

// Searches go on together, so that lanes have something to share.
TEST(BoundaryCurve, IsTheSameInLanes) {
  BoundaryOptions o{.scene = TWOPORT_SCENES "/one_axis_wall.textproto",
                    .set = {"duration_s=3", "rate_hz=1000", "control.passivity.method=NONE"},
                    .vary = {{"to_slave.delay_ms", "to_master.delay_ms"}, 1.0, 30.0},
                    .tolerance = 0.03,
                    .jobs = 2,
                    .lanes = 1};
  const Axis spring = parse_axis("control.virtual_coupling.stiffness_n_per_m=300,1000,3000");
  const BoundaryCurve alone = boundary_curve(o, spring);
  EXPECT_EQ(alone.use.together, 0U);
  o.lanes = 0;
  const BoundaryCurve together = boundary_curve(o, spring);
  EXPECT_EQ(to_csv(to_table(alone)), to_csv(to_table(together)));
  EXPECT_GE(together.use.together, 3U * 10U);
  EXPECT_TRUE(together.found[1].boundary);
}

TEST(BoundaryCurve, IsTheBoundaryAtEachValueForAnyNumberOfJobs) {
  const Axis damping = parse_axis("device.damping_n_s_per_m=0.3,0.5,0.8");
  BoundaryOptions options{.scene = kHeld, .set = {"duration_s=10"}, .vary = {{kStiffness}, 500.0, 8000.0}};
  const std::string alone = to_csv(to_table(boundary_curve(options, damping)));
  options.jobs = 3;
  EXPECT_EQ(to_csv(to_table(boundary_curve(options, damping))), alone);
  std::string expected = "device.damping_n_s_per_m," + kStiffness + ",note,decides\n";
  for (const std::string& value : damping.values) {
    BoundaryOptions one = options;
    one.set.push_back("device.damping_n_s_per_m=" + value);
    const Boundary found = find_boundary(one);
    expected += fmt::format("{},{},,{}\n", value, found.stable,
                            what_decides(one, found)->by_contact ? "contact" : "free space");
  }
  EXPECT_EQ(alone, expected);
}

// A sampled spring is stable up to 2b/T: 200, 2000 and 20000 N/m.
TEST(BoundaryProgram, MakesACurveWhoseRowsSayWhereThereIsNoBoundary) {
  const Folder folder;
  const Words command{TWOPORT_LAB,
                      "boundary",
                      kHeld,
                      "--vary",
                      kStiffness + "=500:4000",
                      "--set",
                      "duration_s=15",
                      "--along",
                      "device.damping_n_s_per_m=0.05,0.5,5"};
  test::Process to_stdout = finished(command);
  EXPECT_EQ(to_stdout.wait(), exited(0)) << to_stdout.err();
  EXPECT_EQ(to_stdout.err(), "");
  const std::string text = to_stdout.out();
  EXPECT_EQ(
      text.rfind("device.damping_n_s_per_m," + kStiffness + ",note,decides\n0.05,,unstable at both ends,\n0.5,", 0), 0U)
      << text;
  EXPECT_NE(text.find("\n5,,stable at both ends,\n"), std::string::npos) << text;
  const std::size_t row = text.find("\n0.5,") + 5;
  EXPECT_NEAR(std::stod(text.substr(row)), critical_stiffness({.period_s = 5e-4}), 2.0);  // 1e-3 of it

  Words to_folder = command;
  to_folder.insert(to_folder.end(), {"--out", folder / "curve"});
  test::Process p = finished(to_folder);
  EXPECT_EQ(p.wait(), exited(0)) << p.err();
  EXPECT_EQ(test::read_text(folder / "curve/boundary.csv"), text);
  EXPECT_NE(p.out().find("/boundary.csv: 3 rows\n"), std::string::npos) << p.out();
  if (std::system("command -v gnuplot > /dev/null 2>&1") != 0) return;
  EXPECT_EQ(test::read_text(folder / "curve/boundary.png").rfind("\x89PNG", 0), 0U) << p.out();
  const std::string svg = test::read_text(folder / "curve/boundary.svg");
  for (const char* words : {"device damping [N s/m]", "spring stiffness [N/m]", "held spring", "boundary", "unstable"})
    EXPECT_NE(svg.find(words), std::string::npos) << words;
}

TEST(BoundaryCurve, StoppedAfterTheScanHasTheSidesThatAreKnown) {
  std::atomic<bool> stop{false};
  const BoundaryOptions o{.scene = kHeld,
                          .text = {},
                          .set = {"duration_s=5"},
                          .vary = parse_interval(kStiffness + "=500:8000"),
                          .jobs = 2,
                          .stop = &stop};
  const Axis along = parse_axis("device.damping_n_s_per_m=0.5,1");
  const BoundaryCurve some = boundary_curve(o, along, {}, [&](const BoundaryCurve&) { stop = true; });
  stop = false;
  const BoundaryCurve whole = boundary_curve(o, along);
  EXPECT_TRUE(some.stopped);
  EXPECT_FALSE(whole.stopped);
  ASSERT_EQ(some.found.size(), 2U);
  const Table rows = to_table(some);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_TRUE(some.found[i].open);
    EXPECT_FALSE(whole.found[i].open);
    EXPECT_LE(some.found[i].boundary->stable, whole.found[i].boundary->stable);
    EXPECT_GE(some.found[i].boundary->unstable, whole.found[i].boundary->unstable);
    EXPECT_EQ(std::prev(rows.rows[i].end(), 2)->text(),
              fmt::format("stopped: unstable at {}", some.found[i].boundary->unstable));
  }
}

TEST(BoundaryProgram, MakesACurveOfLinkedPathsAndOfTheLeastStableValue) {
  const std::string damping = "device.damping_n_s_per_m", other = "environment[1].spring.stiffness_n_per_m";
  const test::Process p = finished({TWOPORT_LAB, "boundary", kHeld, "--vary", damping + "=0.05:5", "--along",
                                    kStiffness + "," + other + "=1000,2000", "--set",
                                    "environment[1].spring.anchor_m=[0]", "--set", "duration_s=15"});
  const std::string text = p.out();
  ASSERT_EQ(text.rfind(kStiffness + "," + other + "," + damping + ",note,decides\n1000,1000,0.", 0), 0U)
      << text << p.err();
  ASSERT_EQ(test::count(text, ",stable from here up,contact\n"), 2) << text;
  const auto found = [&](const std::string& row) { return std::stod(text.substr(text.find(row) + row.size())); };
  EXPECT_NEAR(found("\n1000,1000,"), 0.5, 2e-3);  // b = K T/2 of both together; 1e-3, and the mass's small share
  EXPECT_NEAR(found("\n2000,2000,"), 1.0, 4e-3);
}

TEST(BoundaryProgram, SaysThatARowIsStableAtBothEndsButNotBetween) {
  const Folder folder;
  const std::string scene = folder.write("loop.textproto", kLoop);
  Words command{TWOPORT_LAB, "boundary", scene, "--vary", "control.force_scale=0.3:1", "--along", "seed=1,2"};
  for (const std::string& each : overrides(kIsland)) command.insert(command.end(), {"--set", each});
  const test::Process p = finished(command);
  EXPECT_EQ(test::count(p.out(), ",,stable at both ends but not at 0."), 2) << p.out() << p.err();
}

TEST(BoundaryProgram, RefusesEndsThatAgree) {
  expect_refused({kHeld, "--vary", kStiffness + "=100:200", "--set", "duration_s=5"},
                 {kStiffness, "both ends are stable", "100", "200"});
  expect_refused({kHeld, "--vary", kStiffness + "=20000:40000", "--set", "duration_s=5"},
                 {kStiffness, "both ends are unstable", "20000", "40000"});
}

TEST(BoundaryProgram, SaysWhatIsWrongWithAnIntervalOrAPath) {
  expect_refused({kHeld, "--vary", kStiffness}, {"--vary", kStiffness, "PATH=LO:HI"});
  expect_refused({kHeld, "--vary", kStiffness + "=5:x"}, {"\"x\"", "PATH=LO:HI"});
  expect_refused({kHeld, "--vary", kStiffness + "=5:5"}, {"LO is 5", "LO must be < HI"});
  expect_refused({kHeld, "--vary", kStiffness + ",=1:2"}, {"a path is empty"});
  expect_refused({kHeld, "--vary", kStiffness + "," + kStiffness + "=1:2"}, {"named twice"});
  expect_refused({kHeld, "--vary", "device.colour=1:2"}, {"device.colour=1", "colour", "mass_kg"});
  expect_refused({kHeld, "--vary", "device.mass_kg=-1:2"}, {"device.mass_kg", "-1", ">= 0"});
  expect_refused({kHeld, "--vary", kStiffness + "=500:8000", "--tolerance", "0"}, {"--tolerance", "0", "between"});
  const Words curve{kHeld, "--vary", kStiffness + "=500:8000", "--along"};
  const auto plus = [](Words all, const Words& more) {
    all.insert(all.end(), more.begin(), more.end());
    return all;
  };
  expect_refused(plus(curve, {"device.mass_kg"}), {"--along device.mass_kg", "PATH=a,b,c"});
  expect_refused(plus(curve, {"device.mass_kg=0.1,-1"}), {"device.mass_kg", "-1", ">= 0"});
  expect_refused(plus(curve, {"device.mass_kg," + kStiffness + "=1,2"}), {"--along", kStiffness + " is varied"});
  expect_refused(plus(curve, {"seed=1,2", "--jobs", "0"}), {"--jobs", "0", "at least 1"});
  expect_refused(plus(curve, {"seed=1,2", "--out", "/dev/null/x"}), {"--out /dev/null/x"});
  expect_refused(plus(curve, {"environment[0].spring={stiffness_n_per_m:1},{stiffness_n_per_m:2}"}),
                 {"--along environment[0].spring: ", "is a part of", "vary one of them"});
  expect_refused({kHeld, "--vary", kStiffness + "=500:8000", "--out", "x"}, {"--out", "--along"});
  expect_refused({kHeld + "x", "--vary", kStiffness + "=500:8000"}, {kHeld + "x", "No such file"});
}

}  // namespace
}  // namespace twoport::lab::boundary_test
