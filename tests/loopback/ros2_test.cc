#include <gtest/gtest.h>
#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/arm/parameters.h"
#include "common/base/check.h"
#include "common/scene/load.h"
#include "dds/ddsi/ddsi_serdata.h"
#include "drivers/drivers.h"
#include "tests/loopback/ros2_side.h"
#include "tests/support/live.h"
#include "tests/support/no_alloc.h"

// Robots and devices behind topics of ROS 2. Its side is played by Cyclone DDS alone; names, types and bytes are compared with those that ROS 2
// documents.
namespace twoport::test::ros2_test {
namespace {

using std::chrono::steady_clock;

const int kDomain = 10 + getpid() % 90;

template <template <int> class Hardware, int N>
std::unique_ptr<Hardware<N>> open(const std::string& arguments, const Scene& scene = {}) {
  const std::string choice = "ros2:" + arguments;
  if constexpr (std::is_same_v<Hardware<N>, Robot<N>>)
    return all_drivers().robots.open<N>(choice, scene, Seconds{1e-3});
  else
    return all_drivers().devices.open<N>(choice, scene, Seconds{1e-3});
}
std::string in_domain(const std::string& prefix) {
  return prefix + ",domain=" + std::to_string(kDomain);
}
template <class Clock>
Tick<Clock> tick(double ended_s = 1e-3) {
  return {Instant<Clock>{}, Seconds{1e-3}, Seconds{ended_s}};
}
bool within(std::chrono::milliseconds time, const std::function<bool()>& condition) {
  for (const auto until = steady_clock::now() + time; steady_clock::now() < until; std::this_thread::sleep_for(1ms))
    if (condition()) return true;
  return condition();
}

class Ros2 : public testing::Test {
 protected:
  void SetUp() override {
    // Nothing of it leaves this computer.
    setenv("CYCLONEDDS_URI", "file://" TWOPORT_EXAMPLES "/ros2/localhost.xml", 1);
  }
  static Process stand_in(const std::string& prefix, Words more = {}) {
    Words words{TWOPORT_STAND_IN, prefix, std::to_string(kDomain)};
    words.insert(words.end(), more.begin(), more.end());
    return Process{words};
  }
};

/// Publishes the same numbers on a topic each until this object ends.
class Publishing {
 public:
  Publishing(Ros2Side& side, std::map<std::string, Seven> what)
      : thread_{[&side, what, this] {
          for (; going_; std::this_thread::sleep_for(2ms))
            for (const auto& [name, numbers] : what) side.publish(name, numbers);
        }} {}
  ~Publishing() {
    going_ = false;
    thread_.join();
  }

