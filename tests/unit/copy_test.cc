// A simulated world can be copied while it runs: both go on identically, and neither touches the other.

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "common/scene/load.h"
#include "sim/sim_device.h"
#include "sim/sim_robot.h"

namespace twoport::sim::copy_test {
namespace {

constexpr Seconds kPeriod{5e-4};

template <int N>
Force<N> push(int k) {
  typename Force<N>::Vector f = Force<N>::Vector::Zero();
  for (int i = 0; i < N; ++i) f[i] = (i < 3 ? 2.0 : 0.02) * ((k * (i + 3)) % 7 - 3);
  return Force<N>{f};
}

/// Everything a device shows, as numbers.
template <int N>
std::vector<double> shown(const SimDevice<N>& d) {
  std::vector<double> all;
  const auto add = [&](const auto& v) { all.insert(all.end(), v.data(), v.data() + v.size()); };
  const DeviceSample<N> s = d.sense();
  add(coordinates(s.x)), add(s.v.vec()), add(s.applied.vec()), add(coordinates(d.x())), add(d.v().vec());
  all.push_back(d.port_energy().si());
  return all;
}
template <int N>
std::vector<double> shown(const SimRobot<N>& r) {
  std::vector<double> all;
  const auto add = [&](const auto& v) { all.insert(all.end(), v.data(), v.data() + v.size()); };
  const RobotSample<N> s = r.sense();
  add(coordinates(s.x)), add(s.v.vec()), add(s.f_environment.vec()), add(r.environment_force().vec());
  return all;
}
template <int N>
void step(SimDevice<N>& d, int k) {
  d.actuate(push<N>(k));
  d.advance();
}
template <int N>
void step(SimRobot<N>& r, int k) {
  r.actuate({.f = push<N>(k), .x_d = Position<N>{}, .v_d = {}});
  r.advance();
}

/// Runs, copies, runs original and copy in turns; then assigns back and repeats what the copy did.
template <class Model>
void expect_copies_go_on(Model model) {
  for (int k = 0; k < 150; ++k) step(model, k);
  Model copy = model;
  const Model kept = model;
  std::vector<std::vector<double>> of_model, of_copy;
  for (int k = 150; k < 300; ++k) step(model, k), of_model.push_back(shown(model));
  for (int k = 150; k < 300; ++k) step(copy, k), of_copy.push_back(shown(copy));
  EXPECT_EQ(of_model, of_copy);
  EXPECT_NE(of_model.front(), of_model.back());
  model = kept;
  of_model.clear();
  for (int k = 150; k < 300; ++k) step(model, k), of_model.push_back(shown(model));
  EXPECT_EQ(of_model, of_copy);
}

Scene scene(int dof, const std::string& blocks, const std::string& integrator = "EXACT") {
  return parse_scene(
      "dof: " + std::to_string(dof) + " duration_s: 1 seed: 3 simulation { integrator: " + integrator + " } " + blocks,
      "test");
}

const std::string kHand =
    "operator { hand { mass_kg: 0.02 stiffness_n_per_m: 300 damping_n_s_per_m: 1 } tremor { rms_m: 1e-4 } path { sine "
    "{ "
    "amplitude_m: 0.01 frequency_hz: 3 duration_s: 0.1 } } path { move_to { position_m: 0.02 duration_s: 0.1 } } } ";
const std::string kDevice =
    "device { mass_kg: 0.075 coulomb_friction_n: 0.3 position_resolution_m: 3e-5 velocity_estimate: FILTERED "
    "max_force_n: 4 } ";
const std::string kSensor = "force_sensor { noise_n: 0.01 latency_ms: 3 } } ";

TEST(CopyOfADevice, GoesOnIdentically) {
  for (const char* integrator : {"EXACT", "SYMPLECTIC_EULER", "TRAPEZOIDAL", "RK4"})
    expect_copies_go_on(SimDevice<1>{scene(1, kHand + kDevice, integrator), kPeriod});
  expect_copies_go_on(SimDevice<3>{
      scene(3, "operator { path { sine { amplitude_m: 0.01 frequency_hz: 3 duration_s: 1 } } } " + kDevice), kPeriod});
  expect_copies_go_on(SimDevice<6>{
      scene(6,
            "operator { hand { mass_kg: 0.02 inertia_kg_m2: 1e-5 stiffness_n_per_m: 300 "
            "rotational_stiffness_n_m_per_rad: 1 } path { screw { axis: [0, 1, 2] angle_rad: 0.5 frequency_hz: 3 "
            "duration_s: 1 } } } device { mass_kg: 0.075 inertia_kg_m2: 1e-4 }"),
      kPeriod});
}

TEST(CopyOfARobot, OnAnExactMapGoesOnIdentically) {
  const std::string world =
      "robot { mass_kg: 0.1 position_m: 0.001 velocity_m_per_s: -0.3 " + kSensor +
      "environment { wall { normal: 1 stiffness_n_per_m: 5000 damping_n_s_per_m: 2 } } environment { spring { "
      "stiffness_n_per_m: 300 damping_n_s_per_m: 1 } }";
  for (const char* integrator : {"EXACT", "EXACT_PER_TICK", "TRAPEZOIDAL"})
    expect_copies_go_on(SimRobot<1>{scene(1, world, integrator), kPeriod});
  expect_copies_go_on(SimRobot<3>{
      scene(3, "robot { mass_kg: 0.1 position_m: [0, 0, 0.001] velocity_m_per_s: [0.1, 0, -0.3] " + kSensor +
                   "environment { wall { normal: [1, 2, 2] stiffness_n_per_m: 5000 viscous_friction_n_s_per_m: 1 } }"),
      kPeriod});
}

const std::string kCurved =
    "robot { mass_kg: 0.2 position_m: [0.0585, 0, 0] velocity_m_per_s: [-0.1, 0.3, 0.2] " + kSensor +
    "environment { spring { stiffness_n_per_m: 100 } } environment { sphere { radius_m: 0.06 stiffness_n_per_m: 4000 "
    "damping_n_s_per_m: 1 friction: 0.2 } } environment { box { center_m: [0, 0.05, 0] half_size_m: [0.03, 0.03, 0.03] "
    "stiffness_n_per_m: 3000 } }";
const std::string kBody =
    "robot { mass_kg: 0.5 inertia_kg_m2: [1e-3, 2e-3, 2.5e-3] position_m: [0, 0, 0.02] velocity_m_per_s: [0.1, 0, "
    "-0.3, 1, "
    "2, 3] " +
    kSensor +
    "environment { wall { normal: [0, 0, 1] stiffness_n_per_m: 2000 damping_n_s_per_m: 5 friction: 0.2 } } environment "
    "{ "
    "spring { stiffness_n_per_m: 50 } } tool { contact_point { position_m: [0.03, 0.02, -0.02] } contact_point { "
    "position_m: [-0.03, 0.01, -0.02] } }";

TEST(CopyOfARobot, StepByStepGoesOnIdentically) {
  for (const char* integrator : {"EXACT", "SYMPLECTIC_EULER", "VELOCITY_VERLET", "RK4", "DORMAND_PRINCE"}) {
    expect_copies_go_on(SimRobot<3>{scene(3, kCurved, integrator), kPeriod});
    expect_copies_go_on(SimRobot<6>{scene(6, kBody, integrator), kPeriod});
  }
}

TEST(StateOfAHandle, IsAllThatGoesOn) {
  const Scene s = scene(3, "operator { hand { mass_kg: 0.02 stiffness_n_per_m: 300 } } " + kDevice);
  const DeviceSpec& device = *s.device;
  const HandSpec& hand = *s.operator_model->hand;
  using Vector = HandlePlant<3>::Vector;
  HandlePlant<3> original{device, hand, {}, kPeriod.si(), {{}, Vector{0.1, 0, 0}}},
      fresh{device, hand, {}, kPeriod.si(), {{}, Vector::Zero()}};
  for (int k = 0; k < 150; ++k) original.advance(push<3>(k).vec(), push<3>(2 * k).vec());
  fresh.set_state(original.state());
  for (int k = 150; k < 300; ++k) {
    original.advance(push<3>(k).vec(), push<3>(2 * k).vec());
    fresh.advance(push<3>(k).vec(), push<3>(2 * k).vec());
    ASSERT_EQ(original.state().x.translation(), fresh.state().x.translation());
    ASSERT_EQ(original.state().v, fresh.state().v);
  }
}

}  // namespace
}  // namespace twoport::sim::copy_test
