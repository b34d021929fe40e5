// The scenes of docs/reference/shapes.md, without a program around them.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "common/method/render/render.h"
#include "common/scene/load.h"
#include "sim/sim_device.h"

namespace twoport::rendered_parts_test {
namespace {

struct Outcome {
  double least_energy_j = 0.0, most_force_n = 0.0, most_torque_n_m = 0.0, worst_turn = 0.0;
  bool finite = true;
};

template <int N>
Outcome run(const std::string& name) {
  const Scene scene = load_scene(std::string{TWOPORT_SCENES} + "/" + name + ".textproto");
  const Seconds dt{1.0 / scene.master_rate_hz};
  sim::SimDevice<N> device{scene, dt};
  Rendering<N> rendering{scene.control, Environment<N>{scene.environment, scene.tool}};
  Outcome r;
  const int ticks = static_cast<int>(scene.duration_s * scene.master_rate_hz);
  for (int i = 0; i < ticks; ++i) {
    if (i > 0) device.advance();
    const auto at = device.sense();
    const auto out = rendering.step({at.x, at.v}, at.applied, dt, dt);
    Force<N> command = out.command;
    const double force = command.vec().template head<kAxes<N>>().norm();
    if (const double most = *scene.device->max_force_n; force > most)
      command = Force<N>{command.vec() * (most / force)};  // as a device does
    device.actuate(command);
    const double size = out.wanted.vec().norm() * out.command.vec().norm();
    if (size > 0.05 * 0.05) r.worst_turn = std::max(r.worst_turn, 1.0 - out.wanted.vec().dot(out.command.vec()) / size);
    r.least_energy_j = std::min(r.least_energy_j, device.port_energy().si());
    r.most_force_n = std::max(r.most_force_n, command.vec().template head<kAxes<N>>().norm());
    if constexpr (N == 6) r.most_torque_n_m = std::max(r.most_torque_n_m, command.vec().template tail<3>().norm());
    r.finite = r.finite && all_finite(device.x(), device.v());
  }
  std::printf("%s: least port energy %.3g J, largest force %.3g N, torque %.3g N m, 1 - cos of the turn %.3g\n",
              name.c_str(), r.least_energy_j, r.most_force_n, r.most_torque_n_m, r.worst_turn);
  return r;
}

TEST(RenderedParts, AMeshIsPressedPassively) {
  const Outcome r = run<3>("render_torus_mesh");
  EXPECT_TRUE(r.finite);
  EXPECT_GT(r.most_force_n, 0.5);
  EXPECT_GT(r.least_energy_j, -1e-6);
  EXPECT_LT(r.worst_turn, 1e-14);
}
TEST(RenderedParts, APegIsTiltedInItsHolePassively) {
  // Both ends of the peg touch: forces of opposite sign, whose sum is small and whose torque holds against the hand.
  const Outcome r = run<6>("render_peg_in_hole");
  EXPECT_TRUE(r.finite);
  EXPECT_GT(r.most_torque_n_m, 0.01);
  EXPECT_GT(r.least_energy_j, -1e-5);
}
TEST(RenderedParts, AGodObjectIsPassiveAndKeepsItsDirection) {
  const Outcome r = run<6>("render_god_object_box");
  EXPECT_TRUE(r.finite);
  EXPECT_GT(r.most_force_n, 0.5);
  EXPECT_GT(r.least_energy_j, -1e-5);
  EXPECT_LT(r.worst_turn, 1e-14);
}

}  // namespace
}  // namespace twoport::rendered_parts_test
