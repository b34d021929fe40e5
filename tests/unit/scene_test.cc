#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <google/protobuf/text_format.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <limits>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/scene/load.h"
#include "common/scene/summary.h"
#include "proto/scene.pb.h"
#include "proto/summary.pb.h"

namespace twoport {
namespace {

using Eigen::Vector3d;

template <class S>
S shape_of(const EnvironmentSpec& spec) {
  return std::get<S>(std::get<Surface>(spec).shape);
}
Material material_of(const EnvironmentSpec& spec) {
  return std::get<Surface>(spec).material;
}

using Overrides = std::vector<std::string>;

// The two scenes that fix the grammar, and one in 6 DoF that has every block and every list.
const char* const kStiffWall = R"(# A hand presses a stiff wall and slides along it, over 50 ms and 5 % loss each way.
name: "stiff wall at 50 ms"
dof: 3
duration_s: 8
rate_hz: 2000
seed: 7
operator {
  hand { mass_kg: 0.02 stiffness_n_per_m: 300 damping_n_s_per_m: 1 }
  path { move_to { position_m: [0.03, 0, 0] duration_s: 1 } }
  path { sine { axis: 1 amplitude_m: 0.04 frequency_hz: 0.5 duration_s: 4 } }
  path { hold { duration_s: 1 } }
}
device { mass_kg: 0.075 damping_n_s_per_m: 0.05 max_force_n: 8.5 }
control {
  architecture: POSITION_FORCE
  virtual_coupling { stiffness_n_per_m: 1000 damping_n_s_per_m: 20 }
  passivity { method: FORCE_PROJECTED }
}
to_slave  { delay_ms: 50 loss: 0.05 }
to_master { delay_ms: 50 loss: 0.05 }
robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { } }
environment { wall { normal: [-1, 0, 0] offset_m: -0.02 stiffness_n_per_m: 5000 } }
expect {
  stable: true
  at_least { key: "min_port_energy_j" value: -1e-4 }
  at_most  { key: "force_direction_error_max_deg" value: 1e-6 }
}
)";

const char* const kHeldSpring = R"(# A sampled spring, nobody holding the handle: unstable above 2.0 kN/m.
name: "held spring"
dof: 1
duration_s: 60
rate_hz: 2000
device { mass_kg: 0.075 damping_n_s_per_m: 0.5 position_m: [0.001] velocity_estimate: BACKWARD_DIFFERENCE }
control { architecture: RENDER passivity { method: NONE } }
environment { spring { stiffness_n_per_m: 2000 damping_n_s_per_m: 0 anchor_m: [0] } }
)";

const char* const kTurning = R"(
dof: 6
duration_s: 2
operator {
  hand { stiffness_n_per_m: 300 rotational_stiffness_n_m_per_rad: 2 rotational_damping_n_m_s_per_rad: 0.1 }
  path { hold { duration_s: 1 } }
  path { move_to { position_m: [0, 0, 0.1, 0, 1, 0, 0] duration_s: 1 } }
  path { sine { axis: 5 amplitude_m: 0.1 frequency_hz: 1 duration_s: 1 } }
  path { screw { point_m: [0, 0, 1] axis: [0, 0, 1] angle_rad: 0.1 travel_m: 0.1 frequency_hz: 1 duration_s: 1 } }
  tremor { rms_m: 1e-4 }
}
device { mass_kg: 0.1 inertia_kg_m2: 1e-4 rotational_damping_n_m_s_per_rad: 1e-3
         position_m: [0, 0, 0.1, 1, 0, 0, 0] velocity_m_per_s: [0, 0, 0, 0, 0, 1] }
control { virtual_coupling { rotational_stiffness_n_m_per_rad: 5 rotational_damping_n_m_s_per_rad: 0.3 } passivity { } }
to_slave { burst { p: 0.1 r: 0.5 } blackout { start_s: 1 duration_s: 1 } }
to_master { burst { p: 0.1 r: 0.5 } blackout { start_s: 1 duration_s: 1 } }
robot { mass_kg: 0.5 inertia_kg_m2: [1e-3, 2e-3, 3e-3] rotational_damping_n_m_s_per_rad: 0.01
        position_m: [1, 2, 3] velocity_m_per_s: [4, 5, 6]
        force_sensor { noise_n: 0.01 bias_n: [0, 0, 0, 1, 2, 3] latency_ms: 2 } }
environment { sphere { center_m: [0, 0, -1] radius_m: 0.9 stiffness_n_per_m: 100 damping_n_s_per_m: 1 friction: 0.3
                       viscous_friction_n_s_per_m: 2 } }
environment { cylinder { point_m: [1, 0, 0] axis: [0, 0, 2] radius_m: 0.1 stiffness_n_per_m: 100 } }
environment { box { center_m: [0, 1, 0] half_size_m: [0.1, 0.2, 0.3] stiffness_n_per_m: 100 } }
environment { spring { stiffness_n_per_m: 10 damping_n_s_per_m: 0.5 anchor_m: [0, 0, 0.1] } }
environment { wall { normal: [0, 3, 4] stiffness_n_per_m: 100 } }
tool { contact_point { position_m: [0, 0, 0.05] } contact_point { position_m: [0.01, 0, 0.05] } }
simulation { integrator: RK4 substeps: 3 }
expect { at_least { key: "drift_m" value: 0 } at_most { key: "drift_m" value: 1 } }
)";

Scene scene_of(const std::string& text, const Overrides& overrides = {}) {
  return parse_scene(text, "scenes/x.textproto", overrides);
}

/// The sentence of the error that reading `text` makes; empty if it reads.
std::string complaint(const std::string& text, const Overrides& overrides = {}) {
  try {
    static_cast<void>(scene_of(text, overrides));
    return "";
  } catch (const ConfigError& e) {
    return e.what();
  }
}

::testing::AssertionResult says(const std::string& sentence, const std::vector<std::string>& words) {
  for (const std::string& word : words)
    if (sentence.find(word) == std::string::npos)
      return ::testing::AssertionFailure() << "\"" << sentence << "\" does not say \"" << word << "\"";
  return ::testing::AssertionSuccess();
}

