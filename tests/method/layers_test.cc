// Transparency and passivity layers: every pair runs, names of methods are names of pairs, what makes no sense is refused, and a
// transparency layer in a shared library that fails releases the port.

#include "common/method/layers.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/hardware/transparency_host.h"
#include "common/method/catalogue.h"
#include "common/record/summary.h"
#include "common/runtime/cycle.h"
#include "common/scene/load.h"
#include "lab/engine/simulation.h"
#include "lab/run.h"
#include "tests/support/two_sides.h"

namespace twoport::layers_test {
namespace {

void at_size(int dof, const auto& visit) {
  if (dof == 1) visit.template operator()<1>();
  if (dof == 3) visit.template operator()<3>();
  if (dof == 6) visit.template operator()<6>();
  if (dof == kJointPort) visit.template operator()<kJointPort>();
}

constexpr const char* kLayer = TWOPORT_TEST_LAYER;

/// Of the leader's joints [N m s/rad].
constexpr double kJointDamping = 0.5;

/// The same with two arms, joint by joint.
std::string pressed_by_arms(const std::string& control) {
  const std::string arm = fmt::format(
      "arm {{ file: \"panda\" joint_position_rad: [0, -0.5, 0, -2.2, 0, 1.8, 0.785] joint_damping_n_m_s_per_rad: {} }}",
      kJointDamping);
  return fmt::format(
      "space: JOINTS duration_s: 0.6 rate_hz: 1000 seed: 3 operator {{ hand {{ mass_kg: 0.05 stiffness_n_per_m: 500 "
      "damping_n_s_per_m: 15 }} path {{ move_to {{ position_m: [0, 0, -0.04] duration_s: 0.3 }} }} }} device {{ {0} }} "
      "control {{ {1} }} to_slave {{ delay_ms: 20 loss: 0.05 }} to_master {{ delay_ms: 20 loss: 0.05 }} robot {{ {0} "
      "force_sensor {{ }} }} environment {{ wall {{ normal: [0, 0, 1] offset_m: -0.01 stiffness_n_per_m: 2000 }} }}",
      arm, control);
}
/// A hand that presses a wall over 20 ms and 5 % each way for 0.6 s.
std::string pressed(int dof, const std::string& control) {
  if (dof == kJointPort) return pressed_by_arms(control);
  const char* zeros = dof == 1 ? "0.01" : "0.01, 0, 0";
  const char* normal = dof == 1 ? "-1" : "-1, 0, 0";
  const std::string inertia = dof == 6 ? " inertia_kg_m2: 1e-4" : "";
  return fmt::format(
      "dof: {} duration_s: 0.6 rate_hz: 1000 seed: 3 operator {{ hand {{ mass_kg: 0.02 stiffness_n_per_m: 300 "
      "damping_n_s_per_m: 1 }} path {{ move_to {{ position_m: [{}] duration_s: 0.3 }} }} }} device {{ mass_kg: 0.1 "
      "damping_n_s_per_m: 0.1 max_force_n: 20{} }} control {{ {} }} to_slave {{ delay_ms: 20 loss: 0.05 }} to_master "
      "{{ "
      "delay_ms: 20 loss: 0.05 }} robot {{ mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor {{ }}{} }} environment {{ "
      "wall {{ "
      "normal: [{}] offset_m: -0.002 stiffness_n_per_m: 2000 }} }}",
      dof, zeros, inertia, control, dof == 6 ? " inertia_kg_m2: [1e-3, 1e-3, 1e-3]" : "", normal);
}
std::string layers(std::string_view transparency, std::string_view passivity, const std::string& more = {}) {
  return fmt::format("transparency {{ layer: {} {} }} passivity {{ layer: {} }}", transparency, more, passivity);
}
const std::string kPlugin = fmt::format("plugin {{ file: \"{}\" arguments: \"spring 200\" }}", kLayer);

struct Felt {
  double hand_least_j = 0.0, with_damping_least_j = 0.0, damped_j = 0.0, largest_n = 0.0, last_n = 0.0;
  bool finite = true;
  std::vector<double> numbers;  ///< every force and every velocity of the robot
};
template <int N>
Felt run(const Scene& scene) {
  const auto loop = lab::make_simulation<N>(scene);
  Felt out;
  loop->run([&](const Row<N>& row) {
    out.finite = out.finite && all_finite(row.master_f, row.slave_f);
    out.last_n = std::sqrt(row.master_f.squared_norm());
    out.largest_n = std::max(out.largest_n, out.last_n);
    out.hand_least_j = std::min(out.hand_least_j, row.master_energy_j);
    if constexpr (N == kJointPort) out.damped_j += 1e-3 * kJointDamping * row.master_v.squared_norm();
    out.with_damping_least_j = std::min(out.with_damping_least_j, row.master_energy_j + out.damped_j);
    for (int i = 0; i < N; ++i) out.numbers.insert(out.numbers.end(), {row.master_f[i], row.slave_v[i]});
    return out.finite;
  });
  return out;
}
Felt run_scene(const std::string& text) {
  const Scene scene = parse_scene(text, "layers");
  Felt out;
  at_size(scene.dof, [&]<int N>() { out = run<N>(scene); });
  return out;
}

struct EachPair {
  int dof;
  std::string transparency, passivity;
};
class EveryPair : public testing::TestWithParam<EachPair> {};
std::vector<EachPair> pairs() {
  std::vector<EachPair> all;
  for (const int dof : {1, 3, 6, kJointPort})
    for (const TransparencyLayerName& t : kTransparencyLayers)
      for (const PassivityLayerName& p : kPassivityLayers)
        if (dof != kJointPort || !t.is_external) all.push_back({dof, std::string{t.name}, std::string{p.name}});
  return all;
}
// 2e-4 J: E(0) is 1 mJ or by the rule, and a jerk within a tick may cost some of it beyond the bound (docs: the energy bound).
TEST_P(EveryPair, RunsAndKeepsTheClaimOfItsPassivityLayer) {
  const EachPair& c = GetParam();
  const Scene scene = parse_scene(
      pressed(c.dof, layers(c.transparency, c.passivity, c.transparency == "PLUGIN" ? kPlugin : "")), "pair");
  EXPECT_EQ(scene.control.transparency, c.transparency);
  EXPECT_EQ(scene.control.passivity, c.passivity);
  Felt felt;
  at_size(c.dof, [&]<int N>() { felt = run<N>(scene); });
  EXPECT_TRUE(felt.finite);
  const Claim& claim = *find_name(kPassivityLayers, c.passivity)->claim;
  if (!claim.any()) return;
  EXPECT_GE(claim.device_damping ? felt.with_damping_least_j : felt.hand_least_j,
            -2.0 * scene.control.initial_energy.si() - 2e-4);
  // Before the contact the surface model displays nothing, so the hand pays nothing, and E(0) does not move an arm to the wall.
  const bool waits = c.dof == kJointPort && c.transparency == "SURFACE_MODEL" && c.passivity == "FORCE_PROJECTED";
  if (c.passivity != "ENERGY_BOUNDING" && !waits) {
    EXPECT_GT(felt.largest_n, 0.05) << "passive by silence";
  }
}
INSTANTIATE_TEST_SUITE_P(Of, EveryPair, testing::ValuesIn(pairs()), [](const auto& each) {
  return each.param.transparency + "_" + each.param.passivity + "_dof" + std::to_string(each.param.dof);
});

// The master stands still for 1.5 s in contact, as a program that is stopped: what a layer displayed before is old, so its force begins at
// zero when it is coupled again.
TEST(Layers, DisplayNothingAfterAPauseUntilTheMasterIsCoupledAnew) {
  for (const TransparencyLayerName& t : kTransparencyLayers) {
    SCOPED_TRACE(t.name);
    const Scene scene = parse_scene(pressed(1, layers(t.name, "NONE", t.name == "PLUGIN" ? kPlugin : "")), "pause");
    test::TwoSides<1> sides{scene};
    int k = 0;
    double before_n = 0.0;
    for (; k < 600; ++k) {
      sides.slave_tick(tick_time(k, 1000.0));
      before_n = std::max(before_n, std::abs(sides.master_tick(tick_time(k, 1000.0)).command[0]));
    }
    ASSERT_GT(before_n, 0.2);
    Seconds ended{1.5};
    for (k += 1500; k < 2500; ++k) {
      const Tick<MasterClock> tick{Instant<MasterClock>{tick_time(k, 1000.0)}, Seconds{1e-3}, ended};
      const auto out = run_cycle(sides.master, sides.device, sides.master_mail, tick);
      sides.slave_tick(tick_time(k, 1000.0));
      ended = tick.dt;
      if (out.mode != Mode::coupled) {
        EXPECT_EQ(out.command[0], 0.0) << "at tick " << k;
      } else {
        EXPECT_LT(std::abs(out.command[0]), 0.2) << "at once";
        break;
      }
    }
    EXPECT_LT(k, 2500) << "never coupled again";
  }
}

TEST(Layers, ANameOfAMethodIsThatOfItsPair) {
  for (const MethodName& method : kMethods) {
    if (method.one_piece()) continue;
    for (const int dof : {1, 6}) {
      const Felt named = run_scene(pressed(dof, fmt::format("passivity {{ method: {} }}", method.name)));
      const Felt paired = run_scene(pressed(dof, layers(method.transparency, method.passivity)));
      EXPECT_EQ(named.numbers, paired.numbers) << method.name;
      ControlOptions o;
      EXPECT_TRUE(choose_method(o, fmt::format("{}+{}", method.transparency, method.passivity)));
      EXPECT_EQ(o.method_name, method.name);
    }
  }
}
TEST(Layers, AnAbsentLayerIsThatOfTheDefault) {
  const Scene one = parse_scene(pressed(3, "passivity { layer: ENERGY_TANK }"), "one");
  EXPECT_EQ(one.control.transparency, "INTERNAL_MODEL");
  EXPECT_EQ(one.control.method_name, "INTERNAL_MODEL+ENERGY_TANK");
  const Scene other = parse_scene(pressed(3, "transparency { layer: DELAYED_FORCE }"), "other");
  EXPECT_EQ(other.control.passivity, "ENERGY_SPRING");
}

/// The words with which a scene is refused.
std::string refusal(const std::string& text, const std::vector<std::string>& set = {}) {
  try {
    parse_scene(text, "s", set);
    return "accepted";
  } catch (const ConfigError& e) {
    return e.what();
  }
}
TEST(Layers, WhatMakesNoSenseIsRefused) {
  EXPECT_EQ(
      refusal(pressed(3, "transparency { layer: RANDOM } passivity { method: NONE }")),
      "s: control.passivity.method and control.transparency.layer are both given; a method names both layers, so give "
      "the one or the other");
  EXPECT_EQ(
      refusal(pressed(3, "passivity { method: NONE layer: NONE }")),
      "s: control.passivity.method and control.passivity.layer are both given; a method names both layers, so give the "
      "one or the other");
  EXPECT_EQ(refusal(pressed(3, "architecture: RENDER passivity { layer: CLASSIC }")).substr(0, 96),
            "s: control.passivity.layer is given, but control.architecture is RENDER; layers need a link");
  EXPECT_EQ(refusal(pressed(3, "transparency { layer: PLUGIN }")),
            "s: control.transparency.plugin.file is absent; PLUGIN needs it");
  EXPECT_NE(refusal(pressed(3, "architecture: POSITION_MEASURED_FORCE " + layers("FIXED_DAMPING", "CLASSIC"))),
            "accepted");
  EXPECT_NE(refusal(pressed(3, "passivity { layer: WAVE_VARIABLES }")), "accepted");
}
TEST(Layers, TheArchitectureFourChannelNamesItsLayer) {
  const auto named = [](const std::string& more) {
    const ControlOptions c = parse_scene(pressed(3, "architecture: FOUR_CHANNEL " + more), "s").control;
    EXPECT_EQ(c.architecture, Architecture::position_force);
    return c.method_name;
  };
  EXPECT_EQ(named(""), "FOUR_CHANNEL+ENERGY_SPRING");
  EXPECT_EQ(named("passivity { method: NONE }"), "FOUR_CHANNEL");
  EXPECT_EQ(named("passivity { method: FOUR_CHANNEL }"), "FOUR_CHANNEL");
  EXPECT_EQ(named("passivity { method: FORCE_PROJECTED }"), "FOUR_CHANNEL+FORCE_PROJECTED");
  EXPECT_EQ(named(layers("FOUR_CHANNEL", "ENERGY_TANK")), "FOUR_CHANNEL+ENERGY_TANK");
  EXPECT_NE(refusal(pressed(3, "architecture: FOUR_CHANNEL passivity { method: WAVE_VARIABLES }"))
                .find("control.passivity.method"),
            std::string::npos);
  EXPECT_NE(refusal(pressed(3, "architecture: FOUR_CHANNEL transparency { layer: RANDOM }"))
                .find("control.transparency.layer"),
            std::string::npos);
}
TEST(Layers, AnOverrideTakesThePlaceOfWhatTheSceneNames) {
  const std::string by_method = pressed(3, "passivity { method: CLASSIC }"),
                    by_layers = pressed(3, layers("RANDOM", "ENERGY_TANK"));
  EXPECT_EQ(
      parse_scene(by_method, "s", std::vector<std::string>{"control.passivity.layer=ENERGY_TANK"}).control.method_name,
      "INTERNAL_MODEL+ENERGY_TANK");
  EXPECT_EQ(parse_scene(by_layers, "s", std::vector<std::string>{"control.passivity.method=NONE"}).control.method_name,
            "NONE");
  EXPECT_NE(refusal(by_method, {"control.passivity.method=NONE", "control.passivity.layer=NONE"}), "accepted");
}

// ---- shared libraries

std::string plugin_scene(const std::string& arguments) {
  return pressed(3, layers("PLUGIN", "ENERGY_SPRING",
                           fmt::format("plugin {{ file: \"{}\" arguments: \"{}\" }}", kLayer, arguments)));
}
TEST(PluginLayer, DisplaysItsForce) {
  EXPECT_GT(run_scene(plugin_scene("spring 200")).last_n, 0.5);
}
TEST(PluginLayer, FileIsRelativeToTheScene) {
  const std::string scene = pressed(3, layers("PLUGIN", "ENERGY_SPRING", "plugin { file: \"layer.so\" }"));
  EXPECT_EQ(parse_scene(scene, "some/where/s").control.plugin.file, "some/where/layer.so");
  EXPECT_EQ(parse_scene(plugin_scene("spring 200"), "some/where/s").control.plugin.file, kLayer);
}
TEST(PluginLayer, ThatCrashesHangsOrIsNotFiniteReleasesThePort) {
  for (const char* kind : {"crash 0.4", "nan 0.4", "hang 0.4"}) {
    const Felt felt = run_scene(plugin_scene(kind));
    EXPECT_TRUE(felt.finite) << kind;
    EXPECT_GT(felt.largest_n, 0.2) << kind;
    EXPECT_EQ(felt.last_n, 0.0) << kind;
    const Summary s = lab::run(parse_scene(plugin_scene(kind), "layers"));
    EXPECT_EQ(s.verdict_kind(), "UNDECIDED") << kind;
    EXPECT_EQ(violations({}, s).size(), 1U) << "a scene that expects nothing does not expect this";
    EXPECT_EQ(s.verdict(), "undecided: a plug-in or a reading failed at 0.40 s, after which there was no force")
        << kind;
  }
}
TEST(PluginLayer, IsRefusedInWordsWhereItCannotRun) {
  const auto open = [](const std::string& file, const std::string& arguments) -> std::string {
    try {
      start_transparency_process(file, arguments, 3, Seconds{1e-3}, true);
      return "accepted";
    } catch (const ConfigError& e) {
      return e.what();
    }
  };
  EXPECT_NE(open("/no/such.so", "").find("there is no such file"), std::string::npos);
  EXPECT_NE(open("/etc/passwd", "").find("cannot be loaded"), std::string::npos);
  EXPECT_NE(open(kLayer, "no").find("open() returns nothing"), std::string::npos);
  EXPECT_EQ(open(kLayer, "spring 1"), "accepted");
}

}  // namespace
}  // namespace twoport::layers_test
