#include "sim/plant/integrators.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "common/scene/load.h"
#include "sim/sim_device.h"
#include "sim/sim_robot.h"

namespace twoport::sim::integrators_test {
namespace {

const std::string kSpring = R"(dof: 3 duration_s: 1 rate_hz: 1000 control { architecture: UNCONTROLLED }
  robot { mass_kg: 0.5 damping_n_s_per_m: 3 position_m: [0.01, 0, -0.02] velocity_m_per_s: [0, 0.3, 0] }
  environment { spring { stiffness_n_per_m: 800 damping_n_s_per_m: 2 anchor_m: [0, 0.01, 0] } } )";
const std::string kSphere = R"(dof: 3 duration_s: 1 rate_hz: 1000 control { architecture: UNCONTROLLED }
  robot { mass_kg: 0.5 position_m: [0.099, 0, 0] velocity_m_per_s: [0, 0.05, 0] }
  environment { spring { stiffness_n_per_m: 300 anchor_m: [0, 0, 0] } }
  environment { sphere { radius_m: 0.1 stiffness_n_per_m: 4000 damping_n_s_per_m: 1 viscous_friction_n_s_per_m: 0.5 } } )";
const std::string kBody = R"(dof: 6 duration_s: 1 rate_hz: 1000 control { architecture: UNCONTROLLED }
  robot { mass_kg: 0.5 inertia_kg_m2: [1e-3, 2e-3, 2.5e-3] velocity_m_per_s: [0.1, 0, 0, 3, 5, 1] }
  environment { spring { stiffness_n_per_m: 100 damping_n_s_per_m: 0.5 anchor_m: [0, 0, 0.02] } }
  tool { contact_point { position_m: [0.02, 0, 0.01] } } )";

template <int N>
BodyState<N> end(const std::string& text, const std::string& integrator, int substeps, double duration_s = 0.05) {
  const std::string set[] = {"simulation.integrator=" + integrator, "simulation.substeps=" + std::to_string(substeps)};
  const Scene scene = parse_scene(text, "stepped", set);
  SimRobot<N> robot{scene, Seconds{1e-3}};
  for (int k = 0; k < static_cast<int>(std::lround(duration_s * 1e3)); ++k) robot.advance();
  return robot.state();
}
/// How the error falls when the step is halved: its order.
template <int N>
double order(const std::string& text, const std::string& integrator, int substeps) {
  const BodyState<N> truth = end<N>(text, "RK4", 200);
  const auto error = [&](int n) { return (end<N>(text, integrator, n).x - truth.x).vec().norm(); };
  return std::log2(error(substeps) / error(2 * substeps));
}

TEST(Integrator, HasTheOrderItIsKnownFor) {
  EXPECT_NEAR(order<3>(kSpring, "SYMPLECTIC_EULER", 4), 1.0, 0.05);
  EXPECT_NEAR(order<3>(kSpring, "VELOCITY_VERLET", 4), 2.0, 0.05);
  EXPECT_NEAR(order<3>(kSpring, "TRAPEZOIDAL", 4), 2.0, 0.05);
  EXPECT_NEAR(order<3>(kSpring, "RK4", 1), 4.0, 0.1);
  // In contact throughout, on a curved surface.
  EXPECT_NEAR(order<3>(kSphere, "SYMPLECTIC_EULER", 4), 1.0, 0.05);
  EXPECT_NEAR(order<3>(kSphere, "VELOCITY_VERLET", 4), 2.0, 0.05);
  EXPECT_NEAR(order<3>(kSphere, "RK4", 1), 4.0, 0.2);
  // A body that tumbles.
  EXPECT_NEAR(order<6>(kBody, "SYMPLECTIC_EULER", 4), 1.0, 0.1);
  EXPECT_NEAR(order<6>(kBody, "RK4", 1), 4.0, 0.2);
}

TEST(Integrator, OfALinearMotionIsExactInOneStepOfTheExactMap) {
  const BodyState<3> truth = end<3>(kSpring, "RK4", 300);
  for (const char* exact : {"EXACT", "EXACT_PER_TICK"})
    EXPECT_LT((end<3>(kSpring, exact, 1).x - truth.x).vec().norm(), 1e-14) << exact;
}

TEST(Integrator, OfABodyInTheGeneralCaseIsTheShortStepsOfTheExactOne) {
  // One step a tick suffices it here, a tenth of a radian long: 1.6e-8 m.
  EXPECT_LT((end<3>(kSphere, "EXACT", 1).x - end<3>(kSphere, "RK4", 50).x).vec().norm(), 1e-7);
  EXPECT_LT((end<6>(kBody, "EXACT", 1).x - end<6>(kBody, "RK4", 50).x).vec().norm(), 1e-10);
}

// Force and sensor tell of the state that there is, after every tick.
TEST(Integrator, TellsTheForceWhereTheBodyIs) {
  for (const char* integrator : {"EXACT", "SYMPLECTIC_EULER"}) {
    const std::string set[] = {std::string{"simulation.integrator="} + integrator};
    SimRobot<3> robot{parse_scene(kSphere, "asked", set), Seconds{1e-3}};
    for (int k = 0; k < 50; ++k) {
      const Force<3> now = robot.environment().force(robot.state().x, robot.state().v);
      EXPECT_EQ(robot.environment_force().vec(), now.vec()) << integrator << ", tick " << k;
      EXPECT_EQ(robot.sense().f_environment.vec(), (-now).vec()) << integrator << ", tick " << k;
      robot.advance();
    }
  }
}

// The handle in a hand, on its way: the same four, against its exact map.
TEST(Integrator, StepsTheHandleToo) {
  const auto at = [](const std::string& integrator, int substeps) {
    const std::string set[] = {"simulation.integrator=" + integrator,
                               "simulation.substeps=" + std::to_string(substeps)};
    const Scene scene = parse_scene(
        "dof: 1 duration_s: 1 rate_hz: 1000 operator { hand { mass_kg: 0.05 stiffness_n_per_m: 400 "
        "damping_n_s_per_m: 3 } path { move_to { position_m: 0.03 duration_s: 0.1 } } } device { mass_kg: 0.1 } "
        "control { architecture: RENDER }",
        "handle", set);
    SimDevice<1> device{scene, Seconds{1e-3}};
    device.actuate(Force<1>{Force<1>::Vector{0.5}});
    for (int k = 0; k < 80; ++k) device.advance();
    return device.x().translation()[0];
  };
  const double truth = at("EXACT", 1);
  const auto order = [&](const std::string& i, int n) {
    return std::log2(std::abs((at(i, n) - truth) / (at(i, 2 * n) - truth)));
  };
  EXPECT_NEAR(order("SYMPLECTIC_EULER", 4), 1.0, 0.05);
  EXPECT_NEAR(order("VELOCITY_VERLET", 2), 2.0, 0.05);
  EXPECT_NEAR(order("TRAPEZOIDAL", 2), 2.0, 0.05);
  EXPECT_NEAR(order("RK4", 1), 4.0, 0.2);
  EXPECT_EQ(at("EXACT_PER_TICK", 3), truth);
}

}  // namespace
}  // namespace twoport::sim::integrators_test