/// A directory of its own, gone when the test is.
class Folder {
 public:
  Folder() {
    const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
    std::string name = std::string{"twoport_"} + test->test_suite_name() + "_" + test->name();
    path_ = std::filesystem::path{::testing::TempDir()} / (name + "_" + std::to_string(::getpid()));
    std::filesystem::remove_all(path_);
    std::filesystem::create_directories(path_);
  }
  ~Folder() { std::filesystem::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

  [[nodiscard]] std::string file(const std::string& name) const { return (path_ / name).string(); }
  void put(const std::string& name, const std::string& text) const { std::ofstream{path_ / name} << text; }
  [[nodiscard]] std::set<std::string> names() const {
    std::set<std::string> all;
    for (const auto& entry : std::filesystem::directory_iterator{path_}) all.insert(entry.path().filename().string());
    return all;
  }

 private:
  std::filesystem::path path_;
};

std::string text_of(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream{path}.rdbuf();
  return text.str();
}

// ---- what a good scene says

TEST(Scene, ReadsTheStiffWallOfTheContract) {
  const Scene s = scene_of(kStiffWall);
  EXPECT_EQ(s.name, "stiff wall at 50 ms");
  EXPECT_EQ(s.dof, 3);
  EXPECT_EQ(s.axes(), 3);
  EXPECT_EQ(s.duration_s, 8.0);
  EXPECT_EQ(s.rate_hz, 2000.0);
  EXPECT_EQ(s.seed, 7U);

  ASSERT_TRUE(s.human && s.human->hand);
  EXPECT_EQ(s.human->hand->mass_kg, 0.02);
  EXPECT_EQ(s.human->hand->stiffness_n_per_m, 300.0);
  EXPECT_EQ(s.human->hand->damping_n_s_per_m, 1.0);
  ASSERT_EQ(s.human->path.size(), 3U);
  EXPECT_EQ(std::get<MoveToSpec>(s.human->path[0]).position_m, (Numbers{0.03, 0, 0}));
  EXPECT_EQ(std::get<MoveToSpec>(s.human->path[0]).duration_s, 1.0);
  const auto& sine = std::get<SineSpec>(s.human->path[1]);
  EXPECT_EQ(sine.axis, 1);
  EXPECT_EQ(sine.amplitude_m, 0.04);
  EXPECT_EQ(sine.frequency_hz, 0.5);
  EXPECT_EQ(sine.duration_s, 4.0);
  EXPECT_EQ(std::get<HoldSpec>(s.human->path[2]).duration_s, 1.0);

  ASSERT_TRUE(s.device);
  EXPECT_EQ(s.device->mass_kg, 0.075);
  EXPECT_EQ(s.device->damping_n_s_per_m, 0.05);
  EXPECT_EQ(s.device->max_force_n, 8.5);
  EXPECT_EQ(s.control.architecture, Architecture::position_force);
  EXPECT_EQ(s.control.handle_mass_kg, 0.075);  // the device's
  EXPECT_EQ(s.control.coupling.stiffness_n_per_m, 1000.0);
  EXPECT_EQ(s.control.coupling.damping_n_s_per_m, 20.0);
  EXPECT_EQ(s.control.controller.method, Method::force_projected);
  EXPECT_EQ(s.to_slave.delay_s, 0.05);
  EXPECT_EQ(s.to_slave.loss, 0.05);
  EXPECT_EQ(s.to_master.delay_s, 0.05);
  ASSERT_TRUE(s.robot && s.robot->force_sensor);
  EXPECT_EQ(s.robot->mass_kg, 0.5);
  EXPECT_EQ(s.robot->damping_n_s_per_m, 2.0);
  ASSERT_EQ(s.environment.size(), 1U);
  const Wall wall = shape_of<Wall>(s.environment[0]);
  EXPECT_EQ(wall.normal, Vector3d(-1, 0, 0));
  EXPECT_EQ(wall.offset_m, -0.02);
  EXPECT_EQ(material_of(s.environment[0]).stiffness_n_per_m, 5000.0);
  EXPECT_EQ(s.expect.stable, true);
  ASSERT_EQ(s.expect.at_least.size(), 1U);
  EXPECT_EQ(s.expect.at_least[0].key, "min_port_energy_j");
  EXPECT_EQ(s.expect.at_least[0].value, -1e-4);
  ASSERT_EQ(s.expect.at_most.size(), 1U);
  EXPECT_EQ(s.expect.at_most[0].key, "force_direction_error_max_deg");
}

TEST(Scene, ReadsHowTheWorldIsStepped) {
  EXPECT_EQ(scene_of(kStiffWall).simulation.integrator, Integrator::exact);
  const Scene s = scene_of(kStiffWall, {"simulation.integrator=SYMPLECTIC_EULER", "simulation.substeps=10"});
  EXPECT_EQ(s.simulation.integrator, Integrator::symplectic_euler);
  EXPECT_EQ(s.simulation.substeps, 10);
  EXPECT_TRUE(says(complaint(kStiffWall, {"simulation.substeps=0"}), {"simulation.substeps is 0", "1 to 10000"}));
  EXPECT_EQ(complaint(kStiffWall, {"simulation.integrator=TRAPEZOIDAL"}), "");
  EXPECT_TRUE(says(complaint(kStiffWall, {"simulation.integrator=TRAPEZOIDAL", "environment[0].wall.friction=0.1"}),
                   {"simulation.integrator is TRAPEZOIDAL", "one wall without friction"}));
}

TEST(Scene, OfABodyAloneHasNothingElse) {
  const std::string body =
      "dof: 1 duration_s: 1 control { architecture: UNCONTROLLED } environment { spring { stiffness_n_per_m: 1 } }";
  EXPECT_TRUE(says(complaint(body, {}), {"robot is missing", "UNCONTROLLED"}));
  EXPECT_EQ(complaint(body, {"robot.mass_kg=1"}), "");
  EXPECT_TRUE(says(complaint(body, {"robot.mass_kg=1", "device.mass_kg=1"}), {"device is given", "UNCONTROLLED"}));
}

TEST(Scene, ReadsAScrewAndATremor) {
  const Scene s = scene_of(kStiffWall, {"operator.tremor={rms_m: 1.5e-4}",
                                        "operator.path[3].screw={point_m: [1, 2, 3] axis: [0, 3, 4] angle_rad: 0.5 "
                                        "travel_m: 0.03 frequency_hz: 0.5 duration_s: 2}"});
  EXPECT_FALSE(scene_of(kStiffWall).human->tremor);
  ASSERT_TRUE(s.human->tremor);
  EXPECT_EQ(s.human->tremor->rms_m, 1.5e-4);
  EXPECT_EQ(s.human->tremor->low_hz, 2.0);
  EXPECT_EQ(s.human->tremor->high_hz, 12.0);
  const auto& screw = std::get<ScrewSpec>(s.human->path.at(3));
  EXPECT_EQ(screw.point_m, (Numbers{1, 2, 3}));
  EXPECT_NEAR(screw.axis[1], 0.6, 1e-15);
  EXPECT_NEAR(screw.axis[2], 0.8, 1e-15);
  EXPECT_EQ(screw.angle_rad, 0.5);
  EXPECT_EQ(screw.travel_m, 0.03);
  EXPECT_EQ(screw.frequency_hz, 0.5);
  EXPECT_EQ(screw.duration_s, 2.0);
}

TEST(Scene, ReadsTheHeldSpringOfTheContract) {
  const Scene s = scene_of(kHeldSpring);
  EXPECT_EQ(s.axes(), 1);
  EXPECT_FALSE(s.human || s.robot);
  ASSERT_TRUE(s.device);
  EXPECT_EQ(s.device->position_m, Numbers{0.001});
  EXPECT_EQ(s.device->velocity_estimate, VelocityEstimate::backward_difference);
  EXPECT_EQ(s.control.architecture, Architecture::render);
  EXPECT_EQ(s.control.controller.method, Method::none);
  const auto& spring = std::get<Spring>(s.environment.at(0));
  EXPECT_EQ(spring.stiffness_n_per_m, 2000.0);
  EXPECT_EQ(spring.anchor_m, Vector3d(0, 0, 0));
}

TEST(Scene, ReadsEveryBlockInSixDegreesOfFreedom) {
  const Scene s = scene_of(kTurning);
  EXPECT_EQ(s.axes(), 3);
  EXPECT_EQ(s.human->hand->rotational_stiffness_n_m_per_rad, 2.0);
  EXPECT_EQ(s.human->hand->rotational_damping_n_m_s_per_rad, 0.1);
  EXPECT_EQ(s.device->inertia_kg_m2, 1e-4);
  EXPECT_EQ(s.device->rotational_damping_n_m_s_per_rad, 1e-3);
  EXPECT_EQ(s.device->position_m, (Numbers{0, 0, 0.1, 1, 0, 0, 0}));
  EXPECT_EQ(s.device->velocity_m_per_s, (Numbers{0, 0, 0, 0, 0, 1}));
  EXPECT_EQ(s.control.coupling.rotational_stiffness_n_m_per_rad, 5.0);
  EXPECT_EQ(s.control.coupling.rotational_damping_n_m_s_per_rad, 0.3);
  EXPECT_EQ(s.robot->inertia_kg_m2, (Numbers{1e-3, 2e-3, 3e-3}));
  EXPECT_EQ(s.robot->rotational_damping_n_m_s_per_rad, 0.01);
  EXPECT_EQ(s.robot->position_m, (Numbers{1, 2, 3}));
  EXPECT_EQ(s.robot->velocity_m_per_s, (Numbers{4, 5, 6}));
  EXPECT_EQ(std::get<MoveToSpec>(s.human->path[1]).position_m, (Numbers{0, 0, 0.1, 0, 1, 0, 0}));
  EXPECT_EQ(std::get<SineSpec>(s.human->path[2]).axis, 5);
  EXPECT_EQ(s.robot->force_sensor->noise_n, 0.01);
  EXPECT_EQ(s.robot->force_sensor->bias_n, (Numbers{0, 0, 0, 1, 2, 3}));
  EXPECT_EQ(s.robot->force_sensor->latency_s, 2e-3);

  ASSERT_EQ(s.environment.size(), 5U);
  const Sphere sphere = shape_of<Sphere>(s.environment[0]);
  EXPECT_EQ(sphere.center_m, Vector3d(0, 0, -1));
  EXPECT_EQ(sphere.radius_m, 0.9);
  EXPECT_EQ(material_of(s.environment[0]).damping_n_s_per_m, 1.0);
  EXPECT_EQ(material_of(s.environment[0]).friction, 0.3);
  EXPECT_EQ(material_of(s.environment[0]).viscous_friction_n_s_per_m, 2.0);
  const Cylinder cylinder = shape_of<Cylinder>(s.environment[1]);
  EXPECT_EQ(cylinder.point_m, Vector3d(1, 0, 0));
  EXPECT_EQ(cylinder.axis, Vector3d(0, 0, 1));
  EXPECT_EQ(cylinder.radius_m, 0.1);
  const Box box = shape_of<Box>(s.environment[2]);
  EXPECT_EQ(box.center_m, Vector3d(0, 1, 0));
  EXPECT_EQ(box.half_size_m, Vector3d(0.1, 0.2, 0.3));
  EXPECT_EQ(std::get<Spring>(s.environment[3]).damping_n_s_per_m, 0.5);
  EXPECT_EQ(s.tool, (std::vector<Vector3d>{{0, 0, 0.05}, {0.01, 0, 0.05}}));
}

TEST(Scene, ReadsEveryImpairment) {
  const Scene s = scene_of(
      kStiffWall, {"to_slave.jitter_ms=3", "to_slave.jitter_distribution=PARETO",
                   "to_slave.burst={p: 0.1 r: 0.5 loss_good: 0.01}", "to_slave.blackout={start_s: 1 duration_s: 0.25}",
                   "to_slave.duplicate=0.02", "to_slave.reorder=0.03", "to_slave.reorder_ms=8"});
  EXPECT_EQ(s.to_slave.jitter_s, 3e-3);
  EXPECT_EQ(s.to_slave.jitter_distribution, JitterDistribution::pareto);
  ASSERT_TRUE(s.to_slave.burst);
  EXPECT_EQ(s.to_slave.burst->p, 0.1);
  EXPECT_EQ(s.to_slave.burst->r, 0.5);
  EXPECT_EQ(s.to_slave.burst->loss_good, 0.01);
  EXPECT_EQ(s.to_slave.burst->loss_bad, 1.0);
  ASSERT_EQ(s.to_slave.blackout.size(), 1U);
  EXPECT_EQ(s.to_slave.blackout[0].start_s, 1.0);
  EXPECT_EQ(s.to_slave.blackout[0].duration_s, 0.25);
  EXPECT_EQ(s.to_slave.duplicate, 0.02);
  EXPECT_EQ(s.to_slave.reorder, 0.03);
  EXPECT_EQ(s.to_slave.reorder_s, 8e-3);
  EXPECT_FALSE(s.to_master.burst);
}

TEST(Scene, FillsInWhatItDoesNotSay) {
  const Scene s = scene_of("dof: 3 duration_s: 1");
  EXPECT_EQ(s.name, "x");  // after its file
  EXPECT_EQ(s.rate_hz, 1000.0);
  EXPECT_EQ(s.master_rate_hz, 1000.0);
  EXPECT_EQ(s.slave_rate_hz, 1000.0);
  EXPECT_EQ(s.seed, 1U);
  EXPECT_FALSE(s.human || s.device || s.robot);
  EXPECT_TRUE(s.environment.empty() && s.tool.empty());
  EXPECT_EQ(s.control.architecture, Architecture::position_force);
  EXPECT_EQ(s.control.force_scale, 1.0);
  EXPECT_EQ(s.control.motion_scale, 1.0);
  const CouplingOptions coupling;  // the schema and the plain options agree
  EXPECT_EQ(s.control.coupling.stiffness_n_per_m, coupling.stiffness_n_per_m);
  EXPECT_EQ(s.control.coupling.damping_n_s_per_m, coupling.damping_n_s_per_m);
  EXPECT_EQ(s.control.coupling.rotational_stiffness_n_m_per_rad, coupling.rotational_stiffness_n_m_per_rad);
  EXPECT_EQ(s.control.coupling.rotational_damping_n_m_s_per_rad, coupling.rotational_damping_n_m_s_per_rad);
  EXPECT_EQ(s.control.coupling.catch_up_m_per_s, coupling.catch_up_m_per_s);
  EXPECT_EQ(s.control.coupling.drift_compensation, coupling.drift_compensation);
  const ControllerOptions controller;
  EXPECT_EQ(s.control.controller.method, controller.method);
  EXPECT_EQ(s.control.controller.max_gain, controller.max_gain);
  EXPECT_EQ(s.control.controller.unilateral, controller.unilateral);
  EXPECT_EQ(s.control.controller.predict, controller.predict);
  EXPECT_EQ(s.control.observer, ObserverRule::exact);
  EXPECT_EQ(s.control.accounts, Accounts::total);
  EXPECT_FALSE(s.control.reference_energy);
  EXPECT_EQ(s.control.engage.si(), 0.1);
  EXPECT_EQ(s.control.hold_after.si(), 0.1);
  EXPECT_EQ(s.control.release_after.si(), 1.0);
  EXPECT_EQ(s.to_slave.delay_s, 0.0);
  EXPECT_TRUE(s.to_slave.recorded_delay_s.empty());
}

TEST(Scene, RatesOfTheTwoSidesMayDiffer) {
  const Scene s = scene_of("dof: 1 duration_s: 1 rate_hz: 500 slave_rate_hz: 2000");
  EXPECT_EQ(s.master_rate_hz, 500.0);
  EXPECT_EQ(s.slave_rate_hz, 2000.0);
}

TEST(Scene, AccountsStartWithAMillijouleOverALinkAndWithNothingUnderRender) {
  EXPECT_EQ(scene_of(kStiffWall).control.initial_energy.si(), 1e-3);
  EXPECT_EQ(scene_of(kHeldSpring).control.initial_energy.si(), 0.0);
  EXPECT_EQ(scene_of(kStiffWall, {"control.passivity.initial_energy_j=0"}).control.initial_energy.si(), 0.0);
  EXPECT_EQ(scene_of(kHeldSpring, {"control.passivity.initial_energy_j=0.5"}).control.initial_energy.si(), 0.5);
}

TEST(Scene, PositionsThatAreNotGivenStayEmpty) {
  const Scene s = scene_of(
      kStiffWall, {"operator.path[0].move_to.position_m=[]", "environment[0]={spring {stiffness_n_per_m: 1}}"});
  EXPECT_TRUE(s.device->position_m.empty() && s.device->velocity_m_per_s.empty());
  EXPECT_TRUE(s.robot->position_m.empty());
  EXPECT_TRUE(std::get<MoveToSpec>(s.human->path[0]).position_m.empty());
  EXPECT_EQ(std::get<Spring>(s.environment[0]).anchor_m, Vector3d(0, 0, 0));
}

TEST(Scene, DirectionsAndAttitudesAreMadeOfUnitLength) {
  const Scene s = scene_of(kTurning, {"device.position_m=[0, 0, 0, 0.8005, 0.6, 0, 0]"});
  const Wall wall = shape_of<Wall>(s.environment[4]);
  EXPECT_NEAR(wall.normal[1], 0.6, 1e-15);
  EXPECT_NEAR(wall.normal[2], 0.8, 1e-15);
  EXPECT_NEAR(std::hypot(s.device->position_m[3], s.device->position_m[4]), 1.0, 1e-15);
  EXPECT_EQ(shape_of<Wall>(scene_of(kStiffWall, {"environment[0].wall.normal=[1e300, 0, 0]"}).environment[0]).normal,
            Vector3d(1, 0, 0));
  EXPECT_EQ(shape_of<Wall>(scene_of(kStiffWall, {"environment[0].wall.normal=[0, -1e-300, 0]"}).environment[0]).normal,
            Vector3d(0, -1, 0));
}

TEST(Scene, OneMomentOfInertiaStandsForThree) {
  EXPECT_EQ(scene_of(kTurning, {"robot.inertia_kg_m2=[2e-3]"}).robot->inertia_kg_m2, (Numbers{2e-3, 2e-3, 2e-3}));
}

TEST(Scene, AToolWithoutPointsTouchesAtItsOrigin) {
  EXPECT_EQ(scene_of(kTurning, {"tool={}"}).tool, std::vector<Vector3d>{Vector3d::Zero()});
  EXPECT_EQ(scene_of(kTurning, {"tool={contact_point {}}"}).tool, std::vector<Vector3d>{Vector3d::Zero()});
}

TEST(Scene, TheHandlesMassMayComeFromTheHandOrTheDevice) {
  EXPECT_EQ(complaint(kStiffWall, {"device.mass_kg=0"}), "");
  EXPECT_EQ(complaint(kStiffWall, {"operator.hand.mass_kg=0"}), "");
  EXPECT_EQ(complaint(kTurning, {"device.inertia_kg_m2=0", "operator.hand.inertia_kg_m2=1e-5"}), "");
}

TEST(Scene, RefusesWhatIsTooStiffToBeWorthAModel) {
  const auto names = [](const std::string& override, const std::string& what, const char* scene = kStiffWall) {
    const std::string said = complaint(scene, {override});
    EXPECT_NE(said.find(what), std::string::npos) << override << ": " << said;
    EXPECT_NE(said.find("rad in a tick; it must be <= 10000"), std::string::npos) << override << ": " << said;
  };
  names("operator.hand.stiffness_n_per_m=1e15", "device and operator.hand: mass");
  names("device.damping_n_s_per_m=1e12", "device and operator.hand: mass");
  names("operator.hand.rotational_stiffness_n_m_per_rad=1e15", "device and operator.hand: inertia", kTurning);
  names("environment[0].wall.stiffness_n_per_m=1e15", "robot and environment: mass");
  names("robot.mass_kg=1e-30", "robot and environment: mass");
  EXPECT_EQ(complaint(kStiffWall, {"operator.hand.stiffness_n_per_m=1e12"}), "");
}

TEST(Scene, AnImposedPathOrAnIdealHandleNeedsNoMass) {
  EXPECT_EQ(complaint("dof: 6 duration_s: 1 operator { path { hold { duration_s: 1 } } } device { max_force_n: 5 }"),
            "");
  EXPECT_EQ(complaint("dof: 6 duration_s: 1"), "");
}

TEST(Scene, ALinkWithoutARobotHasAnIdealOne) {
  EXPECT_EQ(
      complaint("dof: 3 duration_s: 1 control { architecture: POSITION_MEASURED_FORCE } to_slave { delay_ms: 5 }"), "");
}

TEST(Scene, OnlyARenderingKnowsItsContacts) {
  for (const char* accounts : {"PER_CONTACT", "NORMAL_TANGENTIAL"}) {
    const std::string set = std::string{"control.passivity.accounts="} + accounts;
    EXPECT_EQ(complaint(kHeldSpring, {set}), "");
    EXPECT_TRUE(says(complaint(kTurning, {set}), {"scenes/x.textproto: control.passivity.accounts is", accounts,
                                                  "must be TOTAL over a link", "RENDER"}));
    EXPECT_TRUE(says(complaint(kStiffWall, {set}), {accounts, "must be TOTAL over", "RENDER"}));
  }
  EXPECT_EQ(complaint(kHeldSpring, {"control.passivity.reference_energy=true"}), "");
}

// ---- where the text does not read

TEST(SceneText, AMisspeltFieldIsNamedWithItsPlaceAndWhatThereIs) {
  const std::string e = complaint("dof: 3\nduration_s: 1\ncontrol {\n  pasivity { }\n}\n");
  EXPECT_TRUE(says(e, {"scenes/x.textproto:4:3: ", "Control has no field \"pasivity\"", "architecture", "passivity"}));
  EXPECT_TRUE(says(complaint("durration_s: 4"), {"scenes/x.textproto:1:1: ", "Scene has no field \"durration_s\""}));
}

TEST(SceneText, AnUnknownChoiceIsNamedWithItsPlaceAndTheAllowedOnes) {
  EXPECT_TRUE(says(complaint("dof: 3\ncontrol { passivity { method: PROJECTED } }"),
                   {"scenes/x.textproto:2:31: ", "method is PROJECTED", "NONE, CLASSIC, FORCE_PROJECTED"}));
}

TEST(SceneText, AWrongTypeHasAPlace) {
  EXPECT_TRUE(says(complaint("dof: 3.5"), {"scenes/x.textproto:1:6: ", "integer", "3.5"}));
  EXPECT_TRUE(says(complaint("\n\n\tdof: x"), {"scenes/x.textproto:3:7: ", "integer", "x"}));
  EXPECT_TRUE(says(complaint("expect {\n stable: maybe }"), {"scenes/x.textproto:2:10: ", "maybe", "true or false"}));
  EXPECT_TRUE(says(complaint("device { mass_kg: heavy }"), {"scenes/x.textproto:1:19: ", "double", "heavy"}));
}

TEST(SceneText, TheSameFieldTwiceHasAPlace) {
  EXPECT_TRUE(says(complaint("dof: 3 # three\ndof: 1"), {"scenes/x.textproto:2:1: ", "dof is given twice"}));
  EXPECT_TRUE(says(complaint("environment { wall { } sphere { } }"),
                   {"scenes/x.textproto:1:24: ", "sphere is given beside wall"}));
}

TEST(SceneText, OfTwoErrorsTheFirstIsTold) {
  EXPECT_TRUE(says(complaint("dof: 3\nseed: 09\nduration_s: 1\nrate: 5"), {"scenes/x.textproto:2:8: ", "octal"}));
}

TEST(SceneText, ATextThatStopsShortHasAPlace) {
  EXPECT_TRUE(says(complaint("control {\n passivity {"), {"scenes/x.textproto:2:13: ", "the end of the text"}));
}

// ---- values that cannot be

struct Refusal {
  const char* text;
  Overrides overrides;
  std::vector<std::string> words;
};

class RefusedScene : public ::testing::TestWithParam<Refusal> {};

TEST_P(RefusedScene, NamesFilePathValueAndWhatIsAllowed) {
  const std::string e = complaint(GetParam().text, GetParam().overrides);
  EXPECT_TRUE(e.starts_with("scenes/x.textproto: ")) << e;
  EXPECT_TRUE(says(e, GetParam().words));
}

INSTANTIATE_TEST_SUITE_P(
    Frame, RefusedScene,
    ::testing::Values(
        Refusal{"duration_s: 1", {}, {"dof is missing; it must be 1, 3 or 6"}},
        Refusal{"dof: 3", {}, {"duration_s is missing; it must be > 0"}},
        Refusal{kStiffWall, {"dof=2"}, {"dof is 2; it must be 1, 3 or 6"}},
        Refusal{kStiffWall, {"duration_s=0"}, {"duration_s is 0; it must be > 0 and at most 1000000"}},
        Refusal{kStiffWall, {"duration_s=1.5e6"}, {"duration_s is 1500000; it must be > 0 and at most 1000000"}},
        Refusal{
            kStiffWall, {"duration_s=1e6", "rate_hz=1e5"}, {"duration_s is 1000000; it must last at most 4294967295"}},
        Refusal{kStiffWall, {"rate_hz=0"}, {"rate_hz is 0; it must be > 0 and at most 100000"}},
        Refusal{kStiffWall, {"rate_hz=2e5"}, {"rate_hz is 200000; it must be > 0 and at most 100000"}},
        Refusal{kStiffWall, {"master_rate_hz=-1"}, {"master_rate_hz is -1; it must be > 0"}},
        Refusal{kStiffWall, {"slave_rate_hz=0"}, {"slave_rate_hz is 0; it must be > 0 and at most 100000"}},
        Refusal{kStiffWall, {"slave_rate_hz=nan"}, {"slave_rate_hz is nan; it must be a finite number"}},
        Refusal{kStiffWall, {"duration_s=inf"}, {"duration_s is inf; it must be a finite number"}},
        Refusal{kStiffWall, {"tool={}"}, {"tool is given, but applies to dof 6 only; dof is 3"}},
        Refusal{kTurning,
                {"tool.contact_point[0].position_m=[1]"},
                {"tool.contact_point[0].position_m is [1]; it must hold 3 numbers"}}));

INSTANTIATE_TEST_SUITE_P(
    Hand, RefusedScene,
    ::testing::Values(
        Refusal{kStiffWall, {"operator.hand.mass_kg=-1"}, {"operator.hand.mass_kg is -1; it must be >= 0"}},
        Refusal{kStiffWall,
                {"operator.hand.stiffness_n_per_m=-1"},
                {"operator.hand.stiffness_n_per_m is -1; it must be >= 0"}},
        Refusal{kStiffWall,
                {"operator.hand.damping_n_s_per_m=-1"},
                {"operator.hand.damping_n_s_per_m is -1; it must be >= 0"}},
        Refusal{
            kStiffWall, {"operator.hand.inertia_kg_m2=1"}, {"operator.hand.inertia_kg_m2 is given, but", "dof 6 only"}},
        Refusal{
            kStiffWall, {"operator.hand.rotational_stiffness_n_m_per_rad=1"}, {"rotational_stiffness", "dof 6 only"}},
        Refusal{kStiffWall, {"operator.hand.rotational_damping_n_m_s_per_rad=1"}, {"rotational_damping", "dof 6 only"}},
        Refusal{kTurning, {"operator.hand.rotational_damping_n_m_s_per_rad=-1"}, {"is -1; it must be >= 0"}},
        Refusal{kTurning, {"operator.hand.rotational_stiffness_n_m_per_rad=-1"}, {"is -1; it must be >= 0"}},
        Refusal{kTurning, {"operator.hand.inertia_kg_m2=-1"}, {"is -1; it must be >= 0"}},
        Refusal{kStiffWall,
                {"operator.hand.mass_kg=0", "device.mass_kg=0"},
                {"device.mass_kg + operator.hand.mass_kg is 0; it must be > 0"}},
        Refusal{kHeldSpring, {"device.mass_kg=0"}, {"device.mass_kg is 0; it must be > 0"}},
        Refusal{kTurning,
                {"device.inertia_kg_m2=0"},
                {"device.inertia_kg_m2 + operator.hand.inertia_kg_m2 is 0; it must be > 0"}},
        Refusal{"dof: 6 duration_s: 1 device { mass_kg: 1 }", {}, {"device.inertia_kg_m2 is 0; it must be > 0"}},
        Refusal{"dof: 3 duration_s: 1 operator { hand { stiffness_n_per_m: 1 } }", {}, {"operator.hand.mass_kg is 0"}},
        Refusal{kStiffWall,
                {"operator.path[3]={}"},
                {"operator.path[3] is empty; it must hold one of hold, move_to, sine, screw"}},
        Refusal{
            kStiffWall, {"operator.path[2].hold={}"}, {"operator.path[2].hold.duration_s is missing; it must be > 0"}},
        Refusal{kStiffWall,
                {"operator.path[2].hold.duration_s=-1"},
                {"operator.path[2].hold.duration_s is -1; it must be > 0"}},
        Refusal{kStiffWall, {"operator.path[0].move_to={}"}, {"operator.path[0].move_to.duration_s is missing"}},
        Refusal{kStiffWall,
                {"operator.path[0].move_to.position_m=[1, 2]"},
                {"operator.path[0].move_to.position_m is [1, 2]; it must hold 3 numbers"}},
        Refusal{kStiffWall,
                {"operator.path[0].move_to.position_m[1]=inf"},
                {"operator.path[0].move_to.position_m is [0.03, inf, 0]; it must hold finite numbers"}},
        Refusal{kStiffWall, {"operator.path[0].screw={}"}, {"operator.path[0].screw.axis is missing"}},
        Refusal{kStiffWall,
                {"operator.path[3].screw={axis: [0, 0, 0]}"},
                {"operator.path[3].screw.axis is [0, 0, 0]; it must not be zero"}},
        Refusal{kStiffWall,
                {"operator.path[3].screw={axis: [0, 0, 1] frequency_hz: 0 duration_s: 1}"},
                {"operator.path[3].screw.frequency_hz is 0; it must be > 0"}},
        Refusal{"dof: 1 duration_s: 1",
                {"operator.path[0].screw={axis: [1] frequency_hz: 1 duration_s: 1}"},
                {"operator.path[0].screw is given, but dof is 1; a screw needs dof 3 or 6"}},
        Refusal{kStiffWall, {"operator.tremor={}"}, {"operator.tremor.rms_m is missing; it must be >= 0"}},
        Refusal{kStiffWall, {"operator.tremor.rms_m=-1"}, {"operator.tremor.rms_m is -1; it must be >= 0"}},
        Refusal{kStiffWall,
                {"operator.tremor={rms_m: 1e-4 low_hz: 12}"},
                {"operator.tremor.low_hz is 12; it must be < operator.tremor.high_hz (12)"}},
        Refusal{kStiffWall, {"operator.path[1].sine.axis=3"}, {"operator.path[1].sine.axis is 3; it must be 0 to 2"}},
        Refusal{kStiffWall, {"operator.path[1].sine.axis=-1"}, {"operator.path[1].sine.axis is -1; it must be 0 to 2"}},
        Refusal{kStiffWall, {"operator.path[1].sine={frequency_hz: 1 duration_s: 1}"}, {"sine.amplitude_m is missing"}},
        Refusal{kStiffWall, {"operator.path[1].sine={amplitude_m: 1 duration_s: 1}"}, {"sine.frequency_hz is missing"}},
        Refusal{kStiffWall, {"operator.path[1].sine={amplitude_m: 1 frequency_hz: 1}"}, {"sine.duration_s is missing"}},
        Refusal{kStiffWall, {"operator.path[0].move_to.duration_s=0"}, {"move_to.duration_s is 0; it must be > 0"}},
        Refusal{kStiffWall, {"operator.path[1].sine.duration_s=0"}, {"sine.duration_s is 0; it must be > 0"}},
        Refusal{
            kStiffWall, {"operator.path[1].sine.amplitude_m=inf"}, {"sine.amplitude_m is inf; it must be a finite"}},
        Refusal{kStiffWall, {"operator.path[1].sine.frequency_hz=0"}, {"sine.frequency_hz is 0; it must be > 0"}}));

INSTANTIATE_TEST_SUITE_P(
    Device, RefusedScene,
    ::testing::Values(
        Refusal{kStiffWall, {"device.mass_kg=-1"}, {"device.mass_kg is -1; it must be >= 0"}},
        Refusal{kStiffWall, {"device.damping_n_s_per_m=-1"}, {"device.damping_n_s_per_m is -1; it must be >= 0"}},
        Refusal{kStiffWall, {"device.coulomb_friction_n=-1"}, {"device.coulomb_friction_n is -1; it must be >= 0"}},
        Refusal{
            kStiffWall, {"device.position_resolution_m=-1"}, {"device.position_resolution_m is -1; it must be >= 0"}},
        Refusal{kStiffWall, {"device.max_force_n=0"}, {"device.max_force_n is 0; it must be > 0"}},
        Refusal{kStiffWall, {"device.velocity_filter_hz=0"}, {"device.velocity_filter_hz is 0; it must be > 0"}},
        Refusal{kStiffWall, {"device.position_m=[1]"}, {"device.position_m is [1]; it must hold 3 numbers"}},
        Refusal{kStiffWall,
                {"device.velocity_m_per_s=[1, 2]"},
                {"device.velocity_m_per_s is [1, 2]; it must hold 3 numbers"}},
        Refusal{
            kHeldSpring, {"device.position_m=[1, 2, 3]"}, {"device.position_m is [1, 2, 3]; it must hold 1 number"}},
        Refusal{
            kTurning, {"device.position_m=[1, 2, 3, 4]"}, {"it must hold 3 numbers, or 7 with the attitude w x y z"}},
        Refusal{kTurning, {"device.velocity_m_per_s=[1]"}, {"it must hold 3 numbers, or 6 with the rotation"}},
        Refusal{kTurning,
                {"device.position_m=[0, 0, 0, 1.002, 0, 0, 0]"},
                {"device.position_m is [", "unit quaternion", "1.002"}},
        Refusal{kTurning, {"device.position_m=[0, 0, 0, 0, 0, 0, 0]"}, {"unit quaternion"}},
        Refusal{kTurning, {"device.inertia_kg_m2=-1"}, {"device.inertia_kg_m2 is -1; it must be >= 0"}},
        Refusal{kTurning, {"device.rotational_damping_n_m_s_per_rad=-1"}, {"is -1; it must be >= 0"}},
        Refusal{kStiffWall, {"device.inertia_kg_m2=1"}, {"device.inertia_kg_m2 is given, but", "dof 6 only"}},
        Refusal{kStiffWall, {"device.rotational_damping_n_m_s_per_rad=1"}, {"is given, but", "dof 6 only"}}));

INSTANTIATE_TEST_SUITE_P(
    Control, RefusedScene,
    ::testing::Values(
        Refusal{kStiffWall, {"control.force_scale=0"}, {"control.force_scale is 0; it must be > 0"}},
        Refusal{kStiffWall, {"control.motion_scale=-2"}, {"control.motion_scale is -2; it must be > 0"}},
        Refusal{kStiffWall,
                {"control.virtual_coupling.stiffness_n_per_m=-1"},
                {"control.virtual_coupling.stiffness_n_per_m is -1; it must be >= 0"}},
        Refusal{kStiffWall,
                {"control.virtual_coupling.damping_n_s_per_m=-1"},
                {"damping_n_s_per_m is -1; it must be >= 0"}},
        Refusal{
            kStiffWall, {"control.virtual_coupling.catch_up_m_per_s=-1"}, {"catch_up_m_per_s is -1; it must be >= 0"}},
        Refusal{kStiffWall, {"control.virtual_coupling.rotational_stiffness_n_m_per_rad=1"}, {"dof 6 only"}},
        Refusal{kStiffWall, {"control.virtual_coupling.rotational_damping_n_m_s_per_rad=1"}, {"dof 6 only"}},
        Refusal{kTurning, {"control.virtual_coupling.rotational_stiffness_n_m_per_rad=-1"}, {"is -1; it must be >= 0"}},
        Refusal{kTurning, {"control.virtual_coupling.rotational_damping_n_m_s_per_rad=-1"}, {"is -1; it must be >= 0"}},
        Refusal{kStiffWall, {"control.passivity.initial_energy_j=-1"}, {"initial_energy_j is -1; it must be >= 0"}},
        Refusal{kStiffWall, {"control.passivity.max_gain=-1"}, {"control.passivity.max_gain is -1; it must be >= 0"}},
        Refusal{kStiffWall, {"control.engage_s=-1"}, {"control.engage_s is -1; it must be between 0 and 1000000"}},
        Refusal{kStiffWall, {"control.hold_after_s=0"}, {"control.hold_after_s is 0; it must be > 0"}},
        Refusal{kStiffWall, {"control.release_after_s=0"}, {"control.release_after_s is 0; it must be > 0"}},
        Refusal{kStiffWall,
                {"control.hold_after_s=1"},
                {"control.hold_after_s is 1; it must be < control.release_after_s (1)"}},
        Refusal{kHeldSpring,
                {"control.passivity.accounts=TRANSLATION_ROTATION"},
                {"control.passivity.accounts is TRANSLATION_ROTATION", "dof 1"}},
        Refusal{kHeldSpring,
                {"robot.mass_kg=1"},
                {"robot is given, but control.architecture is RENDER", "nothing would use it"}},
        Refusal{kHeldSpring, {"to_slave.delay_ms=1"}, {"to_slave is given, but control.architecture is RENDER"}},
        Refusal{kHeldSpring, {"to_master={}"}, {"to_master is given, but control.architecture is RENDER"}}));

INSTANTIATE_TEST_SUITE_P(
    Link, RefusedScene,
    ::testing::Values(
        Refusal{kStiffWall, {"to_slave.delay_ms=-1"}, {"to_slave.delay_ms is -1; it must be between 0 and 1000000"}},
        Refusal{kStiffWall, {"to_slave.jitter_ms=-1"}, {"to_slave.jitter_ms is -1; it must be between"}},
        Refusal{kStiffWall, {"to_master.loss=1.5"}, {"to_master.loss is 1.5; it must be between 0 and 1"}},
        Refusal{kStiffWall, {"to_master.duplicate=-0.1"}, {"to_master.duplicate is -0.1; it must be between 0 and 1"}},
        Refusal{kStiffWall, {"to_master.reorder=2"}, {"to_master.reorder is 2; it must be between 0 and 1"}},
        Refusal{kStiffWall, {"to_master.reorder_ms=-2"}, {"to_master.reorder_ms is -2; it must be between"}},
        Refusal{kStiffWall, {"to_slave.burst={r: 1}"}, {"to_slave.burst.p is missing; it must be between 0 and 1"}},
        Refusal{kStiffWall, {"to_slave.burst={p: 1}"}, {"to_slave.burst.r is missing; it must be between 0 and 1"}},
        Refusal{kStiffWall, {"to_slave.burst={p: 2 r: 1}"}, {"to_slave.burst.p is 2; it must be between 0 and 1"}},
        Refusal{kStiffWall, {"to_slave.burst={p: 1 r: 2}"}, {"to_slave.burst.r is 2; it must be between 0 and 1"}},
        Refusal{kStiffWall, {"to_slave.burst={p: 1 r: 1 loss_good: 2}"}, {"to_slave.burst.loss_good is 2; it must be"}},
        Refusal{kStiffWall, {"to_slave.burst={p: 1 r: 1 loss_bad: 2}"}, {"to_slave.burst.loss_bad is 2; it must be"}},
        Refusal{kStiffWall,
                {"to_slave.blackout={start_s: -1 duration_s: 1}"},
                {"to_slave.blackout[0].start_s is -1; it must be >= 0"}},
        Refusal{kStiffWall,
                {"to_slave.blackout={start_s: 1 duration_s: 0}"},
                {"to_slave.blackout[0].duration_s is 0; it must be > 0"}},
        Refusal{kStiffWall, {"to_slave.blackout[0].start_s=1"}, {"to_slave.blackout[0].duration_s is missing"}},
        Refusal{kStiffWall, {"to_slave.blackout[0].duration_s=1"}, {"to_slave.blackout[0].start_s is missing"}},
        Refusal{kStiffWall,
                {"to_slave.trace_file=nowhere.txt"},
                {"to_slave.trace_file: scenes/nowhere.txt: cannot be read: No such file"}}));

INSTANTIATE_TEST_SUITE_P(
    Robot, RefusedScene,
    ::testing::Values(
        Refusal{"dof: 3 duration_s: 1 robot { }", {}, {"robot.mass_kg is missing; it must be > 0"}},
        Refusal{kStiffWall, {"robot.mass_kg=0"}, {"robot.mass_kg is 0; it must be > 0"}},
        Refusal{kStiffWall, {"robot.damping_n_s_per_m=-1"}, {"robot.damping_n_s_per_m is -1; it must be >= 0"}},
        Refusal{kStiffWall, {"robot.position_m=[1]"}, {"robot.position_m is [1]; it must hold 3 numbers"}},
        Refusal{kStiffWall, {"robot.velocity_m_per_s=[1]"}, {"robot.velocity_m_per_s is [1]; it must hold 3 numbers"}},
        Refusal{kStiffWall, {"robot.force_sensor.noise_n=-1"}, {"robot.force_sensor.noise_n is -1; it must be >= 0"}},
        Refusal{kStiffWall,
                {"robot.force_sensor.bias_n=[1]"},
                {"robot.force_sensor.bias_n is [1]; it must hold 3 numbers"}},
        Refusal{kStiffWall, {"robot.force_sensor.latency_ms=-1"}, {"robot.force_sensor.latency_ms is -1; it must be"}},
        Refusal{kStiffWall, {"robot.inertia_kg_m2=[1]"}, {"robot.inertia_kg_m2 is given, but", "dof 6 only"}},
        Refusal{kStiffWall, {"robot.rotational_damping_n_m_s_per_rad=1"}, {"is given, but", "dof 6 only"}},
        Refusal{kTurning, {"robot.rotational_damping_n_m_s_per_rad=-1"}, {"is -1; it must be >= 0"}},
        Refusal{"dof: 6 duration_s: 1 robot { mass_kg: 1 }",
                {},
                {"robot.inertia_kg_m2 is missing; it must hold 1 number, or 3 for the principal moments"}},
        Refusal{
            kTurning, {"robot.inertia_kg_m2=[1, 2]"}, {"robot.inertia_kg_m2 is [1, 2]; it must hold 1 number, or 3"}},
        Refusal{kTurning, {"robot.inertia_kg_m2=[0]"}, {"robot.inertia_kg_m2 is [0]; it must hold numbers > 0"}},
        Refusal{
            kTurning, {"robot.inertia_kg_m2=[1, 2, 3.1]"}, {"is [1, 2, 3.1]; it must keep the triangle inequality"}}));

INSTANTIATE_TEST_SUITE_P(
    Environment, RefusedScene,
    ::testing::Values(
        Refusal{kStiffWall,
                {"environment[0]={}"},
                {"environment[0] is empty; it must hold one of wall, sphere, cylinder, box, spring"}},
        Refusal{kStiffWall,
                {"environment[0].wall.stiffness_n_per_m=-5"},
                {"environment[0].wall.stiffness_n_per_m is -5; it must be > 0"}},
        Refusal{kStiffWall,
                {"environment[0].wall={normal: [1, 0, 0]}"},
                {"wall.stiffness_n_per_m is missing; it must be > 0"}},
        Refusal{kStiffWall,
                {"environment[0].wall={stiffness_n_per_m: 1}"},
                {"wall.normal is missing; it must hold 3 numbers"}},
        Refusal{
            kStiffWall, {"environment[0].wall.normal=[0, 0, 0]"}, {"wall.normal is [0, 0, 0]; it must not be zero"}},
        Refusal{kStiffWall, {"environment[0].wall.normal=[1]"}, {"wall.normal is [1]; it must hold 3 numbers"}},
        Refusal{kStiffWall, {"environment[0].wall.offset_m=nan"}, {"wall.offset_m is nan; it must be a finite number"}},
        Refusal{kStiffWall,
                {"environment[0].wall.damping_n_s_per_m=-1"},
                {"wall.damping_n_s_per_m is -1; it must be >= 0"}},
        Refusal{kStiffWall, {"environment[0].wall.friction=-1"}, {"wall.friction is -1; it must be >= 0"}},
        Refusal{kStiffWall, {"environment[0].wall.viscous_friction_n_s_per_m=-1"}, {"is -1; it must be >= 0"}},
        Refusal{
            kTurning, {"environment[0].sphere.radius_m=0"}, {"environment[0].sphere.radius_m is 0; it must be > 0"}},
        Refusal{
            kTurning, {"environment[0].sphere={stiffness_n_per_m: 1}"}, {"sphere.radius_m is missing; it must be > 0"}},
        Refusal{kTurning, {"environment[0].sphere.center_m=[0]"}, {"sphere.center_m is [0]; it must hold 3 numbers"}},
        Refusal{
            kTurning, {"environment[1].cylinder={axis: [0, 0, 1]}"}, {"cylinder.radius_m is missing; it must be > 0"}},
        Refusal{kTurning, {"environment[1].cylinder.axis=[1]"}, {"cylinder.axis is [1]; it must hold 3 numbers"}},
        Refusal{kTurning, {"environment[2].box.half_size_m=[1]"}, {"box.half_size_m is [1]; it must hold 3 numbers"}},
        Refusal{kTurning, {"environment[1].cylinder.radius_m=-1"}, {"cylinder.radius_m is -1; it must be > 0"}},
        Refusal{
            kTurning, {"environment[1].cylinder.axis=[0, 0, 0]"}, {"cylinder.axis is [0, 0, 0]; it must not be zero"}},
        Refusal{kTurning, {"environment[1].cylinder.axis=[]"}, {"cylinder.axis is missing; it must hold 3 numbers"}},
        Refusal{kTurning, {"environment[1].cylinder.point_m=[0]"}, {"cylinder.point_m is [0]; it must hold 3 numbers"}},
        Refusal{
            kHeldSpring, {"environment[0].cylinder.radius_m=1"}, {"environment[0].cylinder is given, but dof is 1"}},
        Refusal{kTurning,
                {"environment[2].box.half_size_m=[1, 0, 1]"},
                {"box.half_size_m is [1, 0, 1]; it must hold numbers > 0"}},
        Refusal{
            kTurning, {"environment[2].box.half_size_m=[]"}, {"box.half_size_m is missing; it must hold 3 numbers"}},
        Refusal{kTurning, {"environment[2].box.center_m=[1]"}, {"box.center_m is [1]; it must hold 3 numbers"}},
        Refusal{kHeldSpring,
                {"environment[0].spring.stiffness_n_per_m=-1"},
                {"spring.stiffness_n_per_m is -1; it must be >= 0"}},
        Refusal{kHeldSpring, {"environment[0].spring={}"}, {"spring.stiffness_n_per_m is missing; it must be >= 0"}},
        Refusal{kHeldSpring,
                {"environment[0].spring.damping_n_s_per_m=-1"},
                {"spring.damping_n_s_per_m is -1; it must be >= 0"}},
        Refusal{kHeldSpring,
                {"environment[0].spring.anchor_m=[0, 0]"},
                {"spring.anchor_m is [0, 0]; it must hold 1 number"}}));

INSTANTIATE_TEST_SUITE_P(Expect, RefusedScene,
                         ::testing::Values(Refusal{kStiffWall,
                                                   {"expect.at_least[0].key=min_port_energy"},
                                                   {"expect.at_least[0].key is \"min_port_energy\"; it must be one of",
                                                    "min_port_energy_j", "rtt_ms.p999"}},
                                           Refusal{kStiffWall,
                                                   {"expect.at_most[0].key=stable"},
                                                   {"expect.at_most[0].key is \"stable\"", "expect { stable: ... }"}},
                                           Refusal{kStiffWall,
                                                   {"expect.at_most[0].key=verdict"},
                                                   {"expect.at_most[0].key is \"verdict\"; it must be one of"}},
                                           Refusal{kStiffWall,
                                                   {"expect.at_most[0]={key: \"steps\"}"},
                                                   {"expect.at_most[0].value is missing"}},
                                           Refusal{kStiffWall,
                                                   {"expect.at_most[0].value=nan"},
                                                   {"expect.at_most[0].value is nan; it must be a finite number"}}));

/// The path of every floating-point number that the blocks present in `block` have room for.
void collect_numbers(const google::protobuf::Message& block, const std::string& prefix,
                     std::vector<std::string>& paths) {
  using Field = google::protobuf::FieldDescriptor;
  const auto& descriptor = *block.GetDescriptor();
  const auto& reflection = *block.GetReflection();
  for (int i = 0; i < descriptor.field_count(); ++i) {
    const Field* field = descriptor.field(i);
    const std::string path = prefix + field->name();
    const int size = field->is_repeated() ? reflection.FieldSize(block, field) : 0;
    if (field->cpp_type() == Field::CPPTYPE_DOUBLE) {
      EXPECT_TRUE(!field->is_repeated() || size > 0) << path << " is not in the full scene";
      paths.push_back(field->is_repeated() ? path + "[0]" : path);
    } else if (field->cpp_type() == Field::CPPTYPE_MESSAGE && field->is_repeated()) {
      EXPECT_GT(size, 0) << path << " is not in the full scene";
      for (int k = 0; k < size; ++k)
        collect_numbers(reflection.GetRepeatedMessage(block, field, k), path + "[" + std::to_string(k) + "].", paths);
    } else if (field->cpp_type() == Field::CPPTYPE_MESSAGE) {
      if (!field->containing_oneof()) {
        EXPECT_TRUE(reflection.HasField(block, field)) << path << " is not in the full scene";
      }
      if (reflection.HasField(block, field)) collect_numbers(reflection.GetMessage(block, field), path + ".", paths);
    }
  }
}

// Also finds a number of the schema that nobody reads.
TEST(Scene, RefusesEveryNumberThatIsNotFinite) {
  schema::Scene message;
  ASSERT_TRUE(google::protobuf::TextFormat::ParseFromString(kTurning, &message));
  std::vector<std::string> paths;
  collect_numbers(message, "", paths);
  EXPECT_GT(paths.size(), 100U);
  for (const std::string& path : paths)
    for (const char* value : {"nan", "inf"}) {
      const std::string named = path.ends_with("[0]") ? path.substr(0, path.size() - 3) : path;
      EXPECT_TRUE(says(complaint(kTurning, {path + "=" + value}), {": " + named + " is ", value, "finite number"}))
          << path;
    }
}

// ---- overrides

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

TEST(Override, TakesAStringWithoutItsQuotes) {
  EXPECT_EQ(scene_of(kStiffWall, {"name=plain = name"}).name, "plain = name");
}

TEST(Override, CreatesTheBlocksOnTheWay) {
  const Scene s = scene_of("dof: 3 duration_s: 1", {"operator.hand.mass_kg=0.3", "control.passivity.observer=RECTANGLE",
                                                    "robot.mass_kg=2", "robot.force_sensor.noise_n=0.1"});
  EXPECT_EQ(s.human->hand->mass_kg, 0.3);
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
  ASSERT_EQ(s.human->path.size(), 3U);
  EXPECT_EQ(std::get<MoveToSpec>(s.human->path[0]).duration_s, 2.0);
  EXPECT_TRUE(std::holds_alternative<SineSpec>(s.human->path[1]));
  EXPECT_EQ(s.device->position_m, (Numbers{1, 5, 3}));
}

TEST(Override, ReplacesAWholeBlockAndAWholeList) {
  const Scene s = scene_of(kStiffWall, {"device={mass_kg: 9}", "operator.path=[{hold {duration_s: 5}}]"});
  EXPECT_EQ(s.device->mass_kg, 9.0);
  EXPECT_EQ(s.device->damping_n_s_per_m, 0.0);
  EXPECT_FALSE(s.device->max_force_n);
  ASSERT_EQ(s.human->path.size(), 1U);
  EXPECT_EQ(std::get<HoldSpec>(s.human->path[0]).duration_s, 5.0);
}

TEST(Override, AnotherKindTakesTheOldOnesPlace) {
  const Scene s = scene_of(kStiffWall, {"environment[0].spring.stiffness_n_per_m=3"});
  ASSERT_EQ(s.environment.size(), 1U);
  EXPECT_EQ(std::get<Spring>(s.environment[0]).stiffness_n_per_m, 3.0);
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
  const std::string e = complaint(kStiffWall, {GetParam().assignment});
  EXPECT_TRUE(e.starts_with(std::string{"override "} + GetParam().assignment + ": ")) << e;
  EXPECT_TRUE(says(e, GetParam().words));
}

INSTANTIATE_TEST_SUITE_P(
    All, UnusableOverride,
    ::testing::Values(
        Unusable{"dof", {"PATH=VALUE"}}, Unusable{"=3", {"no field \"\" in a scene"}},
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
        Unusable{"device.position_m[1]=1", {"device.position_m holds 0 now", "0 to 0"}},
        Unusable{"environment[2].wall.offset_m=1", {"environment holds 1 now", "0 to 1"}},
        Unusable{"environment.wall.offset_m=1", {"environment is a list", "environment[0]"}},
        Unusable{"environment[-1].wall.offset_m=1", {"environment must be followed by an index such as [0]"}},
        Unusable{"environment[0.wall.offset_m=1", {"environment must be followed by an index such as [0]"}},
        Unusable{"environment[0]x.wall.offset_m=1", {"environment must be followed by an index such as [0]"}},
        Unusable{"environment[99999999999].wall.offset_m=1", {"environment must be followed by an index"}},
        Unusable{"device[0].mass_kg=1", {"device is not a list"}},
        Unusable{"dof.x=1", {"dof is an integer, nothing lies below it"}},
        Unusable{"device.mass_kg=1 damping_n_s_per_m: 2", {"must be a number"}},
        Unusable{"dof.=1", {"dof is an integer"}}, Unusable{"device.=1", {"no field \"\" in device"}}));

// ---- files

TEST(SceneFile, IsReadWithItsRecordedDelaysBesideIt) {
  const Folder folder;
  folder.put("lab.textproto", std::string{kStiffWall} + "description: \"from a file\"");
  folder.put("delays.txt", "# one way, ms\n12.5\n\n  8 # a quick one\r\n0");
  const Scene s = load_scene(folder.file("lab.textproto"), Overrides{"to_slave.trace_file=\"delays.txt\""});
  EXPECT_EQ(s.description, "from a file");
  EXPECT_EQ(s.to_slave.recorded_delay_s, (std::vector<double>{0.0125, 0.008, 0.0}));
  EXPECT_TRUE(s.to_master.recorded_delay_s.empty());
}

TEST(SceneFile, AWrongRecordedDelayIsNamedWithItsLine) {
  const Folder folder;
  folder.put("lab.textproto", kStiffWall);
  const auto error = [&](const std::string& delays) -> std::string {
    folder.put("delays.txt", delays);
    try {
      static_cast<void>(load_scene(folder.file("lab.textproto"), Overrides{"to_master.trace_file=\"delays.txt\""}));
      return "";
    } catch (const ConfigError& e) {
      return e.what();
    }
  };
  EXPECT_TRUE(says(error("1\n# two\nthree\n"), {"to_master.trace_file", "delays.txt:3: \"three\"", "between 0 and"}));
  EXPECT_TRUE(says(error("1\n-2\n"), {"delays.txt:2: \"-2\""}));
  EXPECT_TRUE(says(error("nan\n"), {"delays.txt:1: \"nan\""}));
  EXPECT_TRUE(says(error("inf\n"), {"delays.txt:1: \"inf\""}));
  EXPECT_TRUE(says(error("1 2\n"), {"delays.txt:1: \"1 2\""}));
  EXPECT_TRUE(says(error("# nothing\n"), {"delays.txt holds no delay"}));
}

TEST(SceneFile, OneThatIsNotThereIsNamedWithTheReason) {
  const Folder folder;
  const auto error = [](const std::string& path) -> std::string {
    try {
      static_cast<void>(load_scene(path));
      return "";
    } catch (const ConfigError& e) {
      return e.what();
    }
  };
  EXPECT_TRUE(
      says(error(folder.file("none.textproto")), {"none.textproto: cannot be read: No such file or directory"}));
  EXPECT_TRUE(says(error(folder.file("")), {"cannot be read: Is a directory"}));
}

TEST(SceneFile, AnErrorInItIsNamedWithItsPath) {
  const Folder folder;
  folder.put("bad.textproto", "dof: 3\nduration: 1\n");
  try {
    static_cast<void>(load_scene(folder.file("bad.textproto")));
    FAIL() << "it was read";
  } catch (const ConfigError& e) {
    EXPECT_TRUE(std::string{e.what()}.starts_with(folder.file("bad.textproto") + ":2:1: ")) << e.what();
  }
}

// ---- the digest

// Everything that both sides share, spelt out: no default has a say here.
const char* const kSpelt = R"(
dof: 6 duration_s: 1 rate_hz: 1000 master_rate_hz: 2000
control {
  architecture: POSITION_FORCE force_scale: 1 motion_scale: 1 engage_s: 0.1 hold_after_s: 0.1 release_after_s: 1
  virtual_coupling { stiffness_n_per_m: 1000 damping_n_s_per_m: 20 rotational_stiffness_n_m_per_rad: 10
                     rotational_damping_n_m_s_per_rad: 0.2 catch_up_m_per_s: 0.05 drift_compensation: false }
  passivity { method: NONE observer: EXACT accounts: TOTAL reference_energy: false initial_energy_j: 1e-3 max_gain: 10
              unilateral: true predict: true }
}
)";

