#include "common/method/render/render.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "tests/support/no_alloc.h"

namespace twoport::render_test {
namespace {

using Eigen::Vector3d;
using Things = std::vector<EnvironmentSpec>;

constexpr Seconds kPeriod{1e-3};

ControlOptions options(Accounts accounts) {
  ControlOptions o;
  o.architecture = Architecture::render;
  o.controller = {.method = Method::force_projected};
  o.accounts = accounts;
  o.reference_energy = true;
  o.initial_energy = Energy{};  // shared by all accounts, touched or not
  return o;
}

const Material kRough{3000, 5, 0.3, 1};
const EnvironmentSpec kLeft = Surface{Wall{{-1, 0, 0}, -0.002}, kRough};
const EnvironmentSpec kRound = Surface{Sphere{{0.004, 0.004, 0}, 0.006}, kRough};
const EnvironmentSpec kFarAway = Surface{Wall{{0, 0, 1}, -10}, kRough};

/// Commands while the port goes around both things, fast enough for the controllers to act.
std::vector<Vector3d> commands(const Environment<3>& environment, Accounts accounts, double& dissipated) {
  Rendering<3> rendering{options(accounts), environment};
  std::vector<Vector3d> all;
  Force<3> applied;
  Vector3d before = Vector3d::Zero();
  for (int k = 0; k < 2000; ++k) {
    const double t = 0.001 * k;
    const Vector3d x{0.006 * std::sin(70 * t), 0.004 * std::sin(40 * t), 0.002 * std::sin(25 * t)};
    const auto out =
        rendering.step({Position<3>{x}, Velocity<3>{(x - before) / kPeriod.si()}}, applied, kPeriod, kPeriod);
    before = x;
    applied = out.command;
    dissipated += out.dissipated.si();
    all.push_back(out.command.vec());
  }
  return all;
}

TEST(Rendering, KeepsAnAccountForEveryContactHoweverManyThereAre) {
  // What is never touched changes nothing: things that share an account would.
  Things many = {kLeft};
  many.insert(many.end(), 30, kFarAway);
  many.insert(many.begin() + 16, kRound);
  double dissipated = 0.0, dissipated_of_many = 0.0;
  const auto two = commands(Environment<3>{{kLeft, kRound}}, Accounts::per_contact, dissipated),
             all = commands(Environment<3>{many}, Accounts::per_contact, dissipated_of_many);
  ASSERT_EQ(two.size(), all.size());
  for (std::size_t k = 0; k < two.size(); ++k) ASSERT_EQ(two[k], all[k]) << "tick " << k;
  EXPECT_EQ(dissipated, dissipated_of_many);
  EXPECT_GT(dissipated, 1e-4);  // the controllers act: 2.5e-4 J of up to 2e-3 J stored
}

TEST(Rendering, OfManyContactsAllocatesWhenItIsBuiltAndNeverAgain) {
  std::vector<Vector3d> tool;
  for (int i = 0; i < 48; ++i) tool.push_back({0.03 * std::cos(0.3 * i), 0.03 * std::sin(0.3 * i), 0.001 * i});
  Rendering<6> rendering{options(Accounts::per_contact), Environment<6>{{kLeft, kRound}, tool}};
  Force<6> applied;
  const NoAlloc guard;
  for (int k = 0; k < 100; ++k) {
    const Position<6> x{Vector3d{0.01 * std::sin(0.1 * k), 0, 0}, rotation(Vector3d{0, 0.01 * k, 0})};
    applied = rendering.step({x, Velocity<6>{}}, applied, kPeriod, kPeriod).command;
  }
  EXPECT_EQ(guard.seen(), 0);
}

TEST(Rendering, HoldsNothingAfterARelease) {
  Rendering<3> rendering{options(Accounts::total), Environment<3>{{kLeft}}};
  const PortMotion<3> inside{Position<3>{Vector3d{0.005, 0, 0}}, Velocity<3>{}};
  EXPECT_GT(rendering.step(inside, {}, kPeriod, kPeriod).command.vec().norm(), 1.0);
  rendering.release();
  // What moves while nothing is held puts no energy in.
  const Energy before = rendering.observed();
  rendering.step({Position<3>{Vector3d{0.009, 0, 0}}, Velocity<3>{}}, {}, kPeriod, kPeriod);
  EXPECT_EQ(rendering.observed(), before);
}

// The classic controller dissipates along the motion, wherever the contact is by then.
TEST(Rendering, AnOpenContactPaysWhatItOwes) {
  ControlOptions o = options(Accounts::per_contact);
  o.controller.method = Method::classic;
  o.reference_energy = false;
  Rendering<3> rendering{o, Environment<3>{{kLeft}}};
  const auto step = [&](double x_m, double v_m_per_s, const Force<3>& applied) {
    const PortMotion<3> port{Position<3>{Vector3d{x_m, 0, 0}}, Velocity<3>{Vector3d{v_m_per_s, 0, 0}}};
    return rendering.step(port, applied, kPeriod, kPeriod);
  };
  step(0.0, 0.0, {});
  const Force<3> pressed = step(0.005, 0.0, {}).command;  // not paid for: nothing was held on the way in
  const auto left = step(0.0, -1.0, pressed);
  EXPECT_EQ(left.wanted.vec(), Vector3d::Zero());
  EXPECT_LT(left.command.vec().x(), 0.0);
  EXPECT_GT(left.dissipated.si(), 0.0);
}

}  // namespace
}  // namespace twoport::render_test
