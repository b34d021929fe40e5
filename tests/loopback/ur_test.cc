#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <functional>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

#include "common/base/check.h"
#include "common/base/thread.h"
#include "common/hardware/mounted.h"
#include "common/scene/load.h"
#include "drivers/drivers.h"
#include "drivers/rtde.h"
#include "tests/support/live.h"
#include "tests/support/no_alloc.h"
#include "tests/support/ur_controller.h"

// Robots of Universal Robots, by a stand-in for their controller.
namespace twoport::test::ur_test {
namespace {

using std::chrono::steady_clock;

constexpr Seconds kPeriod{2e-3};

std::string bytes(std::string_view hex) {
  std::string all;
  for (std::size_t i = 0; i < hex.size(); i += 2)
    all += static_cast<char>(std::stoi(std::string{hex.substr(i, 2)}, nullptr, 16));
  return all;
}
/// Two UR5e joint by joint; a hand moves the leader's tool 30 mm along x.
std::string two_ur5e() {
  return read_text(TWOPORT_EXAMPLES "/ur/joints.textproto");
}
/// A tool of six axes, on that arm.
std::string tool_of(const std::string& arm) {
  const std::string text = press(6);
  return text.substr(0, text.find("robot {")) + "robot { arm { file: \"" + arm + "\" } force_sensor { } }\n";
}

template <int N>
std::unique_ptr<Robot<N>> open(const UrController& controller,
                               const std::string& scene = press(N == kJointPort ? 1 : N)) {
  return all_drivers().robots.open<N>(controller.choice(), parse_scene(scene, "scene"), kPeriod);
}
template <int N>
std::string refusal(const UrOptions& options, const std::string& scene = press(N == kJointPort ? 1 : N)) {
  const UrController controller{TWOPORT_ARMS, options};
  try {
    open<N>(controller, scene);
  } catch (const ConfigError& e) {
    const std::string flag = "--robot " + controller.choice() + ": ", words = e.what();
    return words.starts_with(flag) ? words.substr(flag.size()) : words;
  }
  return "opened";
}

/// The loop of a slave.
template <int N>
class Loop {
 public:
  using Control = std::function<std::optional<RobotCommand<N>>(const RobotSample<N>&)>;

  explicit Loop(std::unique_ptr<Robot<N>> robot) : robot_{std::move(robot), {}} {
    sample = robot_.sense(tick());
    const sched_param real_time{50};  // where it is permitted
    pthread_setschedparam(pthread_self(), SCHED_FIFO, &real_time);
    robot_.start();
  }
  ~Loop() { take_ordinary_priority(); }
  /// Until `until` holds, for 5 s at most; without a command the loop hangs.
  bool run(const Control& control, const std::function<bool()>& until) {
    for (int k = 0; k < 2500; ++k) {
      sample = robot_.sense(tick());
      if (const auto command = control(sample)) robot_.actuate(*command);
      if (until()) return true;
      std::this_thread::sleep_until(next_ += std::chrono::milliseconds{2});
    }
    return false;
  }
  void run(const Control& control, double time_s) {
    run(control,
        [end = steady_clock::now() + std::chrono::duration<double>{time_s}] { return steady_clock::now() > end; });
  }
  MountedRobot<N>& robot() { return robot_; }

  RobotSample<N> sample;