TEST(SceneDigest, ChangesWithEverythingThatBothSidesShare) {
  std::set<std::uint64_t> seen{scene_digest(scene_of(kSpelt))};
  for (const char* shared : {"rate_hz=500",
                             "master_rate_hz=500",
                             "control.architecture=POSITION_POSITION",
                             "control.force_scale=2",
                             "control.motion_scale=2",
                             "control.engage_s=0.2",
                             "control.hold_after_s=0.2",
                             "control.release_after_s=2",
                             "control.virtual_coupling.stiffness_n_per_m=1000.0000000000001",
                             "control.virtual_coupling.damping_n_s_per_m=21",
                             "control.virtual_coupling.rotational_stiffness_n_m_per_rad=1",
                             "control.virtual_coupling.rotational_damping_n_m_s_per_rad=1",
                             "control.virtual_coupling.catch_up_m_per_s=0.1",
                             "control.virtual_coupling.drift_compensation=true",
                             "control.passivity.method=CLASSIC",
                             "control.passivity.observer=RECTANGLE",
                             "control.passivity.initial_energy_j=0",
                             "control.passivity.max_gain=11",
                             "control.passivity.unilateral=false",
                             "control.passivity.predict=false"})
    EXPECT_TRUE(seen.insert(scene_digest(scene_of(kSpelt, {shared}))).second)
        << shared << " made no difference of its own";
  EXPECT_NE(scene_digest(scene_of("dof: 1 duration_s: 1")), scene_digest(scene_of("dof: 3 duration_s: 1")));
  const std::string rendered = "dof: 3 duration_s: 1 control { architecture: RENDER }";
  EXPECT_NE(scene_digest(scene_of(rendered)),
            scene_digest(scene_of(rendered, {"control.passivity.reference_energy=true"})));
}

