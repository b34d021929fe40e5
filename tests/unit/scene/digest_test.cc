#include <google/protobuf/descriptor.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "proto/scene.pb.h"
#include "tests/unit/scene/scenes.h"

namespace twoport::test::digest_test {
namespace {

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

/// An override for each option of the blocks in control.passivity that both sides share.
std::vector<std::string> shared_options_of_layers() {
  using Field = google::protobuf::FieldDescriptor;
  std::vector<std::string> all;
  const auto& passivity = *schema::Passivity::descriptor();
  for (int i = 0; i < passivity.field_count(); ++i) {
    const Field& block = *passivity.field(i);
    if (block.message_type() == nullptr || !block.options().GetExtension(schema::shared)) continue;
    for (int k = 0; k < block.message_type()->field_count(); ++k) {
      const Field& option = *block.message_type()->field(k);
      const auto* values = option.enum_type();
      const std::string value = values != nullptr                          ? values->value(1)->name()
                                : option.cpp_type() == Field::CPPTYPE_BOOL ? "true"
                                                                           : "1";
      all.push_back("control.passivity." + block.name() + "." + option.name() + "=" + value);
    }
  }
  EXPECT_GT(all.size(), 20U);
  return all;
}

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
                             "control.device_limits.force_n=9",
                             "control.robot_limits.speed_m_per_s=1",
                             "control.robot_limits.set_point_step_m=0.01",
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
                             "control.passivity.predict=false",
                             "control.passivity.round_trip_ms=1",
                             "control.schedule={at_s: 1 passivity { method: CLASSIC }}",
                             "control.schedule={at_s: 1 architecture: POSITION_POSITION}"})
    EXPECT_TRUE(seen.insert(scene_digest(scene_of(kSpelt, {shared}))).second)
        << shared << " made no difference of its own";
  for (const std::string& shared : shared_options_of_layers())
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
        "control.virtual_coupling.stiffness_n_per_m=1e3", "control.passivity.max_gain=10",
        "control.passivity.energy_bounding.damping_n_s_per_m=1", "to_slave.playout_ms=1",
        "to_master.deadband.ratio=0.1", "slave_clock.offset_ms=1", "device_mount.scale=2", "robot_mount.tool_mass_kg=1",
        "to_slave.delay_step={at_s: 1 delay_ms: 1}"})
    EXPECT_EQ(before, scene_digest(scene_of(kStiffWall, {own}))) << own;
}

TEST(SceneDigest, NamesTheFieldThatDiffers) {
  const std::vector<SharedField> before = shared_fields(scene_of(kSpelt));
  for (const std::string path :
       {"slave_rate_hz", "control.force_scale", "control.architecture", "control.engage_s",
        "control.virtual_coupling.rotational_damping_n_m_s_per_rad", "control.passivity.method",
        "control.passivity.observer", "control.passivity.predict", "control.passivity.round_trip_ms"}) {
    const std::string value = path == "control.architecture"         ? "POSITION_POSITION"
                              : path == "control.passivity.method"   ? "CLASSIC"
                              : path == "control.passivity.observer" ? "RECTANGLE"
                              : path == "control.passivity.predict"  ? "false"
                                                                     : "0.7";
    const std::vector<SharedField> after = shared_fields(scene_of(kSpelt, {path + "=" + value}));
    ASSERT_EQ(after.size(), before.size());
    for (std::size_t i = 0; i < before.size(); ++i) {
      EXPECT_EQ(after[i].path, before[i].path);
      EXPECT_EQ(after[i].digest != before[i].digest, before[i].path == path) << path << " and " << before[i].path;
    }
  }
}

TEST(SceneDigest, IsTheSameOnEveryMachine) {
  // Computed by hand from the definition; another shared option makes another number.
  EXPECT_EQ(scene_digest(scene_of(kSpelt)), 0xd0403dddcd467169ULL);
}

const char* const kWithGripper = R"(
dof: 1 duration_s: 1 rate_hz: 1000 operator { hand { mass_kg: 0.1 } } robot { mass_kg: 1 force_sensor { } }
control { virtual_coupling { stiffness_n_per_m: 1000 } passivity { method: FORCE_PROJECTED } }
gripper { operator { hand { mass_kg: 0.1 } } device { mass_kg: 0.05 } robot { mass_kg: 0.2 force_sensor { } } }
)";