 private:
  std::atomic<bool> going_{true};
  std::thread thread_;
};

const std::map<std::string, Seven> kSomewhere{{"pose", {0.1, -0.2, 0.3, 0.6, 0.0, 0.0, 0.8}},
                                              {"twist", {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.0}},
                                              {"wrench", {-1.0, -2.0, -3.0, -0.4, -0.5, -0.6, 0.0}}};

TEST_F(Ros2, ARobotIsWhereItsTopicsSayAndGetsItsCommand) {
  Ros2Side side{"/arm", static_cast<std::uint32_t>(kDomain)};
  const Publishing publishing{side, kSomewhere};
  const auto robot = open<Robot, 6>(in_domain("arm"));
  EXPECT_TRUE(robot->info().has_force_sensor);
  RobotSample<6> s;
  RobotCommand<6> command;
  Force<6>::Vector wrench, twist;
  wrench << 1.0, 2.0, 3.0, 0.1, 0.2, 0.3;
  twist << 6.0, 5.0, 4.0, 3.0, 2.0, 1.0;
  command = {Force<6>{wrench}, {{7.0, 8.0, 9.0}, {0.8, 0.0, 0.6, 0.0}}, Velocity<6>{twist}};
  const NoAlloc guard;
  s = robot->sense(tick<SlaveClock>());
  robot->actuate(command);
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_LT((s.x.translation() - Eigen::Vector3d{0.1, -0.2, 0.3}).norm(), 1e-15);
  EXPECT_LT(s.x.attitude().angularDistance(Eigen::Quaterniond{0.8, 0.6, 0.0, 0.0}), 1e-12);
  for (int i = 0; i < 6; ++i) {
    EXPECT_EQ(s.v[i], i + 1.0);
    EXPECT_DOUBLE_EQ(s.f_environment[i], i < 3 ? i + 1.0 : 0.1 * (i + 1.0)) << "of the robot on the environment";
  }
  Seven n;
  const auto gets = [&](const std::string& name, const Seven& wanted) {
    return within(2s, [&] {
      robot->actuate(command);
      return side.take(name, n) && n == wanted;
    });
  };
  EXPECT_TRUE(gets("command", {1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.0}));
  EXPECT_TRUE(gets("target_pose", {7.0, 8.0, 9.0, 0.0, 0.6, 0.0, 0.8}));
  EXPECT_TRUE(gets("target_twist", {6.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.0}));
  // Without commands, and when released, it is let go.
  const auto begun = steady_clock::now();
  EXPECT_TRUE(within(1s, [&] { return side.take("command", n) && n == Seven{}; }));
  EXPECT_GT(steady_clock::now() - begun, 50ms);
  ASSERT_TRUE(gets("command", {1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.0}));
  robot->release();
  EXPECT_TRUE(within(90ms, [&] { return side.take("command", n) && n == Seven{}; }));
}

TEST_F(Ros2, ADeviceIsPushedAgainstTheForce) {
  Ros2Side side{"/handle", static_cast<std::uint32_t>(kDomain)};
  const Publishing publishing{side, kSomewhere};
  const auto device = open<Device, 1>(in_domain("/handle"));
  const Force<1> f{Force<1>::Vector{2.5}};
  Seven n;
  EXPECT_TRUE(within(2s, [&] {
    device->actuate(f);
    return side.take("command", n) && n == Seven{-2.5};
  }));
  const DeviceSample<1> s = device->sense(tick<MasterClock>());
  EXPECT_EQ(s.x.translation()[0], 0.1);
  EXPECT_EQ(s.v[0], 1.0);
  EXPECT_EQ(s.applied[0], 2.5);
  device->release();
  EXPECT_EQ(device->sense(tick<MasterClock>()).applied[0], 0.0);
  EXPECT_TRUE(within(90ms, [&] { return side.take("command", n) && n == Seven{}; }));
}

TEST_F(Ros2, WhatIsNoNumberOrNoRotationIsDroppedAndSilenceIsAFault) {
  Ros2Side side{"/arm", static_cast<std::uint32_t>(kDomain)};
  auto publishing = std::make_unique<Publishing>(side, kSomewhere);
  const auto robot = open<Robot, 6>(in_domain("/arm"));
  std::map<std::string, Seven> bad = kSomewhere;
  bad["pose"] = {9.0, 9.0, 9.0, 0.0, 0.0, 0.0, 0.0};
  bad["twist"][1] = std::nan("");
  bad["wrench"][5] = INFINITY;
  publishing.reset();
  publishing = std::make_unique<Publishing>(side, bad);
  std::this_thread::sleep_for(50ms);
  RobotSample<6> s = robot->sense(tick<SlaveClock>());
  for (int k = 0; k < 90; ++k) s = robot->sense(tick<SlaveClock>());
  EXPECT_EQ(s.status, HardwareStatus::stale);
  EXPECT_EQ(s.x.translation()[0], 0.1);
  EXPECT_EQ(s.v[1], 2.0);
  EXPECT_EQ(robot->trouble(), "");
  for (int k = 0; k < 20; ++k) s = robot->sense(tick<SlaveClock>());
  EXPECT_EQ(s.status, HardwareStatus::fault);
  EXPECT_NE(robot->trouble().find("nothing on /arm/pose (geometry_msgs::msg::dds_::PoseStamped_) for 0.1 s"),
            std::string::npos)
      << robot->trouble();
  EXPECT_EQ(robot->trouble().find("of which 0 were dropped"), std::string::npos) << robot->trouble();
}

using Names = std::vector<std::string>;

/// Two arms of three joints, which their file does not name.
Scene scene_of_arms(Names overrides = {}) {
  overrides.push_back("duration_s=1");
  return load_scene(TWOPORT_EXAMPLES "/plugin/scene.textproto", overrides);
}

/// Publishes the same states of joints until this object ends.
class PublishingJoints {
 public:
  PublishingJoints(JointSide& side, JointSide::State states, JointSide::State external)
      : thread_{[&side, states = std::move(states), external = std::move(external), this] {
          for (; going_; std::this_thread::sleep_for(2ms)) {
            side.publish("joint_states", states);
            side.publish("external_effort", external);
          }
        }} {}
  ~PublishingJoints() {
    going_ = false;
    thread_.join();
  }