TEST(SceneDigest, DoesNotChangeWithWhatIsASidesOwn) {
  const std::uint64_t before = scene_digest(scene_of(kStiffWall));
  for (const char* own :
       {"name=\"other\"", "seed=8", "duration_s=9", "to_slave.delay_ms=1", "to_master.loss=0.5", "device.mass_kg=0.1",
        "robot.mass_kg=2", "operator.hand.mass_kg=1", "environment[0].wall.stiffness_n_per_m=1", "expect.stable=false",
        "control.virtual_coupling.stiffness_n_per_m=1e3", "control.passivity.max_gain=10"})
    EXPECT_EQ(before, scene_digest(scene_of(kStiffWall, {own}))) << own;
}

TEST(SceneDigest, IsTheSameOnEveryMachine) {
  // Computed by hand from the definition; another shared option makes another number.
  EXPECT_EQ(scene_digest(scene_of(kSpelt)), 0xca984f8608728182ULL);
}

// ---- the summary

/// One with every field different from every other, and from zero.
Summary full_summary() {
  Summary s;
  s.scene = "a \"wall\"\nof words";
  s.side = "lab";
  s.architecture = "POSITION_FORCE";
  s.method = "CLASSIC";
  s.dof = 3;
  s.rate_hz = 2000.5;
  s.duration_s = 8.25;
  s.steps = 4000000000U;
  s.stable = true;
  s.verdict = "bounded";
  double next = 0.1;
  for (double* each : {&s.min_port_energy_j,
                       &s.initial_energy_j,
                       &s.min_observed_energy_j,
                       &s.energy_owed_j,
                       &s.dissipated_j,
                       &s.position_error_rms_m,
                       &s.drift_m,
                       &s.force_error_rms_n,
                       &s.force_direction_error_max_deg,
                       &s.force_direction_error_rms_deg,
                       &s.chatter_rms_n,
                       &s.max_force_n,
                       &s.contact_s,
                       &s.correction_max_n,
                       &s.step_ns,
                       &s.rtt_ms.p50,
                       &s.rtt_ms.p99,
                       &s.rtt_ms.p999,
                       &s.rtt_ms.max,
                       &s.loop_lateness_us.p50,
                       &s.loop_lateness_us.p99,
                       &s.loop_lateness_us.p999,
                       &s.loop_lateness_us.max})
    *each = -(next += 0.1) / 3.0;
  s.to_slave = {11, 12, 13, 14, 15, 16};
  s.to_master = {21, 22, 23, 24, 25, 26};
  s.corrected_ticks = 31;
  s.deadline_misses = 32;
  s.mode = "coupled";
  s.reconnects = 33;
  return s;
}

