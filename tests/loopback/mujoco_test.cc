#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/hardware/virtual_robot.h"
#include "common/scene/load.h"
#include "drivers/drivers.h"
#include "tests/support/folder.h"
#include "tests/support/live.h"

// A world of MuJoCo as the robot.
namespace twoport::test::mujoco_test {
namespace {

constexpr Seconds kPeriod{1e-3};

std::string model(const std::string& body, const std::string& more = "") {
  const std::string path = own_folder() / "model.xml";
  write_whole(path, "<mujoco model='test'><option timestep='0.0005' gravity='0 0 0'/><worldbody>" + more +
                        "<body name='tool'>" + body + "</body></worldbody></mujoco>");
  return path;
}
const std::string
    kSphere = "<geom type='sphere' size='0.01' mass='0.5'/>",
    kWall = "<geom type='box' pos='0.05 0 0' size='0.03 0.2 0.2' solref='-3000 -20'/>",
    kSlides = "<joint type='slide' axis='1 0 0'/><joint type='slide' axis='0 1 0'/><joint type='slide' axis='0 0 1'/>";

template <int N>
std::unique_ptr<Robot<N>> open(const std::string& choice) {
  static const Scene scene{};
  return all_drivers().robots.open<N>("mujoco:" + choice, scene, kPeriod);
}
Tick<SlaveClock> tick(long k) {
  return {Instant<SlaveClock>{tick_time(k, 1.0 / kPeriod.si())}, kPeriod};
}
/// The reading after `ticks` under a constant force.
template <int N>
RobotSample<N> after(Robot<N>& robot, int ticks, const typename Force<N>::Vector& f) {
  robot.start();
  RobotCommand<N> command;
  command.f = Force<N>{f};
  for (int k = 0; k < ticks; ++k) {
    robot.actuate(command);
    robot.sense(tick(k));
  }
  return robot.sense(tick(ticks));
}

class Mujoco : public testing::Test {
 protected:
  void SetUp() override {
    if (all_drivers().robots.lines().find("mujoco\tnot in this build") != std::string::npos)
      GTEST_SKIP() << "libmujoco-dev is not installed";
  }
};

TEST_F(Mujoco, SlidesAsNewtonSays) {
  // Semi-implicit Euler: v = f t / m, x = f t (t + h) / 2 m. The last tick is the 101st.
  const double t = 0.101, h = 0.0005;
  const auto three = open<3>(model(kSlides + kSphere));
  const RobotSample<3> s = after<3>(*three, 100, {1.0, -2.0, 0.5});
  EXPECT_LT((s.v.vec() - Eigen::Vector3d{1.0, -2.0, 0.5} * t / 0.5).norm(), 1e-12);
  EXPECT_LT((s.x.translation() - Eigen::Vector3d{1.0, -2.0, 0.5} * t * (t + h)).norm(), 1e-12);
  EXPECT_EQ(s.f_environment.vec().norm(), 0.0);
  // One axis is that of the joint, whatever it is.
  const auto one = open<1>(model("<joint type='slide' axis='0 0.6 -0.8'/>" + kSphere));
  const RobotSample<1> along = after<1>(*one, 100, Force<1>::Vector{1.0});
  EXPECT_NEAR(along.v[0], t / 0.5, 1e-12);
  EXPECT_NEAR(along.x.translation()[0], t * (t + h), 1e-12);
}

TEST_F(Mujoco, TakesAWrenchAtItsSite) {
  // The site is 0.1 m before the centre: a force across it turns the body, 2/5 m r² = 0.02 kg m².
  const std::string body =
      "<freejoint/><geom type='sphere' size='0.31622776601683794' mass='0.5'/><site name='other' pos='0 0 1'/><site "
      "name='tip' pos='0.1 0 0' euler='0 0 90'/>";
  const auto six = open<6>(model(body) + ",site=tip");
  const RobotSample<6> begin = six->sense(tick(0));
  EXPECT_LT((begin.x.translation() - Eigen::Vector3d{0.1, 0.0, 0.0}).norm(), 1e-15);
  EXPECT_NEAR(
      begin.x.attitude().angularDistance(Eigen::Quaterniond{Eigen::AngleAxisd{M_PI / 2.0, Eigen::Vector3d::UnitZ()}}),
      0.0, 1e-7);
  Force<6>::Vector wrench;
  wrench << 0.0, 1.0, 0.0, 0.0, 0.0, 0.05;
  const RobotSample<6> s = after<6>(*six, 9, wrench);
  const double t = 0.01, spin = (0.1 + 0.05) * t / 0.02;
  EXPECT_NEAR(s.v.vec()[5], spin, 1e-5);
  EXPECT_NEAR(s.v.vec()[1], t / 0.5 + 0.1 * spin, 1e-5);
}

TEST_F(Mujoco, FeelsTheContactOnTheTool) {
  const auto robot =
      open<3>(model(kSlides + kSphere + "<geom type='box' pos='0 0 0.1' size='0.01 0.01 0.01' mass='0.1'/>", kWall));
  const RobotSample<3> s = after<3>(*robot, 3000, {5.0, 0.0, 0.0});
  EXPECT_NEAR(s.f_environment.vec().x(), 5.0, 0.01);
  EXPECT_NEAR(s.f_environment.vec().tail<2>().norm(), 0.0, 0.01);
  EXPECT_TRUE(robot->truth()->touches);
  EXPECT_NEAR(s.x.translation().x(), 0.01, 0.003);
}

/// A site on a body that is fixed to the one with the geoms, as models of arms have them.
TEST_F(Mujoco, FeelsTheContactOfABodyThatTheSitesIsWeldedTo) {
  const auto robot =
      open<3>(model(kSlides + kSphere + "<body pos='0 0 0.05'><site name='tip'/></body>", kWall) + ",site=tip");
  const RobotSample<3> s = after<3>(*robot, 3000, {5.0, 0.0, 0.0});
  EXPECT_NEAR(s.f_environment.vec().x(), 5.0, 0.01);
  EXPECT_TRUE(robot->truth()->touches);
}

TEST_F(Mujoco, StartsAtAKeyframe) {
  const std::string path = own_folder() / "key.xml";
  write_whole(path,
              "<mujoco><worldbody><body>" + kSlides + kSphere +
                  "<site name='tip'/></body></worldbody><keyframe><key name='home' qpos='1 2 3'/><key qpos='4 5 6'/>"
                  "</keyframe></mujoco>");
  EXPECT_EQ(open<3>(path)->sense(tick(0)).x.translation(), Eigen::Vector3d::Zero());
  EXPECT_EQ(open<3>(path + ",key=home")->sense(tick(0)).x.translation(), Eigen::Vector3d(1.0, 2.0, 3.0));
  EXPECT_EQ(open<3>(path + ",key=1")->sense(tick(0)).x.translation(), Eigen::Vector3d(4.0, 5.0, 6.0));
  for (const char* order : {",key=home,site=tip", ",site=tip,key=home"})
    EXPECT_EQ(open<3>(path + order)->sense(tick(0)).x.translation(), Eigen::Vector3d(1.0, 2.0, 3.0)) << order;
}

const std::string kNamedSlides =
    "<joint name='x' type='slide' axis='1 0 0' damping='20'/><joint name='y' type='slide' axis='0 1 0' damping='20'/>"
    "<joint name='z' type='slide' axis='0 0 1' damping='20'/>";
std::string with_actuators(const std::string& actuators, const std::string& more = "", const std::string& extra = "") {
  const std::string path = own_folder() / "servos.xml";
  write_whole(path, "<mujoco><option timestep='0.001' gravity='0 0 0'/><worldbody>" + more + "<body name='hand'>" +
                        kNamedSlides +
                        "<geom type='sphere' size='0.02' mass='1'/><site name='tip'/></body></worldbody>" + extra +
                        "<actuator>" + actuators + "</actuator></mujoco>");
  return path;
}
const std::string kServos =
    "<position joint='x' kp='5000'/><position joint='y' kp='5000'/><position joint='z' kp='5000'/>";
/// A coupling of 500 N/m towards `goal` along x, for 4 s.
RobotSample<3> pulled(Robot<3>& robot, double goal) {
  robot.start();
  RobotSample<3> s = robot.sense(tick(0));
  for (int k = 1; k <= 4000; ++k) {
    RobotCommand<3> command;
    command.f = Force<3>{Eigen::Vector3d{500.0 * (goal - s.x.translation().x()) - 20.0 * s.v[0], 0.0, 0.0}};
    robot.actuate(command);
    s = robot.sense(tick(k));
  }
  return s;
}

TEST_F(Mujoco, DrivesPositionServosByTheSetPoint) {
  const auto free = open<3>(with_actuators(kServos));
  pulled(*free, 0.05);
  EXPECT_NEAR(free->tool()->translation().x(), 0.05, 1e-3);
  const auto held = open<3>(with_actuators(kServos, "<geom type='box' pos='0.06 0 0' size='0.01 0.1 0.1'/>"));
  EXPECT_NEAR(pulled(*held, 0.05).f_environment[0], 10.0, 1.5);  // the wall is at 30 mm
  // Controls in other units, from another zero.
  const auto scaled =
      open<3>(with_actuators("<general joint='x' gainprm='5' biastype='affine' biasprm='20 -5000'/>"
                             "<position joint='y' kp='5000'/><position joint='z' kp='5000'/>"));
  pulled(*scaled, 0.05);
  EXPECT_NEAR(scaled->tool()->translation().x(), 0.05, 1e-3);
}
TEST_F(Mujoco, LetsActuatorsGo) {
  const auto robot = open<3>(with_actuators(kServos) + ",actuators=off");
  EXPECT_NEAR(pulled(*robot, 0.05).x.translation().x(), 0.05, 1e-3);
  EXPECT_EQ(robot->tool(), nullptr);
  EXPECT_THROW(open<3>(with_actuators(kServos) + ",actuators=on"), ConfigError);
  // A keyframe's controls are let go too.
  const std::string key = "<keyframe><key name='on' ctrl='0.1 0 0'/></keyframe>";
  const auto at_key = open<3>(with_actuators(kServos, "", key) + ",key=on,actuators=off");
  EXPECT_NEAR(pulled(*at_key, 0.05).x.translation().x(), 0.05, 1e-3);
}
TEST_F(Mujoco, RefusesWhatHoldsTheToolAndIsNoServo) {
  EXPECT_THROW(open<3>(with_actuators("<velocity joint='y' kv='50'/>")), ConfigError);
  EXPECT_THROW(open<3>(with_actuators("<position joint='x' kp='5000'/>")), ConfigError);
  EXPECT_NO_THROW(open<3>(with_actuators("<motor joint='x'/>")));
  EXPECT_THROW(open<3>(with_actuators("", "", "<equality><connect body1='hand' anchor='0 0 0'/></equality>")),
               ConfigError);
}
TEST_F(Mujoco, MovesAMocapBodyThatIsWeldedToTheTool) {
  const auto robot = open<3>(with_actuators("", "<body name='goal' mocap='true'/>",
                                            "<equality><weld body1='goal' body2='hand' solref='0.01 1'/></equality>"));
  pulled(*robot, 0.05);
  EXPECT_NEAR(robot->tool()->translation().x(), 0.05, 2e-3);
  // One that is held beside the tool, and turned.
  const auto beside =
      open<3>(with_actuators("", "<body name='goal' mocap='true' pos='0.02 0.1 0.2' quat='0.8 0 0 0.6'/>",
                             "<equality><weld body1='goal' body2='hand' solref='0.01 1'/></equality>"));
  pulled(*beside, 0.05);
  EXPECT_LT((beside->tool()->translation() - Eigen::Vector3d{0.05, 0.0, 0.0}).norm(), 2e-3);
}
/// Wherever the file puts the mocap body: the weld pulls at nothing until the hand moves.
TEST_F(Mujoco, StartsAWeldedToolAtRestAtAKeyframe) {
  const std::string path = own_folder() / "welded.xml";
  for (const char* weld : {"body1='goal' body2='hand'", "body1='hand' body2='goal'",
                           "body1='goal' body2='hand' relpose='0.1 0 0.2 0.8 0 0 0.6' anchor='0 0.1 0'",
                           "body1='hand' body2='goal' relpose='0.1 0 0.2 0.8 0 0 0.6' anchor='0 0.1 0'"}) {
    write_whole(path,
                "<mujoco><option timestep='0.001' gravity='0 0 0'/><worldbody><body name='goal' mocap='true' pos='0.02 "
                "0.1 0.2' quat='0.8 0 0.6 0'/><body name='hand'><freejoint/><geom type='sphere' size='0.02' mass='1'/>"
                "<site name='tip' pos='0 0 0.1'/></body></worldbody><equality><weld " +
                    std::string{weld} +
                    " solref='0.01 1'/></equality><keyframe><key name='up' qpos='0.3 0.2 1 0.6 0 0.8 0'/></keyframe>"
                    "</mujoco>");
    const auto robot = open<6>(path + ",key=up");
    const RobotSample<6> begin = robot->sense(tick(0));
    after<6>(*robot, 300, Force<6>::Vector::Zero());
    EXPECT_LT((robot->tool()->translation() - begin.x.translation()).norm(), 1e-9) << weld;
    EXPECT_LT(robot->tool()->attitude().angularDistance(begin.x.attitude()), 1e-7) << weld;
  }
}
/// Another arm, whose keyframe has no controls, would run to 0.
TEST_F(Mujoco, HoldsOtherServosWhereAKeyframeWithoutControlsPutsThem) {
  const std::string other =
      "<body name='other'><joint name='o' type='slide' axis='1 0 0' damping='20'/><geom type='sphere' "
      "size='0.02' mass='1'/></body>";
  const auto robot = [&](const std::string& controls) {
    return open<3>(with_actuators(kServos + "<position joint='o' kp='5000'/>", other,
                                  "<keyframe><key name='home' qpos='0.3 0 0 0'" + controls + "/></keyframe>") +
                   ",site=tip,key=home");
  };
  const auto held = robot("");
  after<3>(*held, 500, {0.0, 0.0, 0.0});
  EXPECT_FALSE(held->truth()->touches);
  const auto told = robot(" ctrl='0 0 0 0.001'");
  after<3>(*told, 500, {0.0, 0.0, 0.0});
  EXPECT_TRUE(told->truth()->touches);
}
/// Position and velocity belong together at any rate and step.
TEST_F(Mujoco, FollowsTheClockAtAnyRateAndStep) {
  for (const double rate : {1000.0, 100.0, 20.0})
    for (const char* step : {"0.0005", "0.0101", "0.02"}) {
      const std::string path = own_folder() / "clock.xml";
      write_whole(path, "<mujoco><option gravity='0 0 0' timestep='" + std::string{step} + "'/><worldbody><body>" +
                            kSlides + kSphere + "</body></worldbody></mujoco>");
      const auto robot = open<3>(path);
      robot->start();
      dynamic_cast<VirtualRobot<3>&>(*robot).kick(Velocity<3>{Eigen::Vector3d::UnitX()});
      const Seconds dt{1.0 / rate};
      const long ticks = std::lround(2.0 * rate);
      for (long k = 0; k < ticks; ++k) robot->sense({Instant<SlaveClock>{tick_time(k, rate)}, dt});
      EXPECT_NEAR(robot->sense({Instant<SlaveClock>{tick_time(ticks, rate)}, dt}).x.translation().x(), 2.0 + dt.si(),
                  0.021)
          << rate << " Hz, step " << step;
    }
}
TEST_F(Mujoco, NamesItsVersionWhereItCannotRead) {
  const std::string path = own_folder() / "newer.xml";
  write_whole(path, "<mujoco><newer/></mujoco>");
  try {
    open<3>(path);
    FAIL();
  } catch (const ConfigError& e) {
    EXPECT_NE(std::string{e.what()}.find("MuJoCo 2"), std::string::npos) << e.what();
  }
}

TEST_F(Mujoco, ThatHasNoRoomForItsContactsIsAFault) {
  const std::string path = own_folder() / "full.xml";
  write_whole(
      path,
      "<mujoco><size nconmax='1' njmax='100'/><worldbody><geom type='plane' size='1 1 1'/><body pos='0 0 0.0099'>" +
          kSlides + "<geom type='box' size='0.1 0.1 0.01' mass='1'/></body></worldbody></mujoco>");
  const auto robot = open<3>(path);
  const RobotSample<3> s = after<3>(*robot, 10, {0.0, 0.0, -1.0});
  EXPECT_EQ(s.status, HardwareStatus::fault);
  EXPECT_NE(robot->trouble().find("nconmax"), std::string::npos) << robot->trouble();
}

/// Largest and least corners of what stands still, and of the tool in axes of its site.
TEST_F(Mujoco, ShowsWhatItsViewerShows) {
  const std::string path = own_folder() / "shown.xml";
  write_whole(path,
              "<mujoco><asset><mesh name='wedge' vertex='0 0 0 1 0 0 0 1 0 0 0 1'/></asset><worldbody>"
              "<geom type='box' pos='0.5 0 0' size='0.1 0.2 0.3'/><geom type='sphere' pos='9 9 9' size='1' group='4'/>"
              "<body pos='3 3 3'><geom type='sphere' size='1'/><freejoint/></body>"
              "<body pos='0 0 1'>" +
                  kSlides +
                  "<geom type='capsule' size='0.01 0.05'/><geom type='cylinder' pos='0 0 0.2' size='0.02 0.03'/>"
                  "<geom type='mesh' mesh='wedge' pos='-2 0 0'/><site name='tip' pos='0 0 0.1' euler='180 0 0'/></body>"
                  "</worldbody></mujoco>");
  const auto opened = open<3>(path);
  const WorldPicture all = dynamic_cast<const VirtualRobot<3>&>(*opened).picture();
  const auto box_of = [](const TriangleMesh& mesh) {
    Eigen::AlignedBox3d box;
    for (const Eigen::Vector3d& v : mesh.vertices) box.extend(v);
    return box;
  };
  const Eigen::AlignedBox3d still = box_of(all.still), tool = box_of(all.tool);
  EXPECT_LT((still.min() - Eigen::Vector3d(0.4, -0.2, -0.3)).norm(), 1e-9);
  EXPECT_LT((still.max() - Eigen::Vector3d(0.6, 0.2, 0.3)).norm(), 1e-9);
  // The site looks down: the capsule's end at -0.06 m of the body is at 0.16 m, the cylinder's at 0.23 m at -0.13 m.
  EXPECT_NEAR(tool.max().z(), 0.16, 1e-9);
  EXPECT_LT(tool.min().z(), -0.13 + 1e-9);
  EXPECT_NEAR(tool.min().x(), -2.0, 0.3);
  EXPECT_EQ(faults_of(all.still).odd_edges, 0U);
  EXPECT_GT(faults_of(all.still).volume_m3, 0.0);
}

TEST_F(Mujoco, LetsGoWithoutCommands) {
  const auto robot = open<3>(model(kSlides + kSphere));
  after<3>(*robot, 10, {1.0, 0.0, 0.0});
  for (int k = 0; k < 200; ++k) robot->sense(tick(k));
  const double v = robot->sense(tick(0)).v.vec().x();
  EXPECT_EQ(robot->sense(tick(0)).v.vec().x(), v);
  EXPECT_NEAR(v, (0.009 + 0.1) / 0.5, 0.003);  // nine periods, then the watchdog's
}

TEST_F(Mujoco, RefusesModelsInWords) {
  const auto why_not = [](const std::string& choice) -> std::string {
    try {
      open<3>(choice);
    } catch (const ConfigError& e) {
      return e.what();
    }
    return "opened";
  };
  const auto expect = [&](const std::string& choice, const std::string& words) {
    const std::string error = why_not(choice);
    EXPECT_NE(error.find(words), std::string::npos) << error;
    EXPECT_EQ(error.find("--robot mujoco:"), 0U) << error;
  };
  expect("", "name a model");
  expect("nowhere.xml", "nowhere.xml: there is no such file; give the path of a model in MJCF or URDF");
  expect("/tmp", "there is no such file");
  expect(model("<joint type='slide'"), " cannot read it: XML");
  expect(model("<joint type='slide'/>" + kSphere + ""), "move the tool in 1 directions; a scene with dof 3 needs 3");
  expect(model(kSlides + kSphere) + ",site=tip", "the model has no sites");
  expect(model(kSlides + kSphere + "<site name='a'/><site name='b'/>"), "the model has the sites a, b; add ,site=NAME");
  expect(model(kSlides + kSphere + "<site name='a'/><site name='b'/>") + ",site=c", "no site \"c\"; there are a, b");
  expect(model(kSlides + kSphere) + ",key=home", "the model has no keyframes");
  const std::string keys = own_folder() / "keys.xml", wide = own_folder() / "wide.xml";
  write_whole(keys, "<mujoco><worldbody><body>" + kSlides + kSphere +
                        "</body></worldbody><keyframe><key name='home'/><key/></keyframe></mujoco>");
  for (const char* key : {"away", "2"})
    expect(keys + ",key=" + key,
           "no keyframe \"" + std::string{key} + "\"; there are 2, by name or number from 0: home, 1");
  write_whole(wide, std::string{"\xFF\xFE<\0m\0", 6});
  expect(wide, "wide.xml: is in UTF-16; save it as UTF-8");
  for (const char* fixed : {"damping='1e11'", "armature='1e11'", "stiffness='1e11'"})
    expect(model("<joint type='slide' axis='1 0 0' " + std::string{fixed} +
                 "/><joint type='slide' axis='0 1 0'/><joint type='slide' axis='0 0 1'/>" + kSphere),
           "move the tool in 2 directions; a scene with dof 3 needs 3");
  expect(model(kSphere), "no body of the model moves");
  expect(model(kSphere + "<site name='t'/>"), "move the tool in 0 directions; a scene with dof 3 needs 3");
  expect(model(kSlides + kSphere, "<body><freejoint/><geom size='0.1'/></body>"),
         "several bodies that move; put a site on the tool");
  expect(model(kSlides + kSphere) + ",sites=tip",
         "after the file stand ,site=NAME, ,key=NAME and ,actuators=off, each once and with a name");
  write_whole(
      own_folder() / "slow.xml",
      "<mujoco><option timestep='1'/><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>");
  expect(own_folder() / "slow.xml", "its timestep is 1 s; it must be between 1e-05 and 0.02");
  write_whole(own_folder() / "bad.xml", "<mujoco><worldbody><geom type='ball'/></worldbody></mujoco>");
  expect(own_folder() / "bad.xml", "ball");
}

// Two programs over UDP: the hand leads 10 mm into a wall of MuJoCo and feels what the robot presses.
TEST_F(Mujoco, RunsOverALink) {
  const std::string file = model(kSlides + "<geom type='sphere' size='0.01' mass='0.5'/>", kWall);
  std::string scene = press(3);
  // FORCE_PROJECTED holds a part of a press only.
  const std::string method = "FORCE_PROJECTED";
  scene.replace(scene.find(method), method.size(), "INTERNAL_MODEL");
  const Pair pair{scene};
  Process slave = pair.listening_slave("slave", {"--robot", "mujoco:" + file}), master = pair.master();
  EXPECT_EQ(master.wait(), Exit{.status = 0}) << master.err();
  EXPECT_EQ(slave.wait(), Exit{.status = 0}) << slave.err();
  const schema::Summary m = pair.summary("master"), s = pair.summary("slave");
  EXPECT_GT(m.coupled_share(), 0.8);
  if (!kept_time({m, s})) return;
  const Trace felt = pair.trace("master"), pressed = pair.trace("slave");
  const double at_end = pressed["env_f_0"].back();
  EXPECT_GT(std::abs(at_end), 1.0);
  EXPECT_NEAR(std::abs(felt["master_f_0"].back()), std::abs(at_end), 0.15 * std::abs(at_end));
  EXPECT_GE(m.min_port_energy_j(), -1e-3);
}

}  // namespace
}  // namespace twoport::test::mujoco_test
