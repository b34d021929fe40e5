// Two arms on the page: the pointer as a hand at the leader's tool, and what the page is shown of the tools and joints.

#include <gtest/gtest.h>

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "common/hardware/adjustable_environment.h"
#include "common/page/describe.h"
#include "common/scene/load.h"
#include "drivers/drivers.h"
#include "master/page_samples.h"
#include "tests/support/no_alloc.h"

namespace twoport::page_joints_test {
namespace {

constexpr int N = kJointPort;
constexpr double kPeriod = 1e-3;

struct Rig {
  explicit Rig(const std::string& name = "leader_follower")
      : scene{load_scene(TWOPORT_SCENES "/" + name + ".textproto", {}, SceneFor::live)} {
    page.begin(scene);
    device = all_drivers().devices.open<N>("page", scene, Seconds{kPeriod}, page.channel());
  }
  /// `at`: of the pointer; null: it does not hold.
  DeviceSample<N> run(int ticks, const std::array<double, 6>* at) {
    DeviceSample<N> s;
    for (const long end = k + ticks; k < end; ++k) {
      if (at && k % 16 == 0) page.channel()->hand.try_push({PageCommand::Kind::target, 0, *at});
      s = device->sense({Instant<MasterClock>{tick_time(k, 1 / kPeriod)}, Seconds{kPeriod}, Seconds{kPeriod}});
      device->actuate(torque);
    }
    return s;
  }

  struct Output {
    Force<N> command{}, wanted{};
    Energy dissipated{}, undissipated{};
    Mode mode = Mode::coupled;
  };
  PageSample shown(const DeviceSample<N>& leader, const PeerState<N>& follower, const Output& out) {
    page.show(Duration{0}, Duration{0}, leader, out, Energy{}, &follower, {}, {}, 0);
    page.show(Duration{0}, Duration{0}, leader, out, Energy{}, &follower, {}, {}, 0);  // every second tick is shown
    PageSample s;
    EXPECT_TRUE(page.channel()->samples.try_pop(s));
    return s;
  }