schema::Summary from_json(const std::string& json) {
  schema::Summary message;
  const auto status = google::protobuf::util::JsonStringToMessage(json, &message);
  EXPECT_TRUE(status.ok()) << status.ToString() << "\n" << json;
  return message;
}

TEST(SummaryJson, ComesBackAsItWas) {
  const Summary s = full_summary();
  const schema::Summary back = from_json(to_json(s));
  EXPECT_EQ(back.scene(), s.scene);
  EXPECT_EQ(back.side(), s.side);
  EXPECT_EQ(back.architecture(), s.architecture);
  EXPECT_EQ(back.method(), s.method);
  EXPECT_EQ(back.dof(), s.dof);
  EXPECT_EQ(back.rate_hz(), s.rate_hz);
  EXPECT_EQ(back.duration_s(), s.duration_s);
  EXPECT_EQ(back.steps(), s.steps);
  EXPECT_EQ(back.stable(), s.stable);
  EXPECT_EQ(back.verdict(), s.verdict);
  EXPECT_EQ(back.min_port_energy_j(), s.min_port_energy_j);
  EXPECT_EQ(back.initial_energy_j(), s.initial_energy_j);
  EXPECT_EQ(back.min_observed_energy_j(), s.min_observed_energy_j);
  EXPECT_EQ(back.energy_owed_j(), s.energy_owed_j);
  EXPECT_EQ(back.dissipated_j(), s.dissipated_j);
  EXPECT_EQ(back.position_error_rms_m(), s.position_error_rms_m);
  EXPECT_EQ(back.drift_m(), s.drift_m);
  EXPECT_EQ(back.force_error_rms_n(), s.force_error_rms_n);
  EXPECT_EQ(back.force_direction_error_max_deg(), s.force_direction_error_max_deg);
  EXPECT_EQ(back.force_direction_error_rms_deg(), s.force_direction_error_rms_deg);
  EXPECT_EQ(back.chatter_rms_n(), s.chatter_rms_n);
  EXPECT_EQ(back.max_force_n(), s.max_force_n);
  EXPECT_EQ(back.contact_s(), s.contact_s);
  EXPECT_EQ(back.correction_max_n(), s.correction_max_n);
  EXPECT_EQ(back.corrected_ticks(), s.corrected_ticks);
  EXPECT_EQ(back.packets().to_slave().sent(), 11U);
  EXPECT_EQ(back.packets().to_slave().received(), 12U);
  EXPECT_EQ(back.packets().to_slave().lost(), 13U);
  EXPECT_EQ(back.packets().to_slave().late(), 14U);
  EXPECT_EQ(back.packets().to_slave().duplicated(), 15U);
  EXPECT_EQ(back.packets().to_slave().rejected(), 16U);
  EXPECT_EQ(back.packets().to_master().sent(), 21U);
  EXPECT_EQ(back.packets().to_master().rejected(), 26U);
  EXPECT_EQ(back.rtt_ms().p50(), s.rtt_ms.p50);
  EXPECT_EQ(back.rtt_ms().p99(), s.rtt_ms.p99);
  EXPECT_EQ(back.rtt_ms().p999(), s.rtt_ms.p999);
  EXPECT_EQ(back.rtt_ms().max(), s.rtt_ms.max);
  EXPECT_EQ(back.loop_lateness_us().p50(), s.loop_lateness_us.p50);
  EXPECT_EQ(back.loop_lateness_us().max(), s.loop_lateness_us.max);
  EXPECT_EQ(back.deadline_misses(), s.deadline_misses);
  EXPECT_EQ(back.step_ns(), s.step_ns);
  EXPECT_EQ(back.mode(), s.mode);
  EXPECT_EQ(back.reconnects(), s.reconnects);
}