 private:
  std::atomic<bool> going_{true};
  std::thread thread_;
};
// Other joints beside them, in another order.
const JointSide::State kJointsSomewhere{{"finger", "c", "a", "b"}, {9, 0.3, 0.1, 0.2}, {9, 3, 1, 2}, {}},
    kLoad{{"a", "b", "c"}, {}, {}, {-4, -5, -6}};

Force<8>::Vector first(double a, double b, double c) {
  Force<8>::Vector v = Force<8>::Vector::Zero();
  v.head<3>() << a, b, c;
  return v;
}

TEST_F(Ros2, JointsAreFoundByTheirNamesAndGetTheirCommand) {
  JointSide side{"/arm", static_cast<std::uint32_t>(kDomain)};
  const PublishingJoints publishing{side, kJointsSomewhere, kLoad};
  const auto robot = open<Robot, 8>(in_domain("/arm") + ",joints=a:b:c", scene_of_arms());
  EXPECT_TRUE(robot->info().has_force_sensor);
  RobotCommand<8> command;
  command = {Force<8>{first(1.5, 2.5, 3.5)}, Position<8>{first(0.5, 0.6, 0.7)}, Velocity<8>{first(5.0, 6.0, 7.0)}};
  RobotSample<8> s;
  const NoAlloc guard;
  s = robot->sense(tick<SlaveClock>());
  robot->actuate(command);
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_EQ(s.x.translation(), first(0.1, 0.2, 0.3));
  EXPECT_EQ(s.v.vec(), first(1.0, 2.0, 3.0));
  EXPECT_EQ(s.f_environment.vec(), first(4.0, 5.0, 6.0)) << "of the robot on the environment";
  JointSide::State n;
  std::vector<double> effort;
  ASSERT_TRUE(within(2s, [&] {
    robot->actuate(command);
    return side.take(n) && n.position.size() == 3;
  }));
  EXPECT_EQ(n.name, (Names{"a", "b", "c"}));
  EXPECT_EQ(n.position, (std::vector{0.5, 0.6, 0.7}));
  EXPECT_EQ(n.velocity, (std::vector{5.0, 6.0, 7.0}));
  EXPECT_EQ(n.effort, (std::vector{1.5, 2.5, 3.5}));
  EXPECT_TRUE(within(1s, [&] {
    robot->actuate(command);
    return side.take(effort) && effort == n.effort;
  }));
  robot->release();
  EXPECT_TRUE(within(90ms, [&] {
    return side.take(n) && n.position.empty() && n.effort == std::vector{0.0, 0.0, 0.0};
  }));
  EXPECT_TRUE(within(90ms, [&] { return side.take(effort) && effort == std::vector{0.0, 0.0, 0.0}; }));

  const auto device = open<Device, 8>(in_domain("/arm") + ",joints=c:b:a", scene_of_arms());
  EXPECT_TRUE(within(2s, [&] {
    device->actuate(Force<8>{first(1.0, 2.0, 3.0)});
    return side.take(n) && n.effort == std::vector{-1.0, -2.0, -3.0};
  })) << "the hand is pushed with -f";
  EXPECT_EQ(n.name, (Names{"c", "b", "a"}));
  EXPECT_TRUE(n.position.empty());
  const DeviceSample<8> hand = device->sense(tick<MasterClock>());
  EXPECT_EQ(hand.x.translation(), first(0.3, 0.2, 0.1));
  EXPECT_EQ(hand.applied.vec(), first(1.0, 2.0, 3.0));
}

/// By the names of CRTK, where each command is a mode: one of them goes out.
class Crtk : public Ros2 {
 protected:
  Ros2Side side{"/arm",
                static_cast<std::uint32_t>(kDomain),
                {"measured_cp", "measured_cv", "measured_cf"},
                {"servo_cf", "servo_cp"}};
  const std::map<std::string, Seven> somewhere{{"measured_cp", kSomewhere.at("pose")},
                                               {"measured_cv", kSomewhere.at("twist")},
                                               {"measured_cf", kSomewhere.at("wrench")}};
  RobotCommand<6> command;
  Seven n;
  Crtk() {
    Force<6>::Vector wrench;
    wrench << 1.0, 2.0, 3.0, 0.1, 0.2, 0.3;
    command = {Force<6>{wrench}, Position<6>{{7.0, 8.0, 9.0}, Eigen::Quaterniond{0.8, 0.0, 0.6, 0.0}}, {}};
  }
};

TEST_F(Crtk, ARobotGetsForces) {
  const Publishing publishing{side, somewhere};
  const auto robot = open<Robot, 6>(in_domain("/arm") + ",names=crtk,frame=base_link");
  EXPECT_FALSE(robot->info().servo);
  EXPECT_TRUE(robot->info().has_force_sensor);
  EXPECT_EQ(robot->sense(tick<SlaveClock>()).x.translation()[2], 0.3);
  EXPECT_TRUE(within(2s, [&] {
    robot->actuate(command);
    return side.take("servo_cf", n) && n == Seven{1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.0};
  }));
  EXPECT_EQ(side.frame, "base_link");
  EXPECT_FALSE(side.take("servo_cp", n));
  robot->release();
  EXPECT_TRUE(within(90ms, [&] { return side.take("servo_cf", n) && n == Seven{}; }));
}

TEST_F(Crtk, ARobotThatObeysPositionsGetsThemAlone) {
  const Publishing publishing{side, somewhere};
  const auto robot = open<Robot, 6>(in_domain("/arm") + ",names=crtk,servo=500:4:8.5");
  ASSERT_TRUE(robot->info().servo);
  EXPECT_EQ(*robot->info().servo, (Servo{Seconds{1.0 / 500}, Seconds{4e-3}, Seconds{8.5e-3}}));
  EXPECT_TRUE(within(2s, [&] {
    robot->actuate(command);
    return side.take("servo_cp", n) && n == Seven{7.0, 8.0, 9.0, 0.0, 0.6, 0.0, 0.8};
  }));
  EXPECT_EQ(side.frame, "world");
  EXPECT_FALSE(side.take("servo_cf", n));
  robot->release();
  std::this_thread::sleep_for(20ms);
  side.take("servo_cp", n);
  EXPECT_FALSE(within(150ms, [&] { return side.take("servo_cp", n); })) << "released, it stays where it is";
}

TEST_F(Crtk, TheStampZeroIsNoDataAndSilenceMayBeLonger) {
  auto publishing = std::make_unique<Publishing>(side, somewhere);
  const auto robot = open<Robot, 6>(in_domain("/arm") + ",names=crtk,silence_ms=300");
  publishing.reset();
  side.stamp_s = 0;
  publishing = std::make_unique<Publishing>(side, somewhere);
  std::this_thread::sleep_for(50ms);
  RobotSample<6> s = robot->sense(tick<SlaveClock>());
  for (int k = 0; k < 290; ++k) s = robot->sense(tick<SlaveClock>());
  EXPECT_EQ(s.status, HardwareStatus::stale);
  for (int k = 0; k < 20; ++k) s = robot->sense(tick<SlaveClock>());
  EXPECT_EQ(s.status, HardwareStatus::fault);
  const std::string why = robot->trouble();
  EXPECT_NE(why.find("nothing on /arm/measured_cp (geometry_msgs::msg::dds_::PoseStamped_) for 0.3 s"), why.npos)
      << why;
  EXPECT_EQ(why.find("of which 0 were dropped"), why.npos) << why;
  EXPECT_NE(why.find("the stamp 0, which says that there is no data"), why.npos) << why;
}

/// dVRK's name of servo_cf is body/servo_cf.
TEST_F(Ros2, WarnsOnceWhereNobodySubscribesItsCommand) {
  const Names measured{"measured_cp", "measured_cv", "measured_cf"};
  const auto said = [&](const std::string& options, const Names& read, const Names& written) {
    Ros2Side side{"/arm", static_cast<std::uint32_t>(kDomain), written, read};
    const Publishing publishing{side,
                                {{written[0], kSomewhere.at("pose")},
                                 {written[1], kSomewhere.at("twist")},
                                 {written[2], kSomewhere.at("wrench")}}};
    testing::internal::CaptureStderr();
    const auto robot = open<Robot, 1>(in_domain("/arm") + options);
    std::this_thread::sleep_for(4s);
    return testing::internal::GetCapturedStderr();
  };
  const auto warning = [](const std::string& topic) {
    return "warning: nobody subscribes to /arm/" + topic + ": no command gets to the hardware; map its topic\n";
  };
  EXPECT_EQ(said(",names=crtk", {"body/servo_cf"}, measured), warning("servo_cf"));
  EXPECT_EQ(said(",names=crtk", {"servo_cf"}, measured), "");
  EXPECT_EQ(said("", {"target_pose"}, {"pose", "twist", "wrench"}), warning("command"));
  EXPECT_EQ(said(",servo=500:4:8", {"target_pose"}, {"pose", "twist", "wrench"}), "");
}

TEST_F(Ros2, JointsByTheNamesOfCrtkGetEffortsAlone) {
  JointSide side{"/arm", static_cast<std::uint32_t>(kDomain), "measured_js", "servo_jf"};
  const PublishingJoints publishing{side, kJointsSomewhere, kLoad};
  const auto robot = open<Robot, 8>(in_domain("/arm") + ",joints=a:b:c,names=crtk", scene_of_arms());
  EXPECT_EQ(robot->sense(tick<SlaveClock>()).x.translation(), first(0.1, 0.2, 0.3));
  JointSide::State n;
  EXPECT_TRUE(within(2s, [&] {
    robot->actuate({Force<8>{first(1.5, 2.5, 3.5)}, Position<8>{first(0.5, 0.6, 0.7)}, {}});
    return side.take(n) && n.effort == std::vector{1.5, 2.5, 3.5};
  }));
  EXPECT_EQ(n.name, (Names{"a", "b", "c"}));
  EXPECT_TRUE(n.position.empty());
  std::vector<double> effort;
  EXPECT_FALSE(side.take(effort)) << "joint_effort is no name of CRTK";
}

TEST_F(Ros2, AJointWithoutANumberIsDroppedAndSilenceIsAFault) {
  JointSide::State lacks = kJointsSomewhere, nan = kJointsSomewhere, cut = kJointsSomewhere;
  lacks.name[3] = "d";
  nan.velocity[2] = std::nan("");
  cut.position.pop_back();
  for (const JointSide::State& bad : {lacks, nan, cut}) {
    JointSide side{"/arm", static_cast<std::uint32_t>(kDomain)};
    auto publishing = std::make_unique<PublishingJoints>(side, kJointsSomewhere, kLoad);
    const auto robot = open<Robot, 8>(in_domain("/arm") + ",joints=a:b:c", scene_of_arms());
    publishing.reset();
    publishing = std::make_unique<PublishingJoints>(side, bad, kLoad);
    std::this_thread::sleep_for(50ms);
    RobotSample<8> s = robot->sense(tick<SlaveClock>());
    for (int k = 0; k < 120; ++k) s = robot->sense(tick<SlaveClock>());
    EXPECT_EQ(s.status, HardwareStatus::fault);
    EXPECT_EQ(s.x.translation(), first(0.1, 0.2, 0.3));
    EXPECT_NE(robot->trouble().find("nothing on /arm/joint_states (sensor_msgs::msg::dds_::JointState_) for 0.1 s"),
              std::string::npos)
        << robot->trouble();
    EXPECT_TRUE(robot->trouble().ends_with("were dropped: without a finite position and velocity of a, b, c"))
        << robot->trouble();
    EXPECT_EQ(robot->trouble().find("of which 0 were dropped"), std::string::npos) << robot->trouble();
  }
}

TEST_F(Ros2, JointsWithoutNamesAreRefusedInWords) {
  const auto why_not = [](const std::string& arguments) -> std::string {
    try {
      open<Robot, 8>(arguments, scene_of_arms());
    } catch (const ConfigError& e) {
      return e.what();
    }
    return "opened";
  };
  EXPECT_EQ(
      why_not("/arm,domain=7"),
      "--robot ros2:/arm,domain=7: 0 joints are named, but the arm of the scene has 3; name them in its order, as in "
      "ros2:/arm,joints=shoulder:elbow:wrist, or take a URDF");
  EXPECT_NE(why_not("/arm,joints=a:b:c,servo=500:1:1").find("servo is of a tool, but space of the scene is JOINTS"),
            std::string::npos);
  EXPECT_NE(why_not("/arm,domain=7,joints=a:b").find("2 joints are named, but the arm of the scene has 3"),
            std::string::npos);
  try {
    open<Robot, 3>("/arm,domain=7,joints=a:b");
    ADD_FAILURE() << "opened";
  } catch (const ConfigError& e) {
    EXPECT_STREQ(e.what(),
                 "--robot ros2:/arm,domain=7,joints=a:b: joints are given, but space of the scene is CARTESIAN");
  }
}

// Names and types as ROS 2 gives them to DDS (design.ros2.org, topic and service names); bytes as CDR has them: numbers at multiples of their size.
TEST_F(Ros2, TopicsTypesAndBytesAreThoseOfRos) {
  Ros2Side side{"/arm", static_cast<std::uint32_t>(kDomain)};
  const Publishing publishing{side, kSomewhere};
  const auto robot = open<Robot, 1>(in_domain("/arm"));
  std::map<std::string, std::string> found;
  for (const dds_entity_t of : {DDS_BUILTIN_TOPIC_DCPSPUBLICATION, DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION}) {
    const dds_entity_t reader = dds_create_reader(side.participant(), of, nullptr, nullptr);
    void* sample = nullptr;
    dds_sample_info_t info;
    for (; dds_take(reader, &sample, &info, 1, 1) > 0; dds_return_loan(reader, &sample, 1)) {
      const auto& e = *static_cast<dds_builtintopic_endpoint_t*>(sample);
      dds_reliability_kind_t kind{};
      dds_qget_reliability(e.qos, &kind, nullptr);
      const bool reliable = kind == DDS_RELIABILITY_RELIABLE, writes = of == DDS_BUILTIN_TOPIC_DCPSPUBLICATION;
      // The side's own readers and writers are reliable as well.
      if (!writes && reliable) continue;
      found[e.topic_name] = std::string{writes ? "writes " : "reads "} + e.type_name;
    }
  }
  const auto type = [](const std::string& name) { return "geometry_msgs::msg::dds_::" + name + "_"; };
  EXPECT_EQ(found["rt/arm/command"], "writes " + type("WrenchStamped"));
  EXPECT_EQ(found["rt/arm/target_pose"], "writes " + type("PoseStamped"));
  EXPECT_EQ(found["rt/arm/target_twist"], "writes " + type("TwistStamped"));
  EXPECT_EQ(found["rt/arm/pose"], "reads " + type("PoseStamped"));
  EXPECT_EQ(found["rt/arm/twist"], "reads " + type("TwistStamped"));
  EXPECT_EQ(found["rt/arm/wrench"], "reads " + type("WrenchStamped"));

  RobotCommand<1> command;
  command.f = Force<1>{Force<1>::Vector{3.25}};
  ddsi_serdata* data = nullptr;
  dds_sample_info_t info;
  ASSERT_TRUE(within(2s, [&] {
    robot->actuate(command);
    return dds_takecdr(side.reader("command"), &data, 1, &info, DDS_ANY_STATE) == 1;
  }));
  ASSERT_EQ(ddsi_serdata_size(data), 4U + 24U + 48U);
  std::vector<unsigned char> bytes(ddsi_serdata_size(data));
  ddsi_serdata_to_ser(data, 0, bytes.size(), bytes.data());
  ddsi_serdata_unref(data);
  EXPECT_EQ(std::string(bytes.begin(), bytes.begin() + 3), std::string("\0\1\0", 3)) << "CDR, little endian";
  const auto at = [&]<class Value>(std::size_t offset, Value value) {
    std::memcpy(&value, bytes.data() + 4 + offset, sizeof value);
    return value;
  };
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  EXPECT_NEAR(at(0, std::int32_t{}), std::chrono::duration<double>(now).count(), 10.0);
  EXPECT_LT(at(4, std::uint32_t{}), 1'000'000'000U);
  EXPECT_EQ(at(8, std::uint32_t{}), 6U);
  EXPECT_STREQ(reinterpret_cast<const char*>(bytes.data()) + 16, "world");
  EXPECT_EQ(at(24, 0.0), 3.25);
  EXPECT_EQ(at(32, 0.0), 0.0);
}

TEST_F(Ros2, ArgumentsAndMissingTopicsAreRefusedInWords) {
  const auto why_not = [](const std::string& arguments) -> std::string {
    try {
      open<Robot, 3>(arguments);
    } catch (const ConfigError& e) {
      return e.what();
    }
    return "opened";
  };
  for (const std::string bad :
       {"", "/", "/1arm", "/arm/", "/a//b", "/arm,domain=233", "/arm,domain=-1", "/arm,domain=", "/a b"})
    EXPECT_EQ(why_not(bad).find("--robot ros2:" + bad + ": name the namespace"), 0U) << why_not(bad);
  for (const auto& [option, why] :
       std::map<std::string, std::string>{{"rate=3", R"("rate=3"; options are domain=N, joints=)"},
                                          {"names=ros", R"("names=ros"; options are )"},
                                          {"frame=", R"("frame="; options are )"},
                                          {"servo=500", R"(servo's delay in ms "" is no number from 0 to 1000)"},
                                          {"servo=5:1:1", R"(servo's rate in Hz "5" is no number from 10 to 10000)"},
                                          {"servo=500:1:1e3", R"(servo's lag in ms "1e3" is no number from 0 to 1000)"},
                                          {"silence_ms=5", R"(silence_ms "5" is no number from 10 to 10000)"}})
    EXPECT_EQ(why_not("/arm," + option).find("--robot ros2:/arm," + option + ": " + why), 0U)
        << why_not("/arm," + option);
  try {
    open<Device, 3>("/arm,servo=500:1:1");
    ADD_FAILURE() << "opened";
  } catch (const ConfigError& e) {
    EXPECT_NE(std::string{e.what()}.find("servo is of a robot that obeys positions only"), std::string::npos);
  }
  EXPECT_NE(why_not(std::string(100000, 'a')).find("name the namespace"), std::string::npos);
  setenv("ROS_DOMAIN_ID", "many", 1);
  EXPECT_EQ(why_not("/arm").find("--robot ros2:/arm with ROS_DOMAIN_ID=many: name"), 0U);
  setenv("ROS_DOMAIN_ID", std::to_string(kDomain).c_str(), 1);
  EXPECT_EQ(why_not("/nobody"),
            "--robot ros2:/nobody with ROS_DOMAIN_ID=" + std::to_string(kDomain) +
                ": nothing on /nobody/pose (geometry_msgs::msg::dds_::PoseStamped_) for 5 s; 0 messages had come, of "
                "which 0 were dropped: numbers that are not finite, or a quaternion that is no rotation");
  unsetenv("ROS_DOMAIN_ID");
}

/// Master and slave over the robot of the stand-in.
struct Live {
  explicit Live(const Words& stand_in, const Words& more = {}) {
    // Of all that is started here, where it is permitted, so that other load does not look like a robot that is silent.
    const sched_param first{1};
    sched_setscheduler(0, SCHED_RR, &first);
    std::string scene = press(3);
    // FORCE_PROJECTED holds a part of a press only.
    const std::string method = "FORCE_PROJECTED";
    scene.replace(scene.find(method), method.size(), "INTERNAL_MODEL");
    pair.emplace(scene);
    robot.emplace(stand_in);
    Words of_slave = more;
    of_slave.insert(of_slave.end(), {"--robot", "ros2:" + in_domain("/arm")});
    slave.emplace(pair->listening_slave("slave", of_slave));
    master.emplace(pair->master("master", more));
  }
  std::optional<Pair> pair;
  std::optional<Process> robot, slave, master;
};

TEST_F(Ros2, TheHandFeelsTheWallOfARobotBehindTopics) {
  // Where the computer is so busy that the stand-in gets no processor for 0.1 s, a run ends, as it must; the next one counts.
  std::optional<Live> run;
  for (int tries = 3; tries > 0; --tries) {
    run.emplace(Words{TWOPORT_STAND_IN, "/arm", std::to_string(kDomain)});
    if (run->slave->wait() == exited(0)) break;
  }
  Live& live = *run;
  ASSERT_EQ(live.slave->wait(), exited(0)) << live.slave->err();
  ASSERT_EQ(live.master->wait(), exited(0)) << live.master->err();
  const schema::Summary m = live.pair->summary("master"), s = live.pair->summary("slave");
  EXPECT_GT(m.coupled_share(), 0.8);
  if (!kept_time({m, s})) return;
  const Trace felt = live.pair->trace("master"), pressed = live.pair->trace("slave");
  const double at_end = pressed["env_f_0"].back();
  EXPECT_GT(std::abs(at_end), 1.0);
  EXPECT_NEAR(std::abs(felt["master_f_0"].back()), std::abs(at_end), 0.15 * std::abs(at_end));
  EXPECT_NEAR(pressed["slave_x_0"].back(), 0.02 + std::abs(at_end) / 5000.0, 1e-4);
  EXPECT_GE(m.min_port_energy_j(), -1e-3);
}

// A URDF names them.
TEST_F(Ros2, JointsHaveTheNamesOfTheUrdf) {
  Names overrides;
  for (const std::string side : {"device", "robot"}) {
    overrides.push_back(side + ".arm.file=../../../arms/six_joints.urdf");
    overrides.push_back(side + ".arm.joint_position_rad=[0,-1,1,0,1,0]");
  }
  const Scene scene = scene_of_arms(overrides);
  JointSide::State states{{}, {1, 2, 3, 4, 5, 6}, {6, 5, 4, 3, 2, 1}, {}};
  for (const ArmJoint& joint : scene.robot->arm->parameters->joints) states.name.push_back(joint.name);
  std::swap(states.name[0], states.name[5]);
  JointSide side{"/arm", static_cast<std::uint32_t>(kDomain)};
  const PublishingJoints publishing{side, states, states};
  const DeviceSample<8> hand = open<Device, 8>(in_domain("/arm"), scene)->sense(tick<MasterClock>());
  Force<8>::Vector expected;
  expected << 6, 2, 3, 4, 5, 1, 0, 0;
  EXPECT_EQ(hand.x.translation(), expected);
}

TEST_F(Ros2, LeaderAndFollowerBehindTopicsPressJointByJoint) {
  const sched_param priority{1};
  sched_setscheduler(0, SCHED_RR, &priority);
  const auto arm = [](const std::string& is) { return "ros2:" + in_domain("/" + is) + ",joints=q1:q2:q3"; };
  std::optional<Pair> pair;
  for (int tries = 3; tries > 0; --tries) {
    pair.emplace(two_arms(TWOPORT_EXAMPLES));
    Process leader = stand_in("/leader", {"leader"}), follower = stand_in("/follower", {"follower"});
    Process slave = pair->listening_slave("slave", {"--robot", arm("follower")});
    Process master = pair->master("master", {"--device", arm("leader")});
    const Exit of_master = master.wait(), of_slave = slave.wait();
    if (of_master == exited(0) && of_slave == exited(0)) break;
    ASSERT_GT(tries, 1) << master.err() << slave.err();
  }
  const schema::Summary m = pair->summary("master"), s = pair->summary("slave");
  EXPECT_GT(m.coupled_share(), 0.8);
  if (!kept_time({m, s})) return;
  const Trace felt = pair->trace("master"), pressed = pair->trace("slave");
  const double pressed_n_m = pressed.peak("env_f_0", 1.4, 1.6);
  EXPECT_GT(pressed_n_m, 2.0);
  EXPECT_NEAR(felt.peak("master_f_0", 1.4, 1.6), pressed_n_m, 0.2 * pressed_n_m);
  EXPECT_GT(felt.peak("master_x_0", 0.0, 3.0), 0.32);
  EXPECT_LT(pressed.peak("slave_x_0", 0.0, 3.0), 0.31) << "the wall";
}

TEST_F(Ros2, ARobotThatDiesOrSendsNoNumbersLetsTheHandGo) {
  for (const bool dies : {true, false}) {
    Words words{TWOPORT_STAND_IN, "/arm", std::to_string(kDomain)};
    if (!dies) words.insert(words.end(), {"2", "nan"});
    Live live{words, {"--set", "duration_s=3", "--set", "control.release_after_s=0.3"}};
    if (dies) {
      live.pair->await("master", 1.1);
      live.robot->send(SIGKILL);
    }
    EXPECT_EQ(live.slave->wait(), exited(1)) << live.slave->err();
    const std::string why = live.slave->err();
    // Pose and wrench stop together; which is found missing first is a matter of chance. One that is not stopped may get no processor for as
    // long.
    const bool pose =
        why.find(": nothing on /arm/pose (geometry_msgs::msg::dds_::PoseStamped_) for 0.1 s") != std::string::npos;
    const bool wrench =
        why.find(": nothing on /arm/wrench (geometry_msgs::msg::dds_::WrenchStamped_) for 0.1 s") != std::string::npos;
    EXPECT_TRUE(pose || wrench) << why;
    if (pose) {
      EXPECT_EQ(why.find("of which 0 were dropped") == std::string::npos, !dies) << why;
    }
    EXPECT_EQ(live.master->wait(), exited(3)) << "not coupled to the end: " << live.master->err();
    const Trace felt = live.pair->trace("master");
    if (dies) {
      EXPECT_GT(felt.peak("master_f_0", 0.8, 1.1), 0.5);
    }
    EXPECT_EQ(felt["master_f_0"].back(), 0.0) << live.master->err();
  }
}

// From one process to another and back, through the driver and by Cyclone DDS alone. Printed, not judged.
TEST_F(Ros2, LatencyThroughTheDriverAndWithoutIt) {
  Process through = stand_in("/through", {"echo"}), raw = stand_in("/raw", {"echo"});
  const auto robot = open<Robot, 1>(in_domain("/through"));
  Ros2Side side{"/unused", static_cast<std::uint32_t>(kDomain)};
  const dds_entity_t in = side.participant();
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_BEST_EFFORT, 0);
  const dds_entity_t reader = dds_create_reader(
      in, dds_create_topic(in, &geometry_msgs_msg_dds__PoseStamped__desc, "rt/raw/pose", nullptr, nullptr), qos,
      nullptr);
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, 0);
  const dds_entity_t writer = dds_create_writer(
      in, dds_create_topic(in, &geometry_msgs_msg_dds__WrenchStamped__desc, "rt/raw/command", nullptr, nullptr), qos,
      nullptr);
  dds_delete_qos(qos);
  const auto send_raw = [&](double value) {
    char frame[] = "world";
    const geometry_msgs_msg_dds__WrenchStamped_ wrench{{{0, 0}, frame}, {{value, 0, 0}, {0, 0, 0}}};
    dds_write(writer, &wrench);
  };
  const auto raw_position = [&] {
    static double x = 0.0;
    void* sample = nullptr;
    dds_sample_info_t info;
    for (; dds_take(reader, &sample, &info, 1, 1) > 0; dds_return_loan(reader, &sample, 1))
      x = static_cast<geometry_msgs_msg_dds__PoseStamped_*>(sample)->pose.position.x;
    return x;
  };
  RobotCommand<1> command;
  const auto send = [&](double value) {
    command.f = Force<1>{Force<1>::Vector{value}};
    robot->actuate(command);
  };
  const auto position = [&] { return robot->sense(tick<SlaveClock>(0.0)).x.translation()[0]; };
  std::vector<double> us[2];
  constexpr int kRounds = 2000, kWarmUp = 100;
  for (int k = 1; k <= kRounds + kWarmUp; ++k)
    for (const bool driver : {false, true}) {
      const auto begun = steady_clock::now();
      driver ? send(k) : send_raw(k);
      while ((driver ? position() : raw_position()) != k && steady_clock::now() - begun < 100ms) {
      }
      if (k > kWarmUp)
        us[driver].push_back(std::chrono::duration<double, std::micro>(steady_clock::now() - begun).count());
    }
  for (const bool driver : {false, true}) {
    std::sort(us[driver].begin(), us[driver].end());
    const auto at = [&](double share) { return us[driver][static_cast<std::size_t>(share * (kRounds - 1))]; };
    std::printf("round trip %s: %.0f us in the median, 99 %% within %.0f us\n",
                driver ? "through the driver" : "by DDS alone", at(0.5), at(0.99));
    EXPECT_LT(at(0.5), 50e3) << "messages are lost";
  }
}

}  // namespace
}  // namespace twoport::test::ros2_test