 private:
  static Tick<SlaveClock> tick() { return {Instant<SlaveClock>{}, kPeriod}; }
  MountedRobot<N> robot_;
  steady_clock::time_point next_ = steady_clock::now();
};
/// A spring of 1 kN/m and 40 N s/m to a place.
Loop<3>::Control pulled(double x_m) {
  return [x_m](const RobotSample<3>& s) {
    const Eigen::Vector3d f{1000.0 * (x_m - s.x.translation().x()) - 40.0 * s.v[0], 0.0, 0.0};
    return RobotCommand<3>{Force<3>{f}, {}, {}};
  };
}

// The bytes are those of Universal Robots' own client in Python.
TEST(Rtde, PacksASetPointAndReadsAState) {
  EXPECT_EQ(
      rtde::set_point(3, {-2, 1, {0.25, -0.5, 1.0, 3.14, 0.0, -1e-3}}),
      bytes("003c5503fffffffe000000013fd0000000000000bfe00000000000003ff000000000000040091eb851eb851f0000000000000000"
            "bf50624dd2f1a9fc"));
  std::string state = bytes(
      "0740290000000000003ff00000000000003ff20000000000003ff40000000000003ff60000000000003ff80000000000003ffa0000000000"
      "00"
      "4000000000000000400100000000000040020000000000004003000000000000400400000000000040050000000000004008000000000000"
      "4009"
      "000000000000400a000000000000400b000000000000400c000000000000400d000000000000401000000000000040108000000000004011"
      "00000"
      "000000040118000000000004012000000000000401280000000000"
      "0c014000000000000c013800000000000c013000000000000c012800000000000c012000000000000c011800000000000000000070000000"
      "10000"
      "0002fffffff7");
  const auto s = rtde::read_state(state, 7);
  ASSERT_TRUE(s);
  EXPECT_EQ(s->timestamp_s, 12.5);
  EXPECT_EQ(s->q[5], 1.625);
  EXPECT_EQ(s->qd[0], 2.0);
  EXPECT_EQ(s->pose[1], 3.125);
  EXPECT_EQ(s->speed[2], 4.25);
  EXPECT_EQ(s->force[0], -5.0);
  EXPECT_EQ(s->robot_mode, 7);
  EXPECT_EQ(s->safety_mode, 1);
  EXPECT_EQ(s->runtime_state, 2u);
  EXPECT_EQ(s->program, -9);
  EXPECT_FALSE(rtde::read_state(state, 8));
  EXPECT_FALSE(rtde::read_state(state + '\0', 7));
  EXPECT_FALSE(rtde::read_state(std::string_view{state}.substr(1), 7));
  EXPECT_FALSE(rtde::read_state({}, 7));
  state.replace(9, 8, bytes("7ff8000000000000"));
  EXPECT_FALSE(rtde::read_state(state, 7)) << "no number";
}

TEST(Ur, AsksAsTheProtocolSays) {
  UrController controller{TWOPORT_ARMS};
  const auto robot = open<6>(controller);
  EXPECT_EQ(controller.asked(), bytes("0005560002") + bytes("000376") + bytes("00954f407f400000000000") +
                                    "timestamp,actual_q,actual_qd,actual_TCP_pose,actual_TCP_speed,actual_TCP_force,"
                                    "robot_mode,safety_mode,runtime_state,output_int_register_24" +
                                    bytes("00c449") +
                                    "input_int_register_24,input_int_register_25,input_double_register_24,"
                                    "input_double_register_25,input_double_register_26,input_double_register_27,"
                                    "input_double_register_28,input_double_register_29" +
                                    bytes("000353"));
  EXPECT_EQ(robot->info().name,
            "Universal Robots at 127.0.0.1:" + std::to_string(controller.port()) + ", PolyScope 5.22, servoj");
  EXPECT_EQ(controller.zeroed, 1);
  EXPECT_EQ(controller.ended(), "");
}

TEST(Ur, WaitsForAControllerThatIsStarting) {
  std::optional<UrController> controller{std::in_place, TWOPORT_ARMS};
  const std::string choice = controller->choice();
  const std::uint16_t port = controller->port();
  controller.reset();
  std::thread starts{[&] {
    std::this_thread::sleep_for(std::chrono::milliseconds{300});
    controller.emplace(TWOPORT_ARMS, UrOptions{.port = port});
  }};
  EXPECT_NO_THROW((void)all_drivers().robots.open<3>(choice, parse_scene(press(3), "scene"), kPeriod));
  starts.join();
  controller.reset();
  try {
    (void)all_drivers().robots.open<3>(choice, parse_scene(press(3), "scene"), kPeriod);
    ADD_FAILURE() << "opened";
  } catch (const ConfigError& e) {
    EXPECT_EQ(std::string{e.what()}, "--robot " + choice +
                                         ": no controller is there (Connection refused); check the address, and that "
                                         "RTDE is enabled");
  }
}

TEST(Ur, SaysWhatAControllerRefuses) {
  EXPECT_EQ(refusal<3>({.speaks_version_2 = false}), "the controller does not speak version 2 of RTDE");
  EXPECT_EQ(refusal<3>({.version = {3, 15, 4}}), "the controller has PolyScope 3.15; it must be 5.3 or later");
  EXPECT_EQ(refusal<3>({.version = {5, 2, 0}}), "the controller has PolyScope 5.2; it must be 5.3 or later");
  EXPECT_EQ(refusal<3>({.version = {5, 3, 0}}), "opened");
  EXPECT_EQ(refusal<3>({.refused = "actual_TCP_speed"}), "the controller refuses actual_TCP_speed: NOT_FOUND");
  EXPECT_EQ(
      refusal<3>({.refused = "input_int_register_25", .by = "IN_USE"}),
      "the controller refuses input_int_register_25: IN_USE; another program writes it: end that one, or a fieldbus");
  EXPECT_EQ(refusal<3>({.starts = false}), "the controller does not start RTDE");
  EXPECT_EQ(refusal<3>({.starts = false, .warns = "busy\n"}), "the controller does not start RTDE; it says \"busy \"");
  EXPECT_EQ(refusal<3>({.warns = "busy"}), "opened");
  EXPECT_EQ(refusal<3>({.takes_programs = false}),
            "the controller does not start the program; put it into remote control, and enable its interfaces");
  EXPECT_EQ(refusal<3>({.safety_mode = 3}), "its safety mode is PROTECTIVE_STOP; it must be NORMAL or REDUCED");
  EXPECT_EQ(refusal<3>({.robot_mode = 5}),
            "its robot mode is IDLE; it must be RUNNING: power it on and release its brakes");
  EXPECT_EQ(refusal<3>({.safety_mode = 2}), "opened");
  EXPECT_EQ(refusal<3>({.safety_mode = 9}), "its safety mode is FAULT; it must be NORMAL or REDUCED");
  EXPECT_EQ(refusal<3>({.safety_mode = 11}), "its safety mode is UNDEFINED_SAFETY_MODE; it must be NORMAL or REDUCED");
  EXPECT_EQ(refusal<3>({.safety_mode = 13}),
            "its safety mode is SYSTEM_THREE_POSITION_ENABLING_STOP; it must be NORMAL or REDUCED");
  EXPECT_EQ(refusal<3>({.safety_mode = 25}), "its safety mode is unknown; it must be NORMAL or REDUCED");
  EXPECT_EQ(refusal<3>({.safety_mode = 0}), "its safety mode is unknown; it must be NORMAL or REDUCED");
  EXPECT_EQ(
      refusal<kJointPort>({}, two_ur5e()),
      "the controller has PolyScope 5.22; joints need direct torque control, which 5.23 and 10.11 have; with space "
      "CARTESIAN it follows set points");
  EXPECT_NE(refusal<6>({.version = {5, 25, 1}}, tool_of("panda")).find("has 7 joints; it must be the robot's"),
            std::string::npos);
  EXPECT_THROW(std::ignore = all_drivers().robots.open<3>("ur:127.0.0.1:2", Scene{}, kPeriod), ConfigError);
  EXPECT_THROW(std::ignore = all_drivers().robots.open<3>("ur:", Scene{}, kPeriod), ConfigError);
  EXPECT_THROW(std::ignore = all_drivers().robots.open<3>("ur:127.0.0.1:9", Scene{}, kPeriod), ConfigError);
}

TEST(Ur, MovesToSetPointsAndHearsOneInEveryCycle) {
  UrController controller{TWOPORT_ARMS};
  Loop<3> loop{open<3>(controller)};
  const double x0 = controller.tool_x_m;
  EXPECT_NEAR(loop.sample.x.translation().x(), x0, 1e-9);
  loop.run(pulled(x0 - 0.03), 1.0);
  const long before = controller.cycles, unheard = controller.unheard, were_late = controller.late;
  loop.run(pulled(x0 - 0.03), 2.0);
  const long cycles = controller.cycles - before;
  EXPECT_NEAR(controller.tool_x_m, x0 - 0.03, 1e-4);
  EXPECT_NEAR(loop.sample.f_environment.vec().norm(), 0.0, 1e-6) << "the sensor has been zeroed";
  EXPECT_EQ(controller.ended(), "");
  const long missed = controller.unheard - unheard, late = controller.late - were_late;
  std::cout << missed << " of " << cycles << " cycles had no new set point, at most " << controller.longest_unheard
            << " in a row; " << late << " began late\n";
  if (late > cycles / 200) GTEST_SKIP() << "not judged: the machine was too busy";
  EXPECT_LE(missed, late + 5);
}

TEST(Ur, AllocatesNothingInATick) {
  UrController controller{TWOPORT_ARMS, {.version = {5, 25, 1}}};
  const auto joints = open<kJointPort>(controller, two_ur5e());
  const auto ticks = [&](auto& robot, auto command) {
    const NoAlloc guard;
    for (int k = 0; k < 20; ++k) {
      robot.sense({Instant<SlaveClock>{}, kPeriod});
      robot.actuate(command);
    }
    robot.release();
    return guard.seen();
  };
  EXPECT_EQ(ticks(*joints, RobotCommand<kJointPort>{}), 0);
  UrController other{TWOPORT_ARMS};
  EXPECT_EQ(ticks(*open<6>(other), RobotCommand<6>{}), 0);
}

TEST(Ur, HoldsAContact) {
  UrController controller{TWOPORT_ARMS};
  Loop<3> loop{open<3>(controller)};
  const double x0 = controller.tool_x_m;
  loop.run(pulled(x0 + 0.04), 3.0);
  EXPECT_NEAR(controller.wall_force_n, 20.0 / (1.0 + 1000.0 / 3000.0), 0.5);  // of both springs
  EXPECT_NEAR(loop.sample.f_environment[0], controller.wall_force_n, 0.05);
  EXPECT_LT(controller.tool_speed_m_per_s, 1e-3);
}

TEST(Ur, StopsByItselfWhenNoSetPointsCome) {
  UrController controller{TWOPORT_ARMS};
  const Pair pair{press(3)};
  Process slave = pair.listening_slave("slave", {"--robot", controller.choice(), "--set", "duration_s=20"});
  Process master = pair.master("master", {"--set", "duration_s=20"});
  ASSERT_TRUE(comes_true([&] { return controller.wall_force_n > 0.5; }));
  slave.send(SIGSTOP);
  const auto stopped = steady_clock::now();
  ASSERT_TRUE(comes_true([&] { return !controller.ended().empty(); }));
  EXPECT_LT(steady_clock::now() - stopped, 150ms);
  EXPECT_EQ(controller.ended(), "by itself") << "the program on the controller, before the watchdog";
  EXPECT_TRUE(comes_true([&] { return controller.tool_speed_m_per_s < 1e-6; }));
  slave.send(SIGKILL);
  slave.send(SIGCONT);
  master.send(SIGINT);
}

TEST(Ur, WaitsForLatePackages) {
  UrController controller{TWOPORT_ARMS};
  Loop<3> loop{open<3>(controller)};
  const double x0 = controller.tool_x_m;
  loop.run(pulled(x0 - 0.02), 0.5);
  controller.mute = true;
  loop.run(pulled(x0 - 0.02), 0.05);
  EXPECT_EQ(loop.sample.status, HardwareStatus::stale);
  controller.mute = false;
  loop.run(pulled(x0 - 0.02), 1.0);
  EXPECT_EQ(controller.connections, 1);
  EXPECT_NEAR(controller.tool_x_m, x0 - 0.02, 1e-4);
}

TEST(Ur, ConnectsAgainAndDoesNotZeroAContact) {
  // A network that stands still for 90 ms ends the program on the controller alone.
  for (const std::string why : {"cut", "garbage", "deaf", "deaf and mute"}) {
    UrController controller{TWOPORT_ARMS};
    Loop<3> loop{open<3>(controller)};
    const double x0 = controller.tool_x_m;
    loop.run(pulled(x0 + 0.03), 1.0);
    ASSERT_GT(controller.wall_force_n, 5.0);
    if (why.starts_with("deaf")) {
      controller.mute = why == "deaf and mute";
      controller.deaf = true;
      ASSERT_TRUE(loop.run(pulled(x0 + 0.03), [&] { return !controller.ended().empty(); }));
      controller.deaf = controller.mute = false;
    } else {
      (why == "cut" ? controller.cut : controller.garbage) = true;
    }
    ASSERT_TRUE(loop.run(pulled(x0 + 0.03), [&] { return loop.robot().lets_go(); })) << why;
    EXPECT_EQ(loop.sample.v.squared_norm(), 0.0);
    ASSERT_TRUE(loop.run(pulled(x0 + 0.03), [&] { return !loop.robot().lets_go(); }));
    loop.run(pulled(x0 + 0.03), 1.5);
    EXPECT_EQ(controller.connections, 2) << why;
    EXPECT_EQ(controller.programs, 2);
    EXPECT_EQ(controller.zeroed, 1);
    EXPECT_NEAR(loop.sample.f_environment[0], 10.0 / (1.0 + 1000.0 / 3000.0), 0.5);
    EXPECT_NE(loop.sample.status, HardwareStatus::fault);
  }
}

TEST(Ur, AStoppedRobotIsAFaultInWords) {
  const auto after = [](const std::function<void(UrController&)>& happens) -> std::string {
    UrController controller{TWOPORT_ARMS};
    Loop<3> loop{open<3>(controller)};
    const double x0 = controller.tool_x_m;
    loop.run(pulled(x0 - 0.05), 0.3);
    happens(controller);
    EXPECT_TRUE(loop.run(pulled(x0 - 0.05), [&] { return loop.sample.status == HardwareStatus::fault; }));
    controller.safety_mode = 1;
    controller.robot_mode = 7;
    const std::string words = loop.robot().trouble();
    loop.run(pulled(x0 - 0.05), 0.3);
    EXPECT_EQ(loop.sample.status, HardwareStatus::fault) << "for good";
    EXPECT_LT(controller.tool_speed_m_per_s, 1e-3);
    return words.substr(words.find(": ") + 2);
  };
  EXPECT_EQ(after([](UrController& c) { c.safety_mode = 3; }),
            "its safety mode is PROTECTIVE_STOP; it must be NORMAL or REDUCED");
  const auto cut_and_stopped = [](UrController& c) {
    c.cut = true;
    c.safety_mode = 3;
  };
  EXPECT_EQ(after(cut_and_stopped), "its safety mode is PROTECTIVE_STOP; it must be NORMAL or REDUCED");
  EXPECT_EQ(after([](UrController& c) { c.safety_mode = 7; }),
            "its safety mode is ROBOT_EMERGENCY_STOP; it must be NORMAL or REDUCED");
  EXPECT_EQ(after([](UrController& c) { c.robot_mode = 3; }),
            "its robot mode is POWER_OFF; it must be RUNNING: power it on and release its brakes");
  EXPECT_EQ(
      after([](UrController& c) { c.stop_program = true; }),
      "the program on the controller has ended: somebody or its watchdog has stopped it, or the pose has no inverse "
      "kinematics");
}

TEST(Ur, JointsFollowTorquesUntilTheLoopHangs) {
  UrController controller{TWOPORT_ARMS, {.version = {5, 25, 1}}};
  const auto robot = open<kJointPort>(controller, two_ur5e());
  EXPECT_FALSE(robot->info().servo);
  Force<kJointPort>::Vector torque = Force<kJointPort>::Vector::Zero();
  torque.head<6>() << 2.0, 0.0, 0.0, 0.0, 0.0, 0.6;
  RobotSample<kJointPort> s = robot->sense({Instant<SlaveClock>{}, kPeriod});
  EXPECT_EQ(s.x.translation()[0], 0.3);
  EXPECT_EQ(s.x.translation()[6], 0.0);
  for (int k = 0; k < 250; ++k, std::this_thread::sleep_for(2ms)) {
    s = robot->sense({Instant<SlaveClock>{}, kPeriod});
    robot->actuate({Force<kJointPort>{torque}, {}, {}});
  }
  EXPECT_NEAR(controller.torque_n_m, torque.norm(), 1e-12);
  EXPECT_GT(s.x.translation()[0], 0.31);
  EXPECT_NEAR(s.v[5], 0.3, 0.05) << "against 2 N m s/rad";
  EXPECT_GT(controller.tool_speed_m_per_s, 0.03);
  std::this_thread::sleep_for(300ms);
  EXPECT_LT(controller.tool_speed_m_per_s, 1e-3);
  EXPECT_EQ(controller.ended(), "");
  ASSERT_TRUE(comes_true([&] {
    robot->actuate({Force<kJointPort>{torque}, {}, {}});
    return controller.tool_speed_m_per_s > 0.03;
  }));
  robot->release();
  EXPECT_TRUE(comes_true([&] { return controller.tool_speed_m_per_s < 1e-3; }));
}

TEST(Ur, AToolFollowsForcesByTheArm) {
  UrController controller{TWOPORT_ARMS, {.version = {10, 12, 0}}};
  Loop<6> loop{open<6>(controller, tool_of("ur5e"))};
  EXPECT_NE(loop.robot().info().name.find("PolyScope 10.12, direct torque"), std::string::npos);
  const Position<6> start = loop.sample.x;
  const double x0 = controller.tool_x_m;
  const auto held = [&](const RobotSample<6>& s) {
    Force<6>::Vector f;
    f << 1000.0 * (start.translation() - s.x.translation()), 20.0 * (start - s.x).vec().tail<3>();
    f[0] += 20.0;  // into the wall, which is 20 mm away: the spring is then empty
    return RobotCommand<6>{Force<6>{f}, {}, {}};
  };
  loop.run(held, 3.0);
  EXPECT_NEAR(loop.sample.x.translation().x() - x0, 0.02, 1e-3);
  EXPECT_LT(((loop.sample.x - start).vec().tail<5>().norm()), 0.02);
}

TEST(UrLive, FeelsAWallByTheRobotsSensor) {
  UrController controller{TWOPORT_ARMS};
  const Pair pair{press(3)};
  const Words more{
      "--set", "slave_rate_hz=500", "--set", "duration_s=4", "--set", "control.passivity.method=INTERNAL_MODEL"};
  Words of_slave = more;
  of_slave.insert(of_slave.end(), {"--robot", controller.choice()});
  Process slave = pair.listening_slave("slave", of_slave);
  Process master = pair.master("master", more);
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_NE(slave.err().find("the robot obeys positions only"), std::string::npos) << slave.err();
  const Trace trace = pair.trace("slave");
  EXPECT_GT(trace.peak("env_f_0", 2.0, 4.0), 1.0);
  EXPECT_NEAR(trace.peak("master_f_0", 3.8, 4.0), trace.peak("env_f_0", 3.8, 4.0), 0.1);
  expect_sound({pair.summary("master"), pair.summary("slave")});
  EXPECT_EQ(controller.ended(), "by itself");
}

TEST(UrLive, TellsTheStopOfTheRobot) {
  UrController controller{TWOPORT_ARMS};
  const Pair pair{press(3)};
  Process slave = pair.listening_slave("slave", {"--robot", controller.choice(), "--set", "duration_s=20"});
  Process master = pair.master("master", {"--set", "duration_s=20"});
  ASSERT_TRUE(comes_true([&] { return controller.wall_force_n > 0.5; }));
  controller.safety_mode = 3;
  EXPECT_EQ(slave.wait(), exited(1)) << slave.err();
  EXPECT_NE(slave.err().find("its safety mode is PROTECTIVE_STOP"), std::string::npos) << slave.err();
  master.send(SIGINT);
  master.wait();
}

TEST(UrLive, TwoArmsJointByJoint) {
  UrController controller{TWOPORT_ARMS, {.version = {5, 25, 1}}};
  const Pair pair{two_ur5e()};
  Process slave = pair.listening_slave("slave", {"--robot", controller.choice()});
  Process master = pair.master();
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_GT(controller.most_force_n, 1.0);
  expect_sound({pair.summary("master"), pair.summary("slave")});
  EXPECT_NEAR(pair.summary("master").held_force_ratio(), 1.0, 0.1);
}

}  // namespace
}  // namespace twoport::test::ur_test