TEST(SummaryJson, CarriesEveryFieldOfTheSchema) {
  for (const auto& [name, value] : numbers(full_summary())) EXPECT_NE(value, 0.0) << name << " was left behind";
}

TEST(SummaryJson, PrintsZerosAndFalsesUnderTheSchemasNames) {
  Summary s;
  s.stable = false;
  EXPECT_TRUE(says(to_json(s), {"\"stable\": false", "\"min_port_energy_j\": 0", "\"verdict\": \"\"", "\"to_slave\": {",
                                "\"rejected\": 0", "\"rtt_ms\": {", "\"p999\": 0"}));
}

TEST(SummaryJson, WhatIsNotFiniteSurvives) {
  Summary s;
  s.drift_m = std::numeric_limits<double>::quiet_NaN();
  s.max_force_n = std::numeric_limits<double>::infinity();
  s.min_port_energy_j = -std::numeric_limits<double>::infinity();
  const schema::Summary back = from_json(to_json(s));
  EXPECT_TRUE(std::isnan(back.drift_m()));
  EXPECT_EQ(back.max_force_n(), s.max_force_n);
  EXPECT_EQ(back.min_port_energy_j(), s.min_port_energy_j);
}

TEST(SummaryNumbers, AreInTheSchemasOrderWithDottedNames) {
  const auto all = numbers(full_summary());
  std::vector<std::string> names;
  for (const auto& [name, value] : all) names.push_back(name);
  const std::vector<std::string> first(names.begin(), names.begin() + 6);
  EXPECT_EQ(first, (std::vector<std::string>{"dof", "rate_hz", "duration_s", "steps", "stable", "min_port_energy_j"}));
  const auto place = [&](const char* name) { return std::find(names.begin(), names.end(), name) - names.begin(); };
  EXPECT_LT(place("chatter_rms_n"), place("packets.to_slave.sent"));
  EXPECT_LT(place("packets.to_slave.rejected"), place("packets.to_master.sent"));
  EXPECT_LT(place("packets.to_master.rejected"), place("rtt_ms.p50"));
  EXPECT_LT(place("rtt_ms.max"), place("deadline_misses"));
  EXPECT_EQ(std::set<std::string>(names.begin(), names.end()).size(), names.size());
  const auto value = [&](const char* name) {
    const auto found = std::find_if(all.begin(), all.end(), [&](const auto& each) { return each.first == name; });
    return found == all.end() ? std::numeric_limits<double>::quiet_NaN() : found->second;
  };
  EXPECT_EQ(value("stable"), 1.0);
  EXPECT_EQ(value("steps"), 4e9);
  EXPECT_EQ(value("packets.to_master.lost"), 23.0);
  EXPECT_EQ(value("rtt_ms.p99"), full_summary().rtt_ms.p99);
}

