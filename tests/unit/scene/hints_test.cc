#include "common/scene/hints.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "common/scene/load.h"
#include "tests/support/folder.h"
#include "tests/support/meshes.h"
#include "tests/unit/scene/scenes.h"

namespace twoport::test::hints_test {
namespace {

using Sentences = std::vector<std::string>;

TEST(Hints, OfAnOrdinarySceneAreNone) {
  for (const char* scene : {kStiffWall, kHeldSpring}) EXPECT_EQ(hints(scene_of(scene)), Sentences{});
}

TEST(Hints, OfALiveProgramSayThatTheSlavesClockIsIgnored) {
  EXPECT_EQ(live_hints(scene_of(kStiffWall), true), Sentences{});
  const Sentences expected{
      "slave_clock is ignored: it is for the laboratory, here each side has the clock of its machine"};
  for (const char* clock : {"slave_clock.drift_ppm=100", "slave_clock.offset_ms=5"}) {
    EXPECT_EQ(live_hints(scene_of(kStiffWall, {clock}), true), expected);
    EXPECT_EQ(hints(scene_of(kStiffWall, {clock})), Sentences{});
  }
}

TEST(Hints, NameTheLargestLengthWhereItLooksLikeMillimetres) {
  const auto first = [](const Overrides& overrides) { return hints(scene_of(kStiffWall, overrides)).at(0); };
  EXPECT_EQ(first({"device.position_m=[0, -30, 6]"}),
            "device.position_m is 30 m; lengths are in metres, and 30 mm are 0.03");
  EXPECT_TRUE(first({"robot.position_m=[5.1, 0, 0]"}).starts_with("robot.position_m is 5.1 m"));
  EXPECT_TRUE(first({"operator.path[1].sine.amplitude_m=40"}).starts_with("operator.path[1].sine.amplitude_m is 40 m"));
  EXPECT_TRUE(
      first({"operator.path[0].move_to.position_m=[30, 0, 0]"}).starts_with("operator.path[0].move_to.position_m is"));
  EXPECT_TRUE(first({"environment[0].wall.offset_m=-20"}).starts_with("environment[0].wall.offset_m is 20 m"));
  EXPECT_TRUE(first({"environment[1].sphere={radius_m: 50 stiffness_n_per_m: 1}"})
                  .starts_with("environment[1].sphere.radius_m is 50 m"));
  EXPECT_EQ(hints(scene_of(kStiffWall, {"environment[0].wall.offset_m=-5"})), Sentences{});
}

/// A gram as a kilogram, N/mm as N/m, and so on, in both directions; one is said.
TEST(Hints, NameANumberThatIsAThousandTimesOff) {
  const auto said = [](const Overrides& overrides) {
    const Sentences all = hints(scene_of(kStiffWall, overrides));
    return all.empty() ? "" : all[0];
  };
  EXPECT_EQ(said({"device.mass_kg=75"}), "device.mass_kg is 75; masses are in kilograms, and 75 g are 0.075");
  EXPECT_EQ(said({"robot.mass_kg=500"}), "robot.mass_kg is 500; masses are in kilograms, and 500 g are 0.5");
  EXPECT_EQ(said({"robot.mass_kg=0.0005"}), "robot.mass_kg is 0.0005; masses are in kilograms, and 0.0005 t are 0.5");
  EXPECT_EQ(said({"operator.hand.stiffness_n_per_m=0.4"}),
            "operator.hand.stiffness_n_per_m is 0.4; stiffnesses are in N/m, and 0.4 N/mm are 400");
  EXPECT_EQ(said({"environment[0].wall.stiffness_n_per_m=5"}),
            "environment[0].wall.stiffness_n_per_m is 5; stiffnesses are in N/m, and 5 N/mm are 5000");
  EXPECT_EQ(said({"environment[0].wall.stiffness_n_per_m=5e6"}),
            "environment[0].wall.stiffness_n_per_m is 5e+06; stiffnesses are in N/m, and 5e+06 mN/m are 5000");
  EXPECT_EQ(said({"control.virtual_coupling.stiffness_n_per_m=1"}),
            "control.virtual_coupling.stiffness_n_per_m is 1; stiffnesses are in N/m, and 1 N/mm are 1000");
  EXPECT_EQ(said({"device.max_force_n=8500"}),
            "device.max_force_n is 8500; forces are in newtons, and 8500 mN are 8.5");
  EXPECT_EQ(said({"control.device_limits.force_n=0.008"}),
            "control.device_limits.force_n is 0.008; forces are in newtons, and 0.008 kN are 8");
  EXPECT_EQ(said({"control.robot_limits.speed_m_per_s=250"}),
            "control.robot_limits.speed_m_per_s is 250; speeds are in m/s, and 250 mm/s are 0.25");
  EXPECT_EQ(said({"operator.hand.mass_kg=90"}),
            "operator.hand.mass_kg is 90; masses are in kilograms, and 90 g are 0.09");
  EXPECT_EQ(said({"control.device_limits.speed_m_per_s=500"}),
            "control.device_limits.speed_m_per_s is 500; speeds are in m/s, and 500 mm/s are 0.5");
  EXPECT_EQ(said({"control.robot_limits.force_n=9000"}),
            "control.robot_limits.force_n is 9000; forces are in newtons, and 9000 mN are 9");
  EXPECT_EQ(hints(scene_of("dof: 6 duration_s: 1 operator {} device { mass_kg: 0.1 inertia_kg_m2: 0.1 } robot { "
                           "mass_kg: 1 inertia_kg_m2: 60 }"))
                .at(0),
            "robot.inertia_kg_m2 is 60; inertias are in kg m², and 60 g m² are 0.06");
  // Of a tool by its mass.
  const auto of_tool = [](const std::string& inertia) {
    const Sentences all = hints(scene_of("dof: 6 duration_s: 1 robot { mass_kg: 2 inertia_kg_m2: " + inertia +
                                         " } control { architecture: UNCONTROLLED }"));
    return all.empty() ? "" : all[0];
  };
  EXPECT_EQ(
      of_tool("[2, 3, 4]"),
      "robot.inertia_kg_m2 is 2, of 2 kg that are 1 m from the axis; inertias are in kg m², and 2 g m² are 0.002");
  EXPECT_EQ(of_tool("2e-6"),
            "robot.inertia_kg_m2 is 2e-06, of 2 kg that are 0.001 m from the axis; inertias are in kg m², and 2e-06 t "
            "m² are 0.002");
  EXPECT_EQ(of_tool("[2e-3, 3e-3, 4e-3]"), "");
  for (const char* usual : {"device.mass_kg=0.01", "device.mass_kg=5", "robot.mass_kg=0.05", "robot.mass_kg=80",
                            "environment[0].wall.stiffness_n_per_m=50", "environment[0].wall.stiffness_n_per_m=1e6",
                            "environment[0]={spring { stiffness_n_per_m: 0.5 }}", "control.robot_limits.force_n=500",
                            "control.robot_limits.speed_m_per_s=2", "control.virtual_coupling.stiffness_n_per_m=0"})
    EXPECT_EQ(said({usual}), "") << usual;
}

TEST(Hints, SayThatATheHandleOrTheToolStartsInside) {
  const auto wall = [](double offset_m) { return "environment[0].wall.offset_m=" + std::to_string(offset_m); };
  EXPECT_EQ(hints(scene_of(kStiffWall, {wall(0.005)})),
            Sentences{"robot.position_m is 5 mm inside environment[0].wall, which pushes it out before anything is "
                      "coupled"});
  EXPECT_EQ(hints(scene_of(kStiffWall, {wall(-1e-4)})), Sentences{});
  EXPECT_EQ(hints(scene_of(kStiffWall, {wall(5e-5)})), Sentences{}) << "it rests there";
  const std::string rendered =
      "dof: 3 duration_s: 1 rate_hz: 1000 operator {} device { mass_kg: 0.1 position_m: [0.1, 0, 0] } control { "
      "architecture: RENDER passivity { method: NONE } } environment { sphere { center_m: [0, 0, 0] radius_m: 0.103 "
      "stiffness_n_per_m: 1000 } }";
  EXPECT_EQ(hints(scene_of(rendered)),
            Sentences{"device.position_m is 3 mm inside environment[0].sphere, which pushes it out before anything is "
                      "coupled"});
  EXPECT_EQ(hints(scene_of(rendered), false), Sentences{}) << "a real handle is where it is";
  EXPECT_EQ(hints(scene_of(rendered, {"environment[0].sphere.radius_m=0.09"})), Sentences{});
}

TEST(Hints, SayWhatOfAMeshIsLeftOut) {
  const Folder folder;
  folder.write("lab.textproto", kStiffWall);
  std::string file = obj(box_mesh({1, 1, 1})) + "f 1 1 2\nf 2 2 3\n";
  const auto said = [&] {
    folder.write("part.obj", file);
    return hints(load_scene(folder / "lab.textproto",
                            Overrides{"environment[0]={mesh { file: \"part.obj\" scale: 0.01 position_m: [0.5, 0, 0] "
                                      "stiffness_n_per_m: 500 }}"}));
  };
  EXPECT_EQ(said(), Sentences{folder / "part.obj" + ": 2 triangles without area are left out"});
  file = obj(box_mesh({1, 1, 1}));
  EXPECT_EQ(said(), Sentences{});
}

TEST(Hints, NameTheLayerThatPassesOnTheEnergyOfAMovingEnvironment) {
  const Overrides moving{
      "environment=[{spring: {stiffness_n_per_m: 500 anchor_motion: {axis: 0 amplitude_m: 0.01 frequency_hz: 0.7}}}]",
      "control.architecture=POSITION_FORCE"};
  const auto with = [&](const char* layer) {
    Overrides all = moving;
    all.push_back(std::string{"control.passivity.layer="} + layer);
    return hints(scene_of(kStiffWall, all));
  };
  ASSERT_EQ(with("ENERGY_SPRING").size(), 1U);
  EXPECT_TRUE(says(with("ENERGY_SPRING")[0], {"environment[0].spring.anchor_motion", "ENERGY_SPRING_TWO_PORT"}));
  EXPECT_EQ(with("ENERGY_SPRING_TWO_PORT"), Sentences{});
}

TEST(Hints, SayThatNobodyHoldsAHandleOverALink) {
  const std::string free = "dof: 1 duration_s: 1 device { mass_kg: 1 } control { passivity { method: CLASSIC } }";
  EXPECT_EQ(hints(scene_of(free)), Sentences{"operator is absent: no hand holds the handle"});
  EXPECT_EQ(hints(scene_of(free, {"operator={}"})), Sentences{});
  // A real device is in somebody's hand. What else there is to say is said of any.
  EXPECT_EQ(hints(scene_of(free), false), Sentences{});
  EXPECT_EQ(hints(scene_of(free, {"device.position_m=30"}), false).size(), 1U);
}

TEST(Hints, SayThatALightRobotOnAStiffSurfaceIsSlowToSimulate) {
  const std::string rough =
      "robot.mass_kg is 3e-06: on a surface of 5000 N/m it swings at 6.5 kHz, too fast for ticks of 2000 Hz";
  const auto said = [](const Overrides& more) {
    Overrides all{"robot.mass_kg=3e-6", "control.virtual_coupling={stiffness_n_per_m: 1 damping_n_s_per_m: 0.005}"};
    all.insert(all.end(), more.begin(), more.end());
    Sentences sentences = hints(scene_of(kStiffWall, all));
    std::erase_if(sentences, [](const std::string& each) { return each.find("stiffnesses are in") != each.npos; });
    return sentences;
  };
  ASSERT_EQ(said({"environment[0].wall.friction=0.3"}).size(), 1U);
  EXPECT_TRUE(said({"environment[0].wall.friction=0.3"})[0].starts_with(rough))
      << said({"environment[0].wall.friction=0.3"})[0];
  EXPECT_NE(said({"environment[0].wall.friction=0.3"})[0].find("use 0.00031 kg or more"), std::string::npos);
  EXPECT_EQ(said({"environment[0].wall.friction=0.3", "robot.mass_kg=0.00032"}), Sentences{});
  EXPECT_EQ(said({}), Sentences{}) << "a wall without friction is solved in closed form";
  EXPECT_EQ(said({"environment[0].wall.friction=0.3", "simulation.integrator=RK4"}), Sentences{}) << "it has its steps";
}

// 200 N/s at 1 kHz: 0.1 N.
TEST(Hints, SayWhatALimitOfRateLeavesOfAStrictTwoPort) {
  const auto of = [](const std::string& more) {
    return hints(
        scene_of("dof: 1 duration_s: 1 rate_hz: 1000 operator {} device { mass_kg: 1 } control { passivity { method: "
                 "INTERNAL_MODEL internal_model { strict_two_port: true } } " +
                 more + " }"));
  };
  EXPECT_EQ(
      of("robot_limits { force_rate_n_per_s: 200 }"),
      Sentences{
          "control.robot_limits.force_rate_n_per_s and the passivity layer ENERGY_SPRING_TWO_PORT together leave a "
          "force of at most 0.1 N: what may not fall at once is not shown"});
  EXPECT_EQ(of("device_limits { force_rate_n_per_s: 50000 }"), Sentences{});
}

// K T²/m above 0.05: 5000 N/m and 75 g are there below 1155 Hz.
TEST(Hints, SayThatAProjectedForceIsTooSlowForAHandle) {
  const std::string scene =
      "dof: 1 duration_s: 1 operator {} device { mass_kg: 0.075 } control { architecture: RENDER passivity { method: "
      "FORCE_PROJECTED } } environment { wall { normal: [-1] offset_m: 0 stiffness_n_per_m: 5000 } } rate_hz: ";
  EXPECT_EQ(hints(scene_of(scene + "1000")),
            Sentences{"rate_hz is 1000: FORCE_PROJECTED may let energy pass at a rendered 5000 N/m with a handle of "
                      "0.075 kg, as the handle turns back within a tick; it holds from about 1155 Hz"});
  EXPECT_EQ(hints(scene_of(scene + "1160")), Sentences{});
  EXPECT_EQ(hints(scene_of(scene + "1000", {"control.passivity.method=CLASSIC"})), Sentences{});
}

// Known boundaries of a mass m on a sampled spring-damper: B = 2m/T and, with no damping of its own, B = KT/2.
TEST(Hints, SayThatTheCouplingAloneMakesTheRobotUnstable) {
  const std::string scene =
      "dof: 1 duration_s: 1 rate_hz: 1000 operator {} device { mass_kg: 0.1 } robot { mass_kg: 0.5 damping_n_s_per_m: "
      "0 }";
  const auto count = [&](double stiffness, double damping, double own = 0.0) {
    return hints(scene_of(scene, {"control.virtual_coupling.stiffness_n_per_m=" + std::to_string(stiffness),
                                  "control.virtual_coupling.damping_n_s_per_m=" + std::to_string(damping),
                                  "robot.damping_n_s_per_m=" + std::to_string(own)}))
        .size();
  };
  EXPECT_EQ(count(1000.0, 999.0), 0U);
  EXPECT_EQ(count(1000.0, 1001.0), 1U);
  EXPECT_EQ(count(20000.0, 10.1), 0U);
  EXPECT_EQ(count(20000.0, 9.9), 1U);
  EXPECT_EQ(count(20000.0, 9.9, 1.0), 0U);
  EXPECT_EQ(count(0.0, 0.0), 0U);
  EXPECT_EQ(hints(scene_of(scene, {"control.virtual_coupling.damping_n_s_per_m=2000"})),
            Sentences{"control.virtual_coupling makes the robot unstable, whatever the link does: robot.mass_kg 0.5 on "
                      "1000 N/m at 1000 Hz needs a damping between about 0.5 and 1e+03 N s/m, and damping_n_s_per_m is "
                      "2000"});
}

// 1e-3 kg m² at 100 Hz: B_r < 2 J/T = 0.2 N m s/rad.
TEST(Hints, SayThatTheVirtualCouplingTurnsTheRobot) {
  const std::string scene =
      "dof: 6 duration_s: 1 rate_hz: 100 operator {} device { mass_kg: 0.1 inertia_kg_m2: 1e-4 } robot { mass_kg: 2 "
      "inertia_kg_m2: [2e-3, 1e-3, 2e-3] } control { virtual_coupling { stiffness_n_per_m: 500 damping_n_s_per_m: 20 "
      "rotational_stiffness_n_m_per_rad: 2 rotational_damping_n_m_s_per_rad: ";
  EXPECT_EQ(hints(scene_of(scene + "0.19 } }")), Sentences{});
  EXPECT_EQ(hints(scene_of(scene + "0.21 } }")),
            Sentences{"control.virtual_coupling makes the robot unstable, whatever the link does: robot.inertia_kg_m2 "
                      "0.001 on 2 N m/rad at 100 Hz needs a damping between about 0.01 and 0.2 N m s/rad, and "
                      "rotational_damping_n_m_s_per_rad is 0.21"});
}

// A damper alone is held by the robot's own damping b up to b (1 + a)/(1 - a), a = e^(-bT/m): 30.05 for b = 30, m = 5 g, T = 1 ms.
TEST(Hints, CountTheRobotsOwnDamping) {
  const auto count = [&](const char* own, const char* damping) {
    return hints(scene_of("dof: 1 duration_s: 1 rate_hz: 1000 operator {} device { mass_kg: 0.1 } robot { mass_kg: "
                          "0.005 } control { "
                          "virtual_coupling { stiffness_n_per_m: 0 } }",
                          {std::string{"robot.damping_n_s_per_m="} + own,
                           std::string{"control.virtual_coupling.damping_n_s_per_m="} + damping}))
        .size();
  };
  EXPECT_EQ(count("30", "30.1"), 0U);
  EXPECT_EQ(count("30", "30.3"), 1U);
  EXPECT_EQ(count("0", "9.9"), 0U);
  EXPECT_EQ(count("0", "10.1"), 1U);
}

TEST(Hints, SayWhichOptionVoidsTheClaimOfALayer) {
  const std::string scene = "dof: 1 duration_s: 1 operator {} device { mass_kg: 1 damping_n_s_per_m: 0.05 } control { ";
  const auto of = [&](const std::string& control) { return scene_of(scene + control + " }"); };
  const Scene rectangle = of("passivity { layer: ENERGY_SPRING observer: RECTANGLE }");
  const std::string why =
      "control.passivity.observer is RECTANGLE, which misses energy: ENERGY_SPRING does not keep its claim; EXACT does";
  EXPECT_EQ(hints(rectangle), Sentences{why});
  EXPECT_EQ(claim_that_holds(rectangle), "none: " + why);

  const Scene stated = of("passivity { method: ENERGY_BOUNDING energy_bounding { damping_n_s_per_m: 5 } }");
  EXPECT_EQ(hints(stated), Sentences{"control.passivity.energy_bounding states more damping than the device has"});
  const Scene slow = of("device_limits { force_rate_n_per_s: 100 }");
  ASSERT_EQ(hints(slow).size(), 1U);
  EXPECT_TRUE(says(hints(slow)[0], {"control.device_limits.force_rate_n_per_s is 100", "ENERGY_SPRING"}))
      << hints(slow)[0];
  EXPECT_TRUE(claim_that_holds(slow).starts_with("none: "));

  for (const auto& [control, claim] :
       {std::pair{"passivity { method: INTERNAL_MODEL }", "hand"},
        {"passivity { method: FORCE_PROJECTED }", "hand, both"},
        {"passivity { method: ENERGY_BOUNDING energy_bounding { damping_n_s_per_m: 0.05 } }", "hand"},
        {"passivity { method: NONE observer: RECTANGLE }", "none"},
        {"passivity { method: NONE } schedule { at_s: 1 passivity { method: INTERNAL_MODEL } }", "none"}}) {
    EXPECT_EQ(hints(of(control)), Sentences{}) << control;
    EXPECT_EQ(claim_that_holds(of(control)), claim) << control;
  }
  EXPECT_EQ(claim_that_holds(scene_of(kHeldSpring)), "") << "without a link";
}

TEST(Hints, SayThatADelayedLinkWithoutPassivityControlMayBeUnstable) {
  const Sentences expected{
      "control.passivity.method is NONE and the link delays: the loop may be unstable; INTERNAL_MODEL, the "
      "default, holds it"};
  EXPECT_EQ(hints(scene_of(kStiffWall, {"control.passivity.method=NONE"})), expected);
  EXPECT_EQ(hints(scene_of("dof: 1 duration_s: 1 control { passivity { method: NONE } } to_master { jitter_ms: 1 }")),
            expected);
  // Who expects it needs no hint; without a delay there is nothing to hint at.
  EXPECT_EQ(hints(scene_of(kStiffWall, {"control.passivity.method=NONE", "expect.stable=false"})), Sentences{});
  EXPECT_EQ(hints(scene_of("dof: 1 duration_s: 1")), Sentences{});
}

}  // namespace
}  // namespace twoport::test::hints_test
