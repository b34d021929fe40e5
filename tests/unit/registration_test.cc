#include "common/coupling/registration.h"

#include <gtest/gtest.h>

namespace twoport::registration_test {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

const Quaterniond kTurn{AngleAxisd{0.7, Vector3d{1, -2, 0.5}.normalized()}};

ControlOptions options(bool absolute) {
  ControlOptions o;
  o.force_scale = 2.0, o.motion_scale = 0.5;
  o.registration = {.absolute = absolute, .rotation = kTurn, .position_m = {0.1, -0.2, 0.3}};
  return o;
}
const Position<6> kMaster{Vector3d{0.01, 0.02, -0.03}, Quaterniond{AngleAxisd{0.4, Vector3d::UnitY()}}};
const Position<6> kRobot{Vector3d{0.3, 0.1, 0.2}, Quaterniond{AngleAxisd{-1.1, Vector3d{1, 1, 0}.normalized()}}};

template <int N>
double apart(const Position<N>& a, const Position<N>& b) {
  return std::sqrt((a - b).squared_norm());
}

// 1e-15: rounding of a quaternion product and a matrix.
TEST(Registration, PutsTheRobotWhereItIsAtEngagement) {
  Registration<6> six{options(false)};
  six.engage(kMaster, kRobot);
  EXPECT_LT(apart(six.to_slave(kMaster), kRobot), 1e-15);
  EXPECT_LT(apart(six.to_master(kRobot), kMaster), 1e-15);
  Registration<3> three{options(false)};
  three.engage(Position<3>{kMaster.translation()}, Position<3>{kRobot.translation()});
  EXPECT_LT(apart(three.to_slave(Position<3>{kMaster.translation()}), Position<3>{kRobot.translation()}), 1e-15);
}

// A small motion of the master is turned, scaled, and carries the attitude along; so power scales by s_f s_x, as energies do.
TEST(Registration, TurnsMotionAndForceSoThatPowerIsKept) {
  Registration<6> r{options(false)};
  r.engage(kMaster, kRobot);
  Velocity<6>::Vector twist;
  twist << 0.1, -0.3, 0.2, 1.0, 0.5, -2.0;
  const double dt = 1e-6;
  const Position<6> moved = kMaster + Velocity<6>{twist} * Seconds{dt};
  const Velocity<6> seen = (r.to_slave(moved) - r.to_slave(kMaster)) / Seconds{dt};
  // 1e-8: rounding of 1e-16 m over a microsecond, and the second order of the rotation.
  EXPECT_LT((seen.vec() - r.to_slave(Velocity<6>{twist}).vec()).norm(), 1e-8);
  Force<6>::Vector wrench;
  wrench << 1, 2, -3, 0.1, 0.2, 0.3;
  const Power at_slave = dot(Force<6>{wrench}, r.to_slave(Velocity<6>{twist}));
  const Power at_master = dot(r.to_master(Force<6>{wrench}), Velocity<6>{twist});
  EXPECT_NEAR(at_master.si(), r.to_master(Energy{at_slave.si()}).si(), 1e-14);
  EXPECT_LT((r.to_master(r.to_slave(Velocity<6>{twist})).vec() - twist).norm(), 1e-15);
}

// Forces, energies and waves that arrive scale with the same power.
TEST(Registration, TranslatesWhatTheOtherSideSays) {
  Registration<6> r{options(false)};
  r.engage(kMaster, kRobot);
  PortReport<6> slave;
  slave.v = Velocity<6>{Velocity<6>::Vector{0.1, -0.3, 0.2, 1.0, 0.5, -2.0}};
  slave.f = Force<6>{Force<6>::Vector{1, 2, -3, 0.1, 0.2, 0.3}};
  slave.f_coupling = 2.0 * slave.f, slave.f_environment = 3.0 * slave.f;
  slave.energy_in_j = 0.3, slave.energy_net_j = -0.2;
  const PortReport<6> there = r.to_master(slave);
  constexpr double kScale = 2.0 / 0.5;  // s_f / s_x
  EXPECT_NEAR(dot(there.f, there.v).si(), kScale * dot(slave.f, slave.v).si(), 1e-14);
  EXPECT_NEAR(dot(there.f_coupling, there.v).si(), 2.0 * dot(there.f, there.v).si(), 1e-14);
  EXPECT_NEAR(dot(there.f_environment, there.v).si(), 3.0 * dot(there.f, there.v).si(), 1e-14);
  EXPECT_NEAR(there.energy_in_j, kScale * slave.energy_in_j, 1e-15);
  EXPECT_NEAR(there.energy_net_j, kScale * slave.energy_net_j, 1e-15);
  PortReport<6> master = there;
  master.x = kMaster;
  const PortReport<6> back = r.to_slave(master);
  EXPECT_LT(apart(back.x, kRobot), 1e-15);
  EXPECT_LT((back.v.vec() - slave.v.vec()).norm() + (back.f.vec() - slave.f.vec()).norm(), 1e-14);
  EXPECT_NEAR(back.energy_in_j, slave.energy_in_j, 1e-15);
  const Velocity<6> wave = r.wave_to_master(slave.v);
  EXPECT_NEAR(wave.squared_norm(), kScale * slave.v.squared_norm(), 1e-14);
  EXPECT_LT((r.wave_to_slave(wave).vec() - slave.v.vec()).norm(), 1e-14);
}

TEST(Registration, IsTheScenesWhereItIsAbsolute) {
  Registration<3> r{options(true)};
  const Vector3d p{0.04, 0.02, 0.06};
  r.engage(Position<3>{p}, Position<3>{Vector3d{9, 9, 9}});  // changes nothing
  const Vector3d expected = 0.5 * (kTurn * p) + Vector3d{0.1, -0.2, 0.3};
  EXPECT_LT((r.to_slave(Position<3>{p}).translation() - expected).norm(), 1e-15);
  EXPECT_LT((r.to_master(r.to_slave(Position<3>{p})).translation() - p).norm(), 1e-15);
}

// Nothing to register: not a bit is changed.
TEST(Registration, OfSidesThatStartTogetherChangesNoBit) {
  ControlOptions o;
  Registration<6> r{o};
  r.engage(kMaster, kMaster);
  const Position<6> x = kMaster + Displacement<6>{Displacement<6>::Vector::Constant(0.123)};
  EXPECT_EQ(r.to_slave(x).translation(), x.translation());
  EXPECT_EQ(r.to_slave(x).attitude().coeffs(), x.attitude().coeffs());
}

}  // namespace
}  // namespace twoport::registration_test