  Scene scene;
  PageSamples page;
  std::unique_ptr<Device<N>> device;
  Force<N> torque;
  long k = 0;
};

Eigen::Vector3d vector_of(const PageSample::Vector& v) {
  return {v[0], v[1], v[2]};
}

TEST(PageLeader, ThePointerPlacesAndTurnsTheTool) {
  Rig rig;
  const std::array<double, 6> target{0.03, -0.02, 0.04, 0.1, 0.0, 0.2};
  const DeviceSample<N> leader = rig.run(4000, &target);
  EXPECT_TRUE(leader.held);
  EXPECT_LT(leader.v.vec().norm(), 1e-3);
  const PageSample s = rig.shown(leader, {}, {});
  // The page computes the tool from the joints, by the arm's parameters.
  EXPECT_LT((vector_of(s.hand_x_m) - Eigen::Vector3d{0.03, -0.02, 0.04}).norm(), 1e-4);
  const Eigen::Quaterniond q{s.hand_attitude[0], s.hand_attitude[1], s.hand_attitude[2], s.hand_attitude[3]};
  EXPECT_LT((rotation_vector(q) - Eigen::Vector3d{0.1, 0.0, 0.2}).norm(), 1e-3);
  EXPECT_EQ(s.handle_x_m, s.hand_x_m);
  EXPECT_EQ(s.leader_rad[7], 0.0);
  EXPECT_EQ(s.joint_rad[1], -0.5) << "before the first report the follower stands where the scene begins";
}

/// Torques Jᵀ f push the hand away by f / k; the page shows f.
TEST(PageLeader, AForceAtTheToolDisplacesTheHandByItsStiffness) {
  Rig rig;
  rig.page.channel()->hand.try_push({PageCommand::Kind::grip, 0, {1000.0}});
  const JointTool tool{rig.scene.control.leader, rig.scene.control.joint_scale};
  const std::array<double, 6> target{};
  const Eigen::Vector3d f{1.0, -2.0, 5.0};
  DeviceSample<N> leader = rig.run(1, &target);
  for (int i = 0; i < 400; ++i) {
    rig.torque = Force<N>{tool.at(leader.x).J.topRows<3>().transpose() * f};
    leader = rig.run(10, &target);
  }
  const PageSample s = rig.shown(leader, {}, {.command = rig.torque, .wanted = 2.0 * rig.torque});
  EXPECT_LT((vector_of(s.hand_x_m) + f / 1000.0).norm(), 1e-4);
  EXPECT_LT((vector_of(s.felt_n) + f).norm(), 1e-3);
  EXPECT_LT((vector_of(s.unlimited_n) + 2.0 * f).norm(), 1e-3);
  for (int i = 0; i < N; ++i) EXPECT_EQ(s.leader_torque[static_cast<std::size_t>(i)], rig.torque[i]);
}

TEST(PageLeader, WithoutAPageItIsReleasedAndComesToRest) {
  Rig rig;
  const std::array<double, 6> target{0.05, 0.0, 0.03, 0.0, 0.0, 0.0};
  ASSERT_TRUE(rig.run(200, &target).held);
  EXPECT_TRUE(rig.run(240, nullptr).held);
  DeviceSample<N> s = rig.run(20, nullptr);
  EXPECT_FALSE(s.held);
  s = rig.run(5000, nullptr);
  EXPECT_LT(s.v.vec().norm(), 1e-3);
  // No hand holds against a torque.
  rig.torque = Force<N>{Force<N>::Vector::Unit(0)};
  EXPECT_LT(rig.run(500, nullptr).x.translation()[0], s.x.translation()[0] - 0.01);
}

TEST(PageOfTwoArms, ShowsBothToolsAndAllJointsWithoutAllocation) {
  Rig rig;
  const std::array<double, 6> target{0.0, 0.0, -0.02, 0.0, 0.0, 0.0};
  const DeviceSample<N> leader = rig.run(2000, &target);
  const JointTool tool{rig.scene.control.follower, rig.scene.control.joint_scale};
  PeerState<N> follower;
  follower.has_report = true;
  follower.newest.x = leader.x;
  follower.newest.v = Velocity<N>{Velocity<N>::Vector::Unit(3)};
  const Eigen::Vector3d f{0.0, 1.0, -8.0};
  follower.newest.f_environment = Force<N>{tool.at(leader.x).J.topRows<3>().transpose() * f};
  PageSample s;
  {
    NoAlloc guard;
    rig.run(20, &target);
    rig.run(300, nullptr);
    s = rig.shown(leader, follower, {});
    EXPECT_EQ(guard.seen(), 0);
  }
  EXPECT_EQ(s.robot_x_m, s.hand_x_m) << "the same arm at the same joints";
  EXPECT_EQ(s.joint_rad, s.leader_rad);
  EXPECT_LT((vector_of(s.environment_n) - f).norm(), 1e-6);
  EXPECT_LT((vector_of(s.robot_v_m_per_s) - tool.at(leader.x).J.col(3).head<3>()).norm(), 1e-12);
  for (int i = 0; i < N; ++i)
    EXPECT_EQ(s.follower_torque[static_cast<std::size_t>(i)], follower.newest.f_environment[i]);
}

TEST(PageOfTwoArms, IsIntroducedWithBothArms) {
  const Rig rig;
  const std::string text = describe_for_page(rig.scene, {.device = "d", .methods = {}});
  EXPECT_NE(text.find(R"("dof":6,"joints":7)"), text.npos) << text;
  EXPECT_NE(text.find(R"("leader":{"joints":[{)"), text.npos) << text;
  EXPECT_NE(text.find(R"("links":null)"), text.npos) << "of the same file as the robot's";
  EXPECT_NE(text.find(R"(["leader_torque",8])"), text.npos) << text;
  EXPECT_LT(text.size(), 8000u);
}

/// The simulated robot says where its object is; the page is shown that, and its size.
TEST(PageOfTwoArms, ShowsTheObjectThatTheFingersTake) {
  Rig rig{"leader_follower_gripper"};
  const std::string text = describe_for_page(rig.scene, {.device = "d", .methods = {}});
  EXPECT_NE(text.find(R"("object_half_size_m":[0.02,0.03,0.03])"), text.npos) << text;
  EXPECT_NE(text.find(R"(["object_x_m",3])"), text.npos) << text;
  EXPECT_NE(text.find(R"("slides":true,"mirrored":true)"), text.npos) << "two fingers";
  const DeviceSample<N> leader = rig.run(1, nullptr);
  const PageSample::Vector starts{0.0, 0.0, -0.1204};
  EXPECT_EQ(rig.shown(leader, {}, {}).object_x_m, starts);

  const auto robot = all_drivers().robots.open<N>("sim", rig.scene, Seconds{kPeriod});
  EnvironmentMessage message;
  robot->environment()->describe(message);
  EXPECT_TRUE(message.has_object);
  EXPECT_EQ(message.object_m, starts);
  message.object_m = {0.01, 0.02, -0.05};
  rig.page.note_environment(message, Registration<N>{rig.scene.control});
  EXPECT_EQ(rig.shown(leader, {}, {}).object_x_m, message.object_m);

  const auto without = all_drivers().robots.open<N>("sim", Rig{}.scene, Seconds{kPeriod});
  without->environment()->describe(message = {});
  EXPECT_FALSE(message.has_object);
}

TEST(PageIntroduction, NamesTheAxesWithoutAMotorAndWhereBothSidesBegin) {
  const Scene scene = load_scene(TWOPORT_SCENES "/assembly.textproto",
                                 std::vector<std::string>{"device.motors=[0, 1, 2]"}, SceneFor::live);
  const std::string text = describe_for_page(scene, {.device = "d", .methods = {}});
  EXPECT_NE(text.find(R"("home_m":[0,0,0.03],"robot_home_m":[0.0015,-0.001,0.03],"without_motor":[3,4,5])"), text.npos)
      << text;
}

}  // namespace
}  // namespace twoport::page_joints_test
