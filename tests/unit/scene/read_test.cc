#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/base/check.h"
#include "common/coupling/layers.h"
#include "common/scene/shown.h"
#include "proto/scene.pb.h"
#include "tests/support/folder.h"
#include "tests/support/meshes.h"
#include "tests/unit/scene/scenes.h"

namespace twoport::test::read_test {
namespace {

TEST(Scene, ReadsTheStiffWallOfTheContract) {
  const Scene s = scene_of(kStiffWall);
  EXPECT_EQ(s.name, "stiff wall at 50 ms");
  EXPECT_EQ(s.dof, 3);
  EXPECT_EQ(s.axes(), 3);
  EXPECT_EQ(s.duration_s, 8.0);
  EXPECT_EQ(s.rate_hz, 2000.0);
  EXPECT_EQ(s.seed, 7U);

  ASSERT_TRUE(s.operator_model && s.operator_model->hand);
  EXPECT_EQ(s.operator_model->hand->mass_kg, 0.02);
  EXPECT_EQ(s.operator_model->hand->stiffness_n_per_m, 300.0);
  EXPECT_EQ(s.operator_model->hand->damping_n_s_per_m, 1.0);
  ASSERT_EQ(s.operator_model->path.size(), 3U);
  EXPECT_EQ(std::get<MoveToSpec>(s.operator_model->path[0]).position_m, (Numbers{0.03, 0, 0}));
  EXPECT_EQ(std::get<MoveToSpec>(s.operator_model->path[0]).duration_s, 1.0);
  const auto& sine = std::get<SineSpec>(s.operator_model->path[1]);
  EXPECT_EQ(sine.axis, 1);
  EXPECT_EQ(sine.amplitude_m, 0.04);
  EXPECT_EQ(sine.frequency_hz, 0.5);
  EXPECT_EQ(sine.duration_s, 4.0);
  EXPECT_EQ(std::get<HoldSpec>(s.operator_model->path[2]).duration_s, 1.0);

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

TEST(Scene, NeedsADurationInTheLaboratoryOnly) {
  EXPECT_TRUE(std::isinf(parse_scene("dof: 1", "live", {}, SceneFor::live).duration_s));
  EXPECT_EQ(parse_scene("dof: 1", "live", Overrides{"duration_s=2"}, SceneFor::live).duration_s, 2.0);
  EXPECT_TRUE(says(error_of("dof: 1"), {"duration_s is missing; it must be > 0"}));
}

// Live a session takes its peer to be gone after 100 ms.
TEST(Scene, HasALongerSilenceInTheLaboratoryOnly) {
  const Overrides ten_hz{"duration_s=1", "control.hold_after_s=0.5", "to_slave.deadband={ratio: 1 silence_ms: 100}"};
  EXPECT_EQ(parse_scene("dof: 1", "test", ten_hz).transmission_to_slave.deadband->silence_s, 0.1);
  EXPECT_THROW(parse_scene("dof: 1", "test", ten_hz, SceneFor::live), ConfigError);
}

TEST(Scene, ThatSaysNothingOfTheControllersHasTheDefaultsOfTheirOptions) {
  for (const std::string dof : {"1", "3", "6"}) {
    const ControlOptions scene = scene_of("duration_s: 1 dof: " + dof).control, own;
    EXPECT_EQ(scene.architecture, own.architecture);
    EXPECT_EQ(scene.coupling.stiffness_n_per_m, own.coupling.stiffness_n_per_m);
    EXPECT_EQ(scene.coupling.damping_n_s_per_m, own.coupling.damping_n_s_per_m);
    EXPECT_EQ(scene.coupling.rotational_stiffness_n_m_per_rad, own.coupling.rotational_stiffness_n_m_per_rad);
    EXPECT_EQ(scene.coupling.rotational_damping_n_m_s_per_rad, own.coupling.rotational_damping_n_m_s_per_rad);
    EXPECT_EQ(scene.coupling.catch_up_m_per_s, own.coupling.catch_up_m_per_s);
    EXPECT_EQ(scene.coupling.drift_compensation, own.coupling.drift_compensation);
    EXPECT_EQ(scene.force_scale, own.force_scale);
    EXPECT_EQ(scene.motion_scale, own.motion_scale);
    EXPECT_EQ(scene.registration.absolute, own.registration.absolute);
    EXPECT_EQ(scene.registration.rotation.coeffs(), own.registration.rotation.coeffs());
    EXPECT_EQ(scene.registration.position_m, own.registration.position_m);
    EXPECT_EQ(scene.method_name, kDefaultMethod);
    EXPECT_EQ(scene.controller.method, own.controller.method);
    EXPECT_EQ(scene.controller.max_gain, own.controller.max_gain);
    EXPECT_EQ(scene.controller.unilateral, own.controller.unilateral);
    EXPECT_EQ(scene.controller.predict, own.controller.predict);
    EXPECT_EQ(scene.observer, own.observer);
    EXPECT_EQ(scene.accounts, own.accounts);
    EXPECT_EQ(scene.reference_energy, own.reference_energy);
    EXPECT_EQ(scene.initial_energy.si(), own.initial_energy.si());
    EXPECT_EQ(scene.handle_mass_kg, own.handle_mass_kg);
    EXPECT_EQ(scene.handle_inertia_kg_m2, own.handle_inertia_kg_m2);
    EXPECT_EQ(scene.max_force_n, own.max_force_n);
    EXPECT_EQ(scene.engage.si(), own.engage.si());
    EXPECT_EQ(scene.hold_after.si(), own.hold_after.si());
    EXPECT_EQ(scene.release_after.si(), own.release_after.si());
  }
}

TEST(Scene, ReadsHowTheWorldIsStepped) {
  EXPECT_EQ(scene_of(kStiffWall).simulation.integrator, Integrator::exact);
  const Scene s = scene_of(kStiffWall, {"simulation.integrator=SYMPLECTIC_EULER", "simulation.substeps=10"});
  EXPECT_EQ(s.simulation.integrator, Integrator::symplectic_euler);
  EXPECT_EQ(s.simulation.substeps, 10);
  EXPECT_TRUE(says(error_of(kStiffWall, {"simulation.substeps=0"}), {"simulation.substeps is 0", "1 to 10000"}));
  EXPECT_EQ(error_of(kStiffWall, {"simulation.integrator=TRAPEZOIDAL"}), "");
  EXPECT_TRUE(says(error_of(kStiffWall, {"simulation.integrator=TRAPEZOIDAL", "environment[0].wall.friction=0.1"}),
                   {"simulation.integrator is TRAPEZOIDAL", "one wall without friction"}));
}

TEST(Scene, OfABodyAloneHasNothingElse) {
  const std::string body =
      "dof: 1 duration_s: 1 control { architecture: UNCONTROLLED } environment { spring { stiffness_n_per_m: 1 } }";
  EXPECT_TRUE(says(error_of(body, {}), {"robot is missing", "UNCONTROLLED"}));
  EXPECT_EQ(error_of(body, {"robot.mass_kg=1"}), "");
  EXPECT_TRUE(says(error_of(body, {"robot.mass_kg=1", "device.mass_kg=1"}), {"device is given", "UNCONTROLLED"}));
}

TEST(Scene, ReadsAScrewAndATremor) {
  const Scene s = scene_of(kStiffWall, {"operator.tremor={rms_m: 1.5e-4}",
                                        "operator.path[3].screw={point_m: [1, 2, 3] axis: [0, 3, 4] angle_rad: 0.5 "
                                        "travel_m: 0.03 frequency_hz: 0.5 duration_s: 2}"});
  EXPECT_FALSE(scene_of(kStiffWall).operator_model->tremor);
  ASSERT_TRUE(s.operator_model->tremor);
  EXPECT_EQ(s.operator_model->tremor->rms_m, 1.5e-4);
  EXPECT_EQ(s.operator_model->tremor->low_hz, 2.0);
  EXPECT_EQ(s.operator_model->tremor->high_hz, 12.0);
  const auto& screw = std::get<ScrewSpec>(s.operator_model->path.at(3));
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
  EXPECT_FALSE(s.operator_model || s.robot);
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
  EXPECT_EQ(s.operator_model->hand->rotational_stiffness_n_m_per_rad, 2.0);
  EXPECT_EQ(s.operator_model->hand->rotational_damping_n_m_s_per_rad, 0.1);
  EXPECT_EQ(s.device->inertia_kg_m2, 1e-4);
  EXPECT_EQ(s.device->rotational_damping_n_m_s_per_rad, 1e-3);
  EXPECT_EQ(s.device->position_m, (Numbers{0, 0, 0.1, 1, 0, 0, 0}));
  EXPECT_EQ(s.device->velocity_m_per_s, (Numbers{0, 0, 0, 0, 0, 1}));
  EXPECT_EQ(s.control.coupling.rotational_stiffness_n_m_per_rad, 5.0);
  EXPECT_EQ(s.control.coupling.rotational_damping_n_m_s_per_rad, 0.3);
  EXPECT_TRUE(s.control.registration.absolute);
  EXPECT_EQ(s.control.registration.rotation.coeffs(), Eigen::Vector4d(0.8, 0, 0, 0.6));
  EXPECT_EQ(s.control.registration.position_m, Vector3d(0.1, 0.2, 0.3));
  EXPECT_EQ(s.robot->inertia_kg_m2, (Numbers{1e-3, 2e-3, 3e-3}));
  EXPECT_EQ(s.robot->rotational_damping_n_m_s_per_rad, 0.01);
  EXPECT_EQ(s.robot->position_m, (Numbers{1, 2, 3}));
  EXPECT_EQ(s.robot->velocity_m_per_s, (Numbers{4, 5, 6}));
  EXPECT_EQ(std::get<MoveToSpec>(s.operator_model->path[1]).position_m, (Numbers{0, 0, 0.1, 0, 1, 0, 0}));
  EXPECT_EQ(std::get<SineSpec>(s.operator_model->path[2]).axis, 5);
  EXPECT_EQ(s.robot->force_sensor->noise_n, 0.01);
  EXPECT_EQ(s.robot->force_sensor->bias_n, (Numbers{0, 0, 0, 1, 2, 3}));
  EXPECT_EQ(s.robot->force_sensor->latency_s, 2e-3);

  ASSERT_EQ(s.environment.size(), 11U);
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
  const Torus torus = shape_of<Torus>(s.environment[5]);
  EXPECT_EQ(torus.axis, Vector3d(0, 0, 1));
  EXPECT_EQ(torus.tube_radius_m, 0.02);
  EXPECT_EQ(shape_of<Capsule>(s.environment[6]).end_m, Vector3d(0.1, 0, 6));
  EXPECT_EQ(shape_of<Peg>(s.environment[7]).profile->segments().size(), 4U);  // end, chamfer, side, back
  EXPECT_EQ(shape_of<Hole>(s.environment[8]).profile->segments().size(), 4U);
  EXPECT_EQ(shape_of<Cone>(s.environment[9]).point_m, Vector3d(0, 0, 9));
  const Plate plate = shape_of<Plate>(s.environment[10]);
  EXPECT_EQ(plate.holes->at(0).radius_m, 0.05);
  EXPECT_LT((plate.rotation * Vector3d::UnitY() - Vector3d{0, -0.28, 0.96}).norm(), 1e-15);
  ASSERT_GT(s.tool.size(), 10U);
  EXPECT_EQ(s.tool[0], Vector3d(0, 0, 0.05));
  EXPECT_EQ(s.tool[1], Vector3d(0.01, 0, 0.05));
  for (std::size_t i = 2; i < s.tool.size(); ++i) {
    const double along = std::clamp(s.tool[i].z(), 0.0, 0.02);
    EXPECT_NEAR((s.tool[i] - Vector3d{0, 0, along}).norm(), 0.005, 1e-15);
  }
}

TEST(Scene, ReadsAMeshBesideIt) {
  const Folder folder;
  folder.write("lab.textproto", kStiffWall);
  folder.write("part.obj", obj(box_mesh({10, 20, 30})));
  const std::string box =
      "environment[0]={mesh { file: \"part.obj\" scale: 1e-3 position_m: [0, 0, 1] voxel_m: 2e-3 stiffness_n_per_m: 5 "
      "}}";
  const Scene s = load_scene(folder / "lab.textproto", Overrides{box}),
              again = load_scene(folder / "lab.textproto", Overrides{box});
  const Mesh mesh = shape_of<Mesh>(s.environment[0]);
  EXPECT_NEAR(mesh.signed_distance<3>(Vector3d{0, 0, 1.031}, kNearest).distance, 1e-3, 1e-7);
  EXPECT_EQ(mesh.field, shape_of<Mesh>(again.environment[0]).field) << "one field for one mesh";

  const auto error = [&](const std::string& content, const std::string& more = "") -> std::string {
    folder.write("other.obj", content);
    try {
      static_cast<void>(
          load_scene(folder / "lab.textproto",
                     Overrides{"environment[0]={mesh { file: \"other.obj\" stiffness_n_per_m: 5 " + more + "}}"}));
      return "";
    } catch (const ConfigError& e) {
      return e.what();
    }
  };
  EXPECT_TRUE(
      says(error("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
           {"lab.textproto: environment[0].mesh.file: ",
            "other.obj has 3 edges of one triangle only, in 1 gap of which the largest is around (0.5, 0.5, 0) m "
            "and 1.41 m across; the mesh must be closed: in MeshLab by Merge Close Vertices, then Close Holes, "
            "in Blender by Merge by Distance, then Fill Holes"}));
  EXPECT_TRUE(
      says(error("v 1 2\n"), {"environment[0].mesh.file: ", "other.obj: line 1: \"\" stands where a coordinate"}));
  TriangleMesh inward = box_mesh({1, 1, 1});
  for (TriangleMesh::Triangle& t : inward.triangles) std::swap(t[0], t[1]);
  EXPECT_TRUE(says(error(obj(inward)), {"has its triangles facing inwards"}));
  // A thin one has finer samples; one that is too thin is refused by its own numbers.
  EXPECT_EQ(error(obj(box_mesh({1, 1, 0.002}))), "");
  EXPECT_TRUE(says(error(obj(box_mesh({1, 1, 0.001}))),
                   {"environment[0].mesh.file is 2 m long and 0.002 m thick; half of that as voxel_m makes"}));
  EXPECT_TRUE(
      says(error(obj(box_mesh({1, 1, 0.002})), "voxel_m: 0.01"),
           {"environment[0].mesh.voxel_m is 0.01; it must be at most 0.002, half of the mesh's shortest side"}));
  EXPECT_TRUE(says(error(obj(box_mesh({1, 1, 1})), "voxel_m: 1e-4"),
                   {"environment[0].mesh.voxel_m is 0.0001; it must make at most 3.2e+07 samples"}));
}

/// What no computation needs, but a picture: triangles in their places, parts of the tool as they are.
TEST(Scene, KnowsTheShapesThatAPictureShows) {
  const Folder folder;
  folder.write("lab.textproto", kTurning);
  folder.write("part.obj", obj(box_mesh({10, 20, 30})));
  folder.write("fine.stl", binary_stl(torus_mesh(0.05, 0.02, 200, 100)));
  const Scene s = load_scene(
      folder / "lab.textproto",
      Overrides{
          "environment[11]={mesh { file: \"part.obj\" scale: 1e-3 position_m: [0, 0, 1] rotation: [0.6, 0.8, 0, 0] "
          "stiffness_n_per_m: 5 }}",
          "tool.part[1]={mesh { file: \"fine.stl\" position_m: [0, 0, 0.1] } spacing_m: 0.02}"});
  const ShownShapes shown = shown_shapes(s);
  ASSERT_EQ(shown.meshes.size(), 1U);
  ASSERT_EQ(shown.meshes[0].triangles.size(), 12U);
  const Vector3d corner{0.01, -0.28 * 0.02 - 0.96 * 0.03, 1 + 0.96 * 0.02 - 0.28 * 0.03};
  EXPECT_LT((shown.meshes[0].vertices[7] - corner).norm(), 1e-9);
  EXPECT_EQ(shown.tool_alone, 2U);
  ASSERT_EQ(shown.tool_parts.size(), 2U);
  EXPECT_EQ(std::get<Capsule>(shown.tool_parts[0]).radius_m, 0.005);
  const auto& ring = std::get<TriangleMesh>(shown.tool_parts[1]);
  EXPECT_LE(ring.triangles.size(), kMostShownTriangles / 2);
  EXPECT_GT(ring.triangles.size(), 1000U);
  for (const Vector3d& v : ring.vertices) EXPECT_LT(std::abs(v.z() - 0.1), 0.0201);
  EXPECT_TRUE(shown_shapes(Scene{}).tool_parts.empty());
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

TEST(Scene, AScheduleStartsFromTheControlBefore) {
  const Scene s = scene_of(
      kStiffWall, {"control.passivity.max_gain=7", "control.schedule={at_s: 2 passivity { method: INTERNAL_MODEL }}",
                   "control.schedule[1]={architecture: POSITION_POSITION}",
                   "control.schedule[2]={at_s: 3 passivity { method: NONE max_gain: 8 }}"});
  ASSERT_EQ(s.schedule.size(), 3U);
  const ControlOptions &a = s.schedule[0].control, &b = s.schedule[1].control, &c = s.schedule[2].control;
  EXPECT_EQ(s.schedule[0].at_s, 2.0);
  EXPECT_EQ(s.schedule[1].at_s, std::numeric_limits<double>::infinity());
  EXPECT_EQ(a.method_name, "INTERNAL_MODEL");
  EXPECT_EQ(a.controller.max_gain, 7.0);
  EXPECT_EQ(a.architecture, s.control.architecture);
  EXPECT_EQ(b.method_name, "INTERNAL_MODEL");
  EXPECT_EQ(b.architecture, Architecture::position_position);
  EXPECT_EQ(c.method_name, "NONE");
  EXPECT_EQ(c.controller.max_gain, 8.0);
  for (const ControlOptions* each : {&a, &b, &c}) {
    EXPECT_EQ(each->handle_mass_kg, s.control.handle_mass_kg);
    EXPECT_EQ(each->max_force_n, s.control.max_force_n);
    EXPECT_EQ(each->known.robot_mass_kg, s.control.known.robot_mass_kg);
  }
}

TEST(Scene, ReadsWhatSidesDoWithTheirPackets) {
  const Scene s = scene_of(kStiffWall, {"to_slave={delay_ms: 10 playout_ms: 20 deadband { ratio: 0.2 force_n: 0.1 }}",
                                        "to_master={delay_ms: 10 delay_step { at_s: 1 delay_ms: 30 }}",
                                        "slave_clock={offset_ms: 50 drift_ppm: -200}"});
  EXPECT_DOUBLE_EQ(s.transmission_to_slave.playout_s, 0.02);
  EXPECT_EQ(s.transmission_to_slave.deadband->ratio, 0.2);
  EXPECT_EQ(s.transmission_to_slave.deadband->force_n, 0.1);
  EXPECT_DOUBLE_EQ(s.transmission_to_slave.deadband->silence_s, 0.02);
  EXPECT_FALSE(s.transmission_to_master.deadband);
  EXPECT_DOUBLE_EQ(s.to_master.delay_step.at(0).delay_s, 0.03);
  EXPECT_DOUBLE_EQ(s.slave_clock.offset_s, 0.05);
  EXPECT_DOUBLE_EQ(s.slave_clock.drift, -200e-6);
  EXPECT_DOUBLE_EQ(s.control.known.round_trip.si(), 0.04) << "the wait in the playout buffer is part of the delay";
}

TEST(Scene, FillsInWhatItDoesNotSay) {
  const Scene s = scene_of("dof: 3 duration_s: 1");
  EXPECT_EQ(s.name, "x");  // after its file
  EXPECT_EQ(s.rate_hz, 1000.0);
  EXPECT_EQ(s.master_rate_hz, 1000.0);
  EXPECT_EQ(s.slave_rate_hz, 1000.0);
  EXPECT_EQ(s.seed, 1U);
  EXPECT_FALSE(s.operator_model || s.device || s.robot);
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

TEST(Scene, TellsMethodsWhatIsKnownOfTheSystem) {
  const KnownSystem known = scene_of(kStiffWall, {"slave_rate_hz=500", "to_master.delay_ms=20"}).control.known;
  EXPECT_DOUBLE_EQ(known.round_trip.si(), 0.07);
  EXPECT_EQ(known.master_tick.si(), 1.0 / 2000);
  EXPECT_EQ(known.slave_tick.si(), 1.0 / 500);
  EXPECT_EQ(known.device_damping_n_s_per_m, 0.05);
  EXPECT_EQ(known.robot_mass_kg, 0.5);
  EXPECT_EQ(known.robot_inertia_kg_m2, 0.0);
  EXPECT_EQ(scene_of(kTurning).control.known.robot_inertia_kg_m2, 1e-3);
  EXPECT_EQ(scene_of(kStiffWall, {"control.passivity.round_trip_ms=300"}).control.known.round_trip.si(), 0.3);
}

TEST(Scene, OptionsOfMethodsAreAbsentUntilGivenAndAllowedUnderAnyMethod) {
  EXPECT_FALSE(scene_of(kStiffWall).control.fixed_damping.damping_n_s_per_m);
  const ControlOptions o = scene_of(kStiffWall, {"control.passivity.fixed_damping.damping_n_s_per_m=7",
                                                 "control.passivity.wave_variables.receiver=ZERO"})
                               .control;
  EXPECT_EQ(o.method_name, "FORCE_PROJECTED");
  EXPECT_EQ(o.fixed_damping.damping_n_s_per_m, 7.0);
  EXPECT_EQ(o.wave_variables.receiver, WaveReceiverRule::zero);
  EXPECT_EQ(scene_of(kStiffWall, {"control.passivity.wave_variables.receiver=HOLD"}).control.wave_variables.receiver,
            WaveReceiverRule::hold);
}

/// The fields of that block.
std::vector<std::string> fields_of(const std::string& block) {
  std::vector<std::string> all;
  for (const auto* in : {schema::Passivity::descriptor(), schema::Transparency::descriptor()})
    if (const auto* field = in->FindFieldByName(block))
      for (int i = 0; i < field->message_type()->field_count(); ++i)
        all.push_back(field->message_type()->field(i)->name());
  std::sort(all.begin(), all.end());
  return all;
}
TEST(Scene, EachFieldOfALayersBlockIsAnOption) {
  const auto check = [](const char* block, const std::string& of_block) {
    std::vector<std::string> read;
    for (std::istringstream in{of_block}; std::getline(in >> std::ws, read.emplace_back(), ',');) {
    }
    read.pop_back();
    std::sort(read.begin(), read.end());
    EXPECT_EQ(read, fields_of(block)) << block;
  };
#define TWOPORT_LAYER_OPTIONS(BLOCK, Struct) check(#BLOCK, Struct::kOfBlock);
#include "common/method/list.h"
#undef TWOPORT_LAYER_OPTIONS
}

TEST(Scene, AccountsStartWithAMillijouleOverALinkAndWithNothingUnderRender) {
  EXPECT_EQ(scene_of(kStiffWall).control.initial_energy.si(), 1e-3);
  EXPECT_EQ(scene_of(kHeldSpring).control.initial_energy.si(), 0.0);
  EXPECT_EQ(scene_of(kStiffWall, {"control.passivity.initial_energy_j=0"}).control.initial_energy.si(), 0.0);
  EXPECT_EQ(scene_of(kHeldSpring, {"control.passivity.initial_energy_j=0.5"}).control.initial_energy.si(), 0.5);
}

// Internal-model control: K_c (50 mm/s R)²/2 between 1 and 20 mJ; 1 kN/m of the coupling's default.
TEST(Scene, InternalModelControlStartsWithTheEnergyOfABlindWay) {
  const auto initial_j = [](const std::vector<std::string>& more) {
    std::vector<std::string> all{"control.passivity.method=INTERNAL_MODEL",
                                 "control.virtual_coupling.stiffness_n_per_m=1000",
                                 "control.passivity.round_trip_ms=100", "robot.force_sensor={}"};
    all.insert(all.end(), more.begin(), more.end());
    return scene_of(kStiffWall, all).control.initial_energy.si();
  };
  EXPECT_DOUBLE_EQ(initial_j({}), 12.5e-3);
  EXPECT_DOUBLE_EQ(initial_j({"control.passivity.round_trip_ms=20"}), 1e-3);
  EXPECT_DOUBLE_EQ(initial_j({"control.passivity.round_trip_ms=500"}), 20e-3);
  EXPECT_DOUBLE_EQ(initial_j({"control.virtual_coupling.stiffness_n_per_m=500"}), 6.25e-3);
  EXPECT_DOUBLE_EQ(initial_j({"control.force_scale=0.5", "control.motion_scale=0.5"}), 3.125e-3);
  EXPECT_EQ(initial_j({"control.passivity.initial_energy_j=0"}), 0.0);
  EXPECT_EQ(initial_j({"control.passivity.initial_energy_j=1e-3"}), 1e-3);
  EXPECT_EQ(initial_j({"control.passivity.method=CLASSIC"}), 1e-3);
}

TEST(Scene, PositionsThatAreNotGivenStayEmpty) {
  const Scene s = scene_of(
      kStiffWall, {"operator.path[0].move_to.position_m=[]", "environment[0]={spring {stiffness_n_per_m: 1}}"});
  EXPECT_TRUE(s.device->position_m.empty() && s.device->velocity_m_per_s.empty());
  EXPECT_TRUE(s.robot->position_m.empty());
  EXPECT_TRUE(std::get<MoveToSpec>(s.operator_model->path[0]).position_m.empty());
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
  EXPECT_EQ(error_of(kStiffWall, {"device.mass_kg=0"}), "");
  EXPECT_EQ(error_of(kStiffWall, {"operator.hand.mass_kg=0"}), "");
  EXPECT_EQ(error_of(kTurning, {"device.inertia_kg_m2=0", "operator.hand.inertia_kg_m2=1e-5"}), "");
}

TEST(Scene, RefusesWhatIsTooStiffToBeWorthAModel) {
  const auto names = [](const std::string& override, const std::string& what, const char* scene = kStiffWall) {
    const std::string said = error_of(scene, {override});
    EXPECT_NE(said.find(what), std::string::npos) << override << ": " << said;
    EXPECT_NE(said.find("rad in a tick; it must be <= 10000"), std::string::npos) << override << ": " << said;
  };
  names("operator.hand.stiffness_n_per_m=1e15", "device and operator.hand: mass");
  names("device.damping_n_s_per_m=1e12", "device and operator.hand: mass");
  names("operator.hand.rotational_stiffness_n_m_per_rad=1e15", "device and operator.hand: inertia", kTurning);
  names("environment[0].wall.stiffness_n_per_m=1e15", "robot and environment: mass");
  names("robot.mass_kg=1e-30", "robot and environment: mass");
  names("robot.inertia_kg_m2=1e-12", "robot and environment: inertia", kTurning);
  EXPECT_EQ(error_of(kStiffWall, {"operator.hand.stiffness_n_per_m=1e12"}), "");
}

TEST(Scene, AnImposedPathOrAnIdealHandleNeedsNoMass) {
  EXPECT_EQ(error_of("dof: 6 duration_s: 1 operator { path { hold { duration_s: 1 } } } device { max_force_n: 5 }"),
            "");
  EXPECT_EQ(error_of("dof: 6 duration_s: 1"), "");
}

TEST(Scene, ALinkWithoutARobotHasAnIdealOne) {
  EXPECT_EQ(error_of("dof: 3 duration_s: 1 control { architecture: POSITION_MEASURED_FORCE } to_slave { delay_ms: 5 }"),
            "");
}

TEST(Scene, OnlyARenderingKnowsItsContacts) {
  for (const char* accounts : {"PER_CONTACT", "NORMAL_TANGENTIAL"}) {
    const std::string set = std::string{"control.passivity.accounts="} + accounts;
    EXPECT_EQ(error_of(kHeldSpring, {set}), "");
    EXPECT_TRUE(says(error_of(kTurning, {set}), {"scenes/x.textproto: control.passivity.accounts is", accounts,
                                                 "must be TOTAL over a link", "RENDER"}));
    EXPECT_TRUE(says(error_of(kStiffWall, {set}), {accounts, "must be TOTAL over", "RENDER"}));
  }
  EXPECT_EQ(error_of(kHeldSpring, {"control.passivity.reference_energy=true"}), "");
}

}  // namespace
}  // namespace twoport::test::read_test
