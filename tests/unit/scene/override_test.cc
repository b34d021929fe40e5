#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/unit/scene/scenes.h"

namespace twoport::test::override_test {
namespace {

TEST(Override, SetsNumbersChoicesFlagsListsAndStrings) {
  const Scene s = scene_of(
      kStiffWall, {"to_slave.delay_ms=12.5", "control.passivity.method = CLASSIC", "control.passivity.predict=false",
                   "environment[0].wall.normal=[0, 1, 0]", "dof=3", "seed=99", "name=\"of another name\""});
  EXPECT_EQ(s.to_slave.delay_s, 0.0125);
  EXPECT_EQ(s.control.controller.method, Method::classic);
  EXPECT_FALSE(s.control.controller.predict);
  EXPECT_EQ(shape_of<Wall>(s.environment[0]).normal, Vector3d(0, 1, 0));
  EXPECT_EQ(s.seed, 99U);
  EXPECT_EQ(s.name, "of another name");
}

TEST(Override, SetsLinkedPathsTogether) {
  const Scene s = scene_of(kStiffWall, {"to_slave.delay_ms , to_master.delay_ms=12.5"});
  EXPECT_EQ(s.to_slave.delay_s, 0.0125);
  EXPECT_EQ(s.to_master.delay_s, 0.0125);
}

TEST(Override, OfLinkedPathsNamesTheOneThatIsWrong) {
  const auto error = [](const std::string& linked) { return error_of(kStiffWall, {linked}); };
  EXPECT_NE(error("to_slave.delay_ms,to_master.delay=1").find("override to_master.delay=1: no field \"delay\""),
            std::string::npos);
  EXPECT_NE(error("to_slave.delay_ms,,dof=1").find("a path is empty"), std::string::npos);
  EXPECT_NE(error("dof,dof=1").find("dof is named twice"), std::string::npos);
}

TEST(Override, TakesAStringWithoutItsQuotes) {
  EXPECT_EQ(scene_of(kStiffWall, {"name=plain = name"}).name, "plain = name");
}

TEST(Override, CreatesTheBlocksOnTheWay) {
  const Scene s = scene_of("dof: 3 duration_s: 1", {"operator.hand.mass_kg=0.3", "control.passivity.observer=RECTANGLE",
                                                    "robot.mass_kg=2", "robot.force_sensor.noise_n=0.1"});
  EXPECT_EQ(s.operator_model->hand->mass_kg, 0.3);
  EXPECT_EQ(s.control.observer, ObserverRule::rectangle);
  EXPECT_EQ(s.robot->force_sensor->noise_n, 0.1);
}

TEST(Override, AnIndexPastTheEndAppends) {
  const Scene s = scene_of(kStiffWall, {"environment[1].spring.stiffness_n_per_m=3",
                                        "environment[2]={wall {normal: [1, 0, 0] stiffness_n_per_m: 4}}",
                                        "device.position_m[0]=1", "device.position_m[1]=2", "device.position_m[2]=3"});
  ASSERT_EQ(s.environment.size(), 3U);
  EXPECT_EQ(std::get<Spring>(s.environment[1]).stiffness_n_per_m, 3.0);
  EXPECT_EQ(material_of(s.environment[2]).stiffness_n_per_m, 4.0);
  EXPECT_EQ(s.device->position_m, (Numbers{1, 2, 3}));
}

TEST(Override, ReplacesOneElementInItsPlace) {
  const Scene s =
      scene_of(kStiffWall, {"operator.path[0]={hold {duration_s: 3}}", "operator.path[0].move_to={duration_s: 2}",
                            "device.position_m=[1, 2, 3]", "device.position_m[1]=5"});
  ASSERT_EQ(s.operator_model->path.size(), 3U);
  EXPECT_EQ(std::get<MoveToSpec>(s.operator_model->path[0]).duration_s, 2.0);
  EXPECT_TRUE(std::holds_alternative<SineSpec>(s.operator_model->path[1]));
  EXPECT_EQ(s.device->position_m, (Numbers{1, 5, 3}));
}

TEST(Override, ReplacesAWholeBlockAndAWholeList) {
  const Scene s = scene_of(kStiffWall, {"device={mass_kg: 9}", "operator.path=[{hold {duration_s: 5}}]"});
  EXPECT_EQ(s.device->mass_kg, 9.0);
  EXPECT_EQ(s.device->damping_n_s_per_m, 0.0);
  EXPECT_FALSE(s.device->max_force_n);
  ASSERT_EQ(s.operator_model->path.size(), 1U);
  EXPECT_EQ(std::get<HoldSpec>(s.operator_model->path[0]).duration_s, 5.0);
}

TEST(Override, AnotherKindTakesTheOldOnesPlace) {
  const Scene s = scene_of(kStiffWall, {"environment[0].spring.stiffness_n_per_m=3"});
  ASSERT_EQ(s.environment.size(), 1U);
  EXPECT_EQ(std::get<Spring>(s.environment[0]).stiffness_n_per_m, 3.0);
}

TEST(Override, OfABlockThatIsNotThereSaysSoWhereAFieldIsMissing) {
  const std::string few = "dof: 3 duration_s: 1";
  for (const std::string added : {"environment[0].wall.stiffness_n_per_m=5", "robot.damping_n_s_per_m=1"}) {
    const std::string e = error_of(few, {"seed=2", added});
    EXPECT_NE(e.find(" is missing; "), std::string::npos) << e;
    EXPECT_NE(e.find(" is not in the file, override " + added + " adds it"), std::string::npos) << e;
  }
  const std::string replaced = error_of(kStiffWall, {"environment[0].sphere.radius_m=1"});
  EXPECT_NE(replaced.find("environment[0].sphere is not in the file, override"), std::string::npos) << replaced;
  EXPECT_EQ(error_of(few, {"environment[0].wall={normal: [1, 0, 0] stiffness_n_per_m: -1}"}).find("adds it"),
            std::string::npos)
      << "nothing is missing";
}

TEST(Override, TheLastOneWins) {
  EXPECT_EQ(scene_of(kStiffWall, {"to_slave.delay_ms=1", "to_slave.delay_ms=2"}).to_slave.delay_s, 0.002);
}

struct Unusable {
  const char* assignment;
  std::vector<std::string> words;
};

class UnusableOverride : public ::testing::TestWithParam<Unusable> {};

TEST_P(UnusableOverride, NamesPathValueAndWhatIsAllowed) {
  const std::string e = error_of(kStiffWall, {GetParam().assignment});
  EXPECT_TRUE(e.starts_with(std::string{"override "} + GetParam().assignment + ": ")) << e;
  EXPECT_TRUE(says(e, GetParam().words));
}

TEST(Override, IsRefusedInOneLineWhateverStandsInIt) {
  for (const char* assignment : {"\nJ", "dof=\n\t\"", "a\x1b[2J\n=1", "robot={\n mas_kg: 1\n}"}) {
    const std::string e = error_of(kStiffWall, {assignment});
    EXPECT_FALSE(e.empty()) << assignment;
    EXPECT_EQ(e.find_first_of("\n\t\x1b"), std::string::npos) << e;
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, UnusableOverride,
    ::testing::Values(
        Unusable{"dof", {"has no \"=\"", "PATH=VALUE", "as in dof=VALUE"}},
        Unusable{"to_slave { delay_ms: 3 }", {"as in to_slave={ delay_ms: 3 }"}},
        Unusable{"device.mass_kg: 0.1", {"as in device.mass_kg=0.1"}},
        Unusable{"device.mass_kg 0.1", {"as in device.mass_kg=0.1"}},
        Unusable{"{ delay_ms: 3 }", {"as in to_slave.delay_ms={"}},
        Unusable{"to_slave.delay_ms=12,5", {"must be a number; a decimal separator is a point"}},
        Unusable{"device.position_m=1,5", {"must be a list [...], each a number; a decimal separator is a point"}},
        Unusable{"=3", {"no field \"\" in a scene"}},
        Unusable{"control.pasivity.method=NONE",
                 {"no field \"pasivity\" in control; it has architecture", "passivity"}},
        Unusable{"environment[0].wal.normal=[1]", {"no field \"wal\" in environment[0]; it has wall, sphere"}},
        Unusable{"control.passivity.method=MAGIC", {"must be one of NONE, CLASSIC, FORCE_PROJECTED"}},
        Unusable{"to_slave.delay_ms=fast", {"must be a number"}}, Unusable{"to_slave.delay_ms=", {"must be a number"}},
        Unusable{"to_slave.delay_ms=[1, 2]", {"must be a number"}}, Unusable{"dof=2.5", {"must be an integer"}},
        Unusable{"seed=-1", {"must be an integer >= 0"}},
        Unusable{"control.passivity.predict=perhaps", {"must be true or false"}},
        Unusable{"robot={mas_kg: 1}", {"must be a block { ... } of mass_kg", "Robot has no field \"mas_kg\""}},
        Unusable{"robot=5", {"must be a block { ... } of mass_kg"}},
        Unusable{"device.position_m=[1, x]", {"must be a list [...], each a number"}},
        Unusable{"device.position_m[0]=[1, 2]", {"must be a number"}},
        Unusable{"device.position_m[0]=[]", {"must be a number"}},
        Unusable{"device.position_m[1]=1", {"device.position_m holds 0; the index must be 0 to append"}},
        Unusable{"environment[2].wall.offset_m=1", {"environment holds 1; the index must be 0, or 1 to append"}},
        Unusable{"environment.wall.offset_m=1", {"environment is a list", "environment[0]"}},
        Unusable{"environment[-1].wall.offset_m=1", {"environment must be followed by an index such as [0]"}},
        Unusable{"environment[0.wall.offset_m=1", {"environment must be followed by an index such as [0]"}},
        Unusable{"environment[0]x.wall.offset_m=1", {"environment must be followed by an index such as [0]"}},
        Unusable{"environment[99999999999].wall.offset_m=1", {"environment must be followed by an index"}},
        Unusable{"device[0].mass_kg=1", {"device is not a list"}},
        Unusable{"dof.x=1", {"dof is an integer and has no fields"}},
        Unusable{"device.mass_kg=1 damping_n_s_per_m: 2", {"must be a number"}},
        Unusable{"dof.=1", {"dof is an integer"}}, Unusable{"device.=1", {"no field \"\" in device"}}));

}  // namespace
}  // namespace twoport::test::override_test