TEST(SummaryNames, AreThoseOfTheScene) {
  EXPECT_EQ(to_string(Architecture::render), "RENDER");
  EXPECT_EQ(to_string(Architecture::position_measured_force), "POSITION_MEASURED_FORCE");
  EXPECT_EQ(to_string(Method::none), "NONE");
  EXPECT_EQ(to_string(Method::force_projected), "FORCE_PROJECTED");
}

// ---- files that are whole or not at all

TEST(WriteWhole, LeavesTheTextAndNothingElse) {
  const Folder folder;
  write_whole(folder.file("summary.json"), "first");
  write_whole(folder.file("summary.json"), "second");
  EXPECT_EQ(text_of(folder.file("summary.json")), "second");
  EXPECT_EQ(folder.names(), std::set<std::string>{"summary.json"});
}

TEST(WriteWhole, SaysWhyItCannot) {
  const Folder folder;
  try {
    write_whole(folder.file("none/summary.json"), "text");
    FAIL() << "it wrote";
  } catch (const ConfigError& e) {
    EXPECT_TRUE(says(e.what(), {"none/summary.json: cannot be written: No such file or directory"}));
  }
  EXPECT_TRUE(folder.names().empty());
}

TEST(WriteWhole, KeepsTheOldFileWhenTheDiskIsFull) {
  const Folder folder;
  write_whole(folder.file("summary.json"), "old");
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  auto* const handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{1000, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  bool refused = false;
  try {
    write_whole(folder.file("summary.json"), std::string(5000, 'x'));
  } catch (const ConfigError&) {
    refused = true;
  }
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  EXPECT_TRUE(refused);
  EXPECT_EQ(text_of(folder.file("summary.json")), "old");
  EXPECT_EQ(folder.names(), std::set<std::string>{"summary.json"});
}

TEST(WriteWhole, LeavesNothingBesideWhenItCannotTakeTheName) {
  const Folder folder;
  std::filesystem::create_directories(folder.file("summary.json"));
  EXPECT_THROW(write_whole(folder.file("summary.json"), "text"), ConfigError);
  EXPECT_EQ(folder.names(), std::set<std::string>{"summary.json"});
}

// ---- promises

using Sentences = std::vector<std::string>;

TEST(Promises, KeptOnesSayNothing) {
  Summary s;
  s.min_port_energy_j = -1e-4;
  s.drift_m = 0.01;
  EXPECT_EQ(broken_promises({.stable = true,
                             .at_least = {{"min_port_energy_j", -1e-4}},
                             .at_most = {{"drift_m", 0.01}, {"packets.to_slave.lost", 0}}},
                            s),
            Sentences{});
  EXPECT_EQ(broken_promises({}, s), Sentences{});
}

TEST(Promises, BrokenOnesSayByHowMuch) {
  Summary s;
  s.min_port_energy_j = -0.0123;
  s.drift_m = 0.5;
  s.rtt_ms.p99 = 7;
  EXPECT_EQ(broken_promises({.stable = {},
                             .at_least = {{"min_port_energy_j", -0.0001}},
                             .at_most = {{"drift_m", 0.2}, {"rtt_ms.p99", 5}}},
                            s),
            (Sentences{"min_port_energy_j is -0.0123, promised at least -0.0001: short by 0.0122",
                       "drift_m is 0.5, promised at most 0.2: over by 0.3",
                       "rtt_ms.p99 is 7, promised at most 5: over by 2"}));
}

TEST(Promises, OfStabilityAndOfInstabilityAreBothHeld) {
  Summary s;
  s.stable = false;
  s.verdict = "grows";
  EXPECT_EQ(broken_promises({.stable = true, .at_least = {}, .at_most = {}}, s),
            Sentences{"stable is false, promised true: grows"});
  EXPECT_EQ(broken_promises({.stable = false, .at_least = {}, .at_most = {}}, s), Sentences{});
  s.stable = true;
  s.verdict = "bounded";
  EXPECT_EQ(broken_promises({.stable = false, .at_least = {}, .at_most = {}}, s),
            Sentences{"stable is true, promised false: bounded"});
}

TEST(Promises, ANumberThatIsNoneKeepsNoPromise) {
  Summary s;
  s.drift_m = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(broken_promises({.stable = {}, .at_least = {{"drift_m", -1}}, .at_most = {{"drift_m", 1}}}, s),
            (Sentences{"drift_m is nan, promised at least -1", "drift_m is nan, promised at most 1"}));
}

TEST(Promises, AnUnknownNumberIsAnError) {
  try {
    static_cast<void>(broken_promises({.stable = {}, .at_least = {{"drift", 0}}, .at_most = {}}, Summary{}));
    FAIL() << "it was known";
  } catch (const ConfigError& e) {
    EXPECT_TRUE(says(e.what(), {"\"drift\""}));
  }
}

}  // namespace
}  // namespace twoport
