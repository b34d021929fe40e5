#include "common/hardware/plugin.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "common/base/check.h"
#include "common/scene/load.h"
#include "drivers/drivers.h"
#include "master/program.h"
#include "tests/support/live.h"

// Drivers in shared libraries: how they are loaded, what they say, and what becomes of their defects.
namespace twoport::test::plugin_test {
namespace {

constexpr Seconds kPeriod{1e-3};
const std::string kOdd = TWOPORT_ODD_PLUGIN, kOld = TWOPORT_OLD_PLUGIN, kGripper = TWOPORT_GRIPPER_PLUGIN,
                  kFirst = TWOPORT_FIRST_PLUGIN, kArm = TWOPORT_ARM_PLUGIN, kNone = TWOPORT_NO_PLUGIN;

/// Of three joints, where the port is joints.
Scene scene_of_joints() {
  Scene scene{};
  scene.joints = 3;
  return scene;
}
template <int N = 3>
std::unique_ptr<Device<N>> open_device(const std::string& choice) {
  static const Scene scene = scene_of_joints();
  return all_drivers().devices.open<N>(choice, scene, kPeriod);
}
template <int N>
std::unique_ptr<Robot<N>> open_robot(const std::string& choice) {
  static const Scene scene = scene_of_joints();
  return all_drivers().robots.open<N>(choice, scene, kPeriod);
}
template <int N = 3>
std::string why_not(const std::string& choice) {
  try {
    open_device<N>(choice);
  } catch (const ConfigError& e) {
    return e.what();
  }
  return "opened";
}
template <class Clock>
Tick<Clock> tick(long k) {
  return {Instant<Clock>{tick_time(k, 1.0 / kPeriod.si())}, kPeriod};
}

// A plug-in that was compiled with other sizes crashes the program: where they change, plugin::kVersion must grow.
static_assert(plugin::kArmVersion == 1 && sizeof(plugin::ArmInfo) == 288 && sizeof(plugin::ArmReading) == 272 &&
              sizeof(plugin::ArmCommand) == 192);
static_assert(plugin::kVersion == 3 && sizeof(plugin::Session) == 24 && sizeof(plugin::DeviceInfo) == 112 &&
              sizeof(plugin::DeviceReading) == 168 && sizeof(plugin::RobotInfo) == 80 &&
              sizeof(plugin::RobotReading) == 160 && sizeof(plugin::RobotCommand) == 152);

TEST(Plugin, IsAPathThatEndsInSoWithOrWithoutArguments) {
  EXPECT_FALSE(plugin_choice("sim"));
  EXPECT_FALSE(plugin_choice("playback:a.sock"));
  EXPECT_EQ(plugin_choice("./a.so")->path, "./a.so");
  EXPECT_EQ(plugin_choice("/b/a.so:1:x.so")->path, "/b/a.so");
  EXPECT_EQ(plugin_choice("/b/a.so:1:x.so")->arguments, "1:x.so");
  EXPECT_EQ(plugin_choice("/b.so/a.so:")->path, "/b.so/a.so");
}

TEST(Plugin, NamesItsCapabilitiesAndPassesNumbersOn) {
  const std::unique_ptr<Device<3>> device = open_device(kOdd);
  const DeviceInfo info = device->info();
  EXPECT_EQ(info.name, "odd plug-in");
  EXPECT_EQ(info.dof, 3);
  EXPECT_EQ(info.max_force_n, 4.0);
  EXPECT_EQ(info.mass_kg, 0.1);
  EXPECT_EQ(info.watchdog, Seconds{0.1});
  EXPECT_EQ(info.buttons, 1);
  device->sense(tick<MasterClock>(0));
  device->actuate(Force<3>{Force<3>::Vector{1.0, 2.0, 3.0}});
  const DeviceSample<3> sample = device->sense(tick<MasterClock>(1));
  EXPECT_EQ(sample.x.translation(), (Eigen::Vector3d{0.005, 0.005, 0.005}));
  EXPECT_EQ(sample.applied.vec(), (Eigen::Vector3d{1.0, 2.0, 3.0}));
  EXPECT_EQ(sample.status, HardwareStatus::ok);
}

TEST(Plugin, OfMoreDegreesOfFreedomDrivesASceneWithFewerAndLeavesTheOthersFree) {
  const std::unique_ptr<Device<1>> device = open_device<1>(kOdd);
  device->actuate(Force<1>{Force<1>::Vector{1.5}});
  EXPECT_EQ(device->sense(tick<MasterClock>(1)).applied[0], 1.5);
  EXPECT_THROW(open_device<6>(kOdd), ConfigError);
}

TEST(Plugin, OfARobotGetsItsSetPoint) {
  const std::unique_ptr<Robot<6>> robot = open_robot<6>(kOdd);
  RobotCommand<6> command;
  command.x_d = Position<6>{{0.1, 0.2, 0.3}, Eigen::Quaterniond{0.6, 0.8, 0.0, 0.0}};
  robot->actuate(command);
  const RobotSample<6> sample = robot->sense(tick<SlaveClock>(1));
  EXPECT_TRUE(sample.ideal);
  EXPECT_EQ(sample.x.translation(), (Eigen::Vector3d{0.1, 0.2, 0.3}));
  EXPECT_EQ(sample.x.attitude().coeffs(), command.x_d.attitude().coeffs());
}

TEST(Plugin, OfVersion1LoadsAndHasNoGripper) {
  const std::unique_ptr<Device<3>> device = open_device(kFirst);
  EXPECT_EQ(device->info().name, "device of version 1");
  EXPECT_EQ(device->gripper(), nullptr);
  device->start();
  device->actuate(Force<3>{Force<3>::Vector{1.0, 0.0, 0.0}});
  EXPECT_EQ(device->sense(tick<MasterClock>(1)).applied[0], 1.0);
  device->release();
  EXPECT_EQ(device->sense(tick<MasterClock>(2)).applied[0], 0.0);
  const std::unique_ptr<Robot<1>> robot = open_robot<1>(kFirst);
  EXPECT_EQ(robot->info().name, "robot of version 1");
  EXPECT_EQ(robot->gripper(), nullptr);
  RobotCommand<1> command;
  command.x_d = Position<1>{Position<1>::Vector{0.1}};
  robot->actuate(command);
  EXPECT_EQ(robot->sense(tick<SlaveClock>(1)).x.translation()[0], 0.1);
}

TEST(Plugin, HasAGripperThatIsHardwareOfOneAxis) {
  const std::unique_ptr<Device<3>> device = open_device(kGripper);
  EXPECT_TRUE(device->info().gripper);
  ASSERT_NE(device->gripper(), nullptr);
  EXPECT_EQ(device->gripper()->info().name, "gripper of a plug-in");
  EXPECT_EQ(device->gripper()->sense(tick<MasterClock>(0)).x.translation()[0], 0.06);
  device->gripper()->actuate(Force<1>{Force<1>::Vector{1.5}});
  EXPECT_EQ(device->gripper()->sense(tick<MasterClock>(1)).applied[0], 1.5);
  device->gripper()->release();
  EXPECT_EQ(device->gripper()->sense(tick<MasterClock>(2)).applied[0], 0.0);
  ASSERT_NE(open_robot<3>(kGripper)->gripper(), nullptr);
  EXPECT_FALSE(open_device(kOdd)->info().gripper);
  EXPECT_EQ(open_device(kOdd)->gripper(), nullptr);
}

TEST(Plugin, WhoseGripperCannotBeTrueIsRefusedInOneSentence) {
  const std::string flag = "--device " + kGripper;
  EXPECT_EQ(why_not(kGripper + ":no_gripper"),
            flag + ":no_gripper: info() says gripper true, but gripper() returns null");
  EXPECT_EQ(why_not(kGripper + ":wide"), flag + ":wide: gripper: info() says dof 3; it must be 1");
  EXPECT_EQ(why_not(kGripper + ":negative"),
            flag + ":negative: gripper: info() says watchdog_s -1; it must be >= 0 and finite");
  EXPECT_EQ(why_not(kGripper + ":itself"),
            flag + ":itself: gripper() returns the hardware itself; it must be another object");
  EXPECT_EQ(why_not(kGripper + ":throws"), flag + ":throws: the gripper does not answer");
  EXPECT_THROW(open_robot<1>(kGripper + ":wide"), ConfigError);
  EXPECT_EQ(open_robot<1>(kGripper + ":no_gripper")->gripper(), nullptr);
}

TEST(Plugin, OfAnArmHasItsJointsLimitsAndSigns) {
  const std::unique_ptr<Device<8>> leader = open_device<8>(kArm + ":still");
  const DeviceInfo info = leader->info();
  EXPECT_EQ(info.name, "odd arm");
  EXPECT_EQ(info.dof, 3);
  EXPECT_EQ(info.watchdog, Seconds{0.1});
  const JointLimits& limits = info.limits.joints;
  EXPECT_EQ(limits.effort[0], 8.0);
  EXPECT_EQ(limits.effort[1], JointLimits::kNone);
  EXPECT_EQ(limits.speed[2], 0.5);
  EXPECT_EQ(limits.lower[2], -0.1);
  EXPECT_EQ(limits.upper[2], 0.1);
  using Vector = Force<8>::Vector;
  const auto three = [](double a, double b, double c) {
    Vector v = Vector::Zero();
    v.head<3>() << a, b, c;
    return v;
  };
  leader->actuate(Force<8>{three(1.0, 2.0, 3.0)});
  const DeviceSample<8> hand = leader->sense(tick<MasterClock>(1));
  EXPECT_EQ(hand.x.translation().head<3>(), (Eigen::Vector3d{0.1, 0.2, 3 * 0.1}));
  EXPECT_EQ(hand.x.translation().tail<5>(), Vector::Zero().tail<5>()) << "of joints that there are not";
  EXPECT_EQ(hand.v.vec(), three(-1.0, -2.0, -3.0)) << "the hand is pushed with -f";
  EXPECT_EQ(hand.applied.vec(), three(1.0, 2.0, 3.0));

  const std::unique_ptr<Robot<8>> follower = open_robot<8>(kArm + ":still");
  EXPECT_TRUE(follower->info().has_force_sensor);
  EXPECT_EQ(follower->info().limits.joints.effort[0], 8.0);
  RobotCommand<8> command;
  command.f = Force<8>{three(1.0, 2.0, 3.0)};
  command.x_d = Position<8>{three(0.5, 0.5, 0.5)};
  follower->actuate(command);
  const RobotSample<8> tool = follower->sense(tick<SlaveClock>(1));
  EXPECT_EQ(tool.x.translation().head<2>(), (Eigen::Vector2d{0.6, 0.7}));
  EXPECT_EQ(tool.v.vec(), three(1.0, 2.0, 3.0));
  EXPECT_EQ(tool.f_environment.vec(), three(-4.0, -5.0, -6.0)) << "of the robot on the environment";
  follower->release();
  EXPECT_EQ(follower->sense(tick<SlaveClock>(2)).v.vec(), three(0.0, 0.0, 0.0));
}

TEST(Plugin, OfAnArmThatDoesNotFitIsRefusedInOneSentence) {
  const std::string flag = "--device " + kArm;
  EXPECT_EQ(why_not<8>(kArm + ":joints=2"), flag + ":joints=2: has 2 joints, but the arms of the scene have 3");
  EXPECT_EQ(why_not<8>(kArm + ":joints=9"), flag + ":joints=9: info() says joints 9; it must be 1 to 8");
  EXPECT_EQ(why_not<8>(kArm + ":torque=-1"), flag + ":torque=-1: info() says limits[0].torque -1; it must be > 0");
  EXPECT_EQ(why_not<8>(kArm + ":range"), flag + ":range: info() says limits[2].lower -0.1; it must be below upper");
  EXPECT_EQ(why_not(kArm), flag +
                               ": is no plug-in for --device: it has no entry point twoport_device_plugin; it has one "
                               "for --device with space JOINTS and one for --robot with space JOINTS");
  EXPECT_EQ(why_not<8>(kFirst), "--device " + kFirst +
                                    ": is no plug-in for --device with space JOINTS: it has no entry point "
                                    "twoport_leader_plugin; it has one for --device and one for --robot");
}

TEST(Plugin, ThatCannotBeLoadedIsRefusedInOneSentence) {
  EXPECT_EQ(why_not("/nowhere/a.so:7"),
            "--device /nowhere/a.so:7: there is no such file; give the path of a shared library");
  const Folder folder;
  const std::string text = folder.write("text.so", "no library");
  EXPECT_EQ(why_not(text).find("--device " + text + ": cannot be loaded: "), 0u) << why_not(text);
  EXPECT_EQ(why_not(kNone), "--device " + kNone +
                                ": is no plug-in for --device: it has no entry point twoport_device_plugin; it has one "
                                "for --robot");
  EXPECT_THROW(open_robot<1>(kNone), ConfigError) << "its entry point returns nothing";
  EXPECT_EQ(why_not(kOld),
            "--device " + kOld +
                ": is a plug-in of version 0, and this program loads versions 1 to 3; build it again with the "
                "installed twoport");
  EXPECT_EQ(why_not(kOdd + ":refuses"), "--device " + kOdd + ":refuses: no power at the socket");
  EXPECT_EQ(why_not(kOdd + ":refuses_oddly"),
            "--device " + kOdd + ":refuses_oddly: an exception that is no std::exception");
  EXPECT_EQ(why_not(kOdd + ":negative"),
            "--device " + kOdd + ":negative: info() says peak_force_n -3; it must be >= 0");
}

TEST(Plugin, ThatWouldEndTheProgramWhenItIsLoadedIsRefusedInOneSentence) {
  const std::string throws = TWOPORT_THROWING_PLUGIN, crashes = TWOPORT_CRASHING_PLUGIN, data = TWOPORT_DATA_PLUGIN;
  EXPECT_EQ(why_not(throws),
            "--device " + throws + ": cannot be loaded: loading it throws an exception: no licence for this machine");
  EXPECT_EQ(
      why_not(crashes),
      "--device " + crashes +
          ": cannot be loaded: loading it ends the program by signal 11 (Segmentation fault): the file is damaged, or "
          "code that it runs when it is loaded fails");
  EXPECT_EQ(why_not(data),
            "--device " + data + ": its entry point twoport_device_plugin is no function; use the macro of plugin.h");
  // Cut off at every tenth of its length.
  const Folder folder;
  const std::string whole = read_text(kOdd);
  for (std::size_t tenth = 0; tenth < 10; ++tenth) {
    const std::string cut =
        folder.write("cut" + std::to_string(tenth) + ".so", whole.substr(0, whole.size() * tenth / 10));
    const std::string says = tenth == 0 ? "file too short" : "the file is cut off; copy or build it again";
    const std::string why = why_not(cut);
    EXPECT_TRUE(why.starts_with("--device " + cut + ": cannot be loaded: ") && why.ends_with(says)) << why;
  }
}

TEST(Plugin, ThatThrowsReportsAFaultWithItsLastReadingAndIsReleased) {
  for (const std::string defect : {"throw_in_sense=3", "throw_oddly=3", "throw_in_actuate=2"}) {
    const std::unique_ptr<Device<3>> device = open_device(kOdd + ":" + defect);
    for (int k = 0; k < 2; ++k) {
      ASSERT_EQ(device->sense(tick<MasterClock>(k)).status, HardwareStatus::ok) << defect;
      device->actuate(Force<3>{Force<3>::Vector{1.0, 0.0, 0.0}});
    }
    for (int k = 2; k < 5; ++k) {
      const DeviceSample<3> sample = device->sense(tick<MasterClock>(k));
      EXPECT_EQ(sample.status, HardwareStatus::fault) << defect;
      EXPECT_TRUE(all_finite(sample.x, sample.v, sample.applied));
      EXPECT_EQ(sample.x.translation()[0], 0.005);
    }
    EXPECT_NE(device->trouble().find("() threw: "), std::string::npos) << device->trouble();
    device->release();
  }
}

TEST(Plugin, WhoseReadingsStayNotFiniteReportsAFaultAfterATenthOfASecond) {
  const std::unique_ptr<Device<3>> device = open_device(kOdd + ":nan=10");
  int finite = 0, failing = 0;
  for (int k = 0; k < 300; ++k) {
    const DeviceSample<3> sample = device->sense(tick<MasterClock>(k));
    finite += all_finite(sample.v) ? 1 : 0;
    failing += sample.status == HardwareStatus::fault ? 1 : 0;
  }
  EXPECT_EQ(finite, 9);
  EXPECT_EQ(failing, 300 - 9 - 99);  // the hundredth such reading and all later ones
  EXPECT_EQ(device->trouble(), kOdd + ": readings are not finite numbers");
  const std::unique_ptr<Device<3>> blinks = open_device(kOdd + ":blink=10");
  for (int k = 0; k < 300; ++k) ASSERT_EQ(blinks->sense(tick<MasterClock>(k)).status, HardwareStatus::ok);
}

TEST(Plugin, RunsInTheMasterAndItsDefectsEndTheRunInWords) {
  const Folder folder;
  const std::string scene = folder.write("scene.textproto", press(3, "RENDER"));
  const auto run = [&](const std::string& arguments, int status, const std::string& says) {
    Words words{"twoport-master", "--scene", scene,          "--duration", "0.5",           "--no-realtime",
                "--no-spin",      "--out",   folder / "out", "--device",   kOdd + arguments};
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    testing::internal::CaptureStderr();
    testing::internal::CaptureStdout();
    EXPECT_EQ(master_program(static_cast<int>(argv.size()), argv.data(), all_drivers()), status) << arguments;
    testing::internal::GetCapturedStdout();
    const std::string said = testing::internal::GetCapturedStderr();
    EXPECT_NE(said.find(says), std::string::npos) << said;
  };
  run("", 0, "hardware: odd plug-in");
  run(":blink=50", 0, "hardware: odd plug-in");
  run(":throw_in_sense=50", 1, ": sense() threw: the cable is out; the hardware was released");
  run(":throw_in_actuate=50", 1, ": actuate() threw: the amplifier is out; the hardware was released");
  run(":nan=50", 1, ": readings are not finite numbers; the hardware was released");
  run(":nan=1", 1, "the first reading is not finite");
  run(":throw_in_sense=1", 1, "hardware fault at the first reading; " + kOdd + ": sense() threw: the cable is out");
  run(":refuses", 2, "no power at the socket");
  run(":stop=50", 1, "s: stopped by the hardware: no force until");
}

/// A master with the odd plug-in, two seconds of a rendered scene.
struct OddRun {
  explicit OddRun(const std::string& arguments)
      : scene{folder.write("scene.textproto", press(3, "RENDER"))},
        master{{TWOPORT_MASTER, "--scene", scene, "--set", "duration_s=2", "--no-realtime", "--no-spin", "--out",
                folder / "out", "--record", folder / "a.mcap", "--device", kOdd + ":" + arguments}} {}
  void expect_ended(const std::string& says, bool has_files) {
    EXPECT_EQ(master.wait(), exited(1)) << master.err();
    EXPECT_NE(master.err().find(says), std::string::npos) << master.err();
    ASSERT_EQ(std::filesystem::exists(folder / "out/summary.json"), has_files);
    if (!has_files) return;
    const schema::Summary s = summary_in(folder / "out");
    EXPECT_EQ(s.verdict_kind(), "UNDECIDED");
    EXPECT_NE(s.verdict().find(says), std::string::npos) << s.verdict();
    EXPECT_GT(s.steps(), 50u);
    EXPECT_EQ(Trace{folder / "out/trace.csv"}.rows(), s.steps());
    EXPECT_GT(std::filesystem::file_size(folder / "a.mcap"), 1000u);
  }
  Folder folder;
  std::string scene;
  Process master;
};

TEST(Plugin, WhoseCallDoesNotReturnIsEndedWithItsFiles) {
  for (const std::string defect : {"hang_in_sense=300", "hang_in_release"}) {
    SCOPED_TRACE(defect);
    OddRun{defect}.expect_ended("the hardware has not returned from a call for 1.5 s", true);
  }
}

TEST(Plugin, WhoseConstructorDoesNotReturnIsEndedBySignals) {
  for (const int signal : {SIGINT, SIGTERM}) {
    OddRun run{"hang_in_open"};
    std::this_thread::sleep_for(2s);
    EXPECT_TRUE(run.master.running()) << "to open may take long";
    run.master.send(signal);
    const auto sent = std::chrono::steady_clock::now();
    run.expect_ended("ended by a signal while the hardware was being opened", false);
    EXPECT_LT(std::chrono::steady_clock::now() - sent, 5s);
  }
}

TEST(Plugin, ThatCallsExitEndsWithStatusOneAndFiles) {
  OddRun{"exit_in_sense=300"}.expect_ended("the hardware has ended the program by exit()", true);
}

TEST(Plugin, WhoseEveryOtherReadingIsNotFiniteIsSaidAtOnce) {
  OddRun run{"every_other=100"};
  EXPECT_TRUE(run.master.says("readings of the hardware are not finite, or too old")) << run.master.err();
  EXPECT_EQ(run.master.wait(), exited(0)) << run.master.err();
}

}  // namespace
}  // namespace twoport::test::plugin_test