TEST(SceneDigest, OfAGripperChangesWithWhatBothSidesShare) {
  const Scene scene = scene_of(kWithGripper);
  Scene without = scene;
  without.gripper = nullptr;
  std::set<std::uint64_t> seen{scene_digest(scene), scene_digest(without)};
  EXPECT_EQ(seen.size(), 2U);
  for (const char* shared :
       {"gripper.force_scale=2", "gripper.motion_scale=2", "gripper.initial_energy_j=0.5",
        "gripper.virtual_coupling.stiffness_n_per_m=700", "gripper.virtual_coupling.catch_up_m_per_s=0.1",
        "gripper.device_limits.force_n=9", "gripper.robot_limits.speed_m_per_s=1"})
    EXPECT_TRUE(seen.insert(scene_digest(scene_of(kWithGripper, {shared}))).second)
        << shared << " made no difference of its own";
}

TEST(SceneDigest, OfAGripperDoesNotChangeWithWhatIsASidesOwn) {
  const std::uint64_t before = scene_digest(scene_of(kWithGripper));
  for (const char* own :
       {"seed=8", "duration_s=9", "to_slave.delay_ms=200", "to_master.loss=0.5", "slave_clock.offset_ms=1",
        "gripper.operator.hand.mass_kg=1", "gripper.device.mass_kg=0.1", "gripper.device.max_force_n=8",
        "gripper.device.position_m=[0.06]", "gripper.robot.mass_kg=2", "gripper.robot.damping_n_s_per_m=3",
        "gripper.object={width_m: 0.04 stiffness_n_per_m: 2000}"})
    EXPECT_EQ(before, scene_digest(scene_of(kWithGripper, {own}))) << own;
}

/// A gripper without options of its own has those of the main coupling: no other field hides that the gripper differs.
TEST(SceneDigest, NamesTheGripperWhereItAloneDiffers) {
  const Scene scene = scene_of(kWithGripper);
  Scene without = scene;
  without.gripper = nullptr;
  const std::vector<SharedField> mine = shared_fields(scene);
  for (const Scene& other : {scene_of(kWithGripper, {"gripper.force_scale=2"}), without}) {
    const std::vector<SharedField> theirs = shared_fields(other);
    ASSERT_EQ(theirs.size(), mine.size());
    for (std::size_t i = 0; i < mine.size(); ++i)
      EXPECT_EQ(mine[i].digest != theirs[i].digest, mine[i].path == "gripper") << mine[i].path;
  }
}

// The slave need not know E(0) of an account that is the master's own; where each side has one, both must have the same.
TEST(SceneDigest, HasTheInitialEnergyOfAnAccountAtBothSides) {
  const auto digest = [](const std::string& control, const char* energy) {
    return scene_digest(
        scene_of("dof: 1 duration_s: 1 device { mass_kg: 0.1 damping_n_s_per_m: 1 } control { " + control + " }",
                 {std::string{"control.passivity.initial_energy_j="} + energy}));
  };
  for (const char* own : {"", "transparency { layer: CONTACT_SPRING }", "passivity { method: ENERGY_BOUNDING }"})
    EXPECT_EQ(digest(own, "0.001"), digest(own, "0.002")) << own;
  for (const char* both :
       {"passivity { internal_model { strict_two_port: true } }", "passivity { method: ENERGY_EXCHANGE }",
        "passivity { method: CLASSIC }", "passivity { method: ENERGY_TANK }"})
    EXPECT_NE(digest(both, "0.001"), digest(both, "0.002")) << both;
}

// The two programs may state different delays of one network; E(0) of internal-model control is that of the master.
TEST(SceneDigest, IsTheSameForOtherDelaysUnderInternalModelControl) {
  const auto digest = [](const char* delay) {
    return scene_digest(scene_of("dof: 1 duration_s: 1 control { passivity { method: INTERNAL_MODEL } }", {delay}));
  };
  EXPECT_EQ(digest("to_slave.delay_ms=0"), digest("to_slave.delay_ms=200"));
  const auto with_gripper = [](const char* delay) {
    return scene_digest(scene_of(kWithGripper, {"control.passivity.method=INTERNAL_MODEL", delay}));
  };
  EXPECT_EQ(with_gripper("to_slave.delay_ms=0"), with_gripper("to_slave.delay_ms=200"));
}

}  // namespace
}  // namespace twoport::test::digest_test
