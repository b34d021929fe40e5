// Kinematics and dynamics of a seven-joint arm, own and those of KDL, MuJoCo and DART where they are installed, in one run: time per call.

#include "common/scene/arm.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <memory>

#include "common/arm/arm_model.h"
#include "common/scene/load.h"
#include "sim/plant/arm.h"

#ifdef TWOPORT_KDL
#include <kdl/chaindynparam.hpp>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainidsolver_recursive_newton_euler.hpp>
#include <kdl/chainjnttojacsolver.hpp>

#include "tests/arm/kdl_chain.h"
#endif
#ifdef TWOPORT_MUJOCO
#include <mujoco/mujoco.h>

#include <cstring>

#include "tests/arm/mjcf.h"
#endif
#ifdef TWOPORT_DART
#include <dart/dynamics/BodyNode.hpp>
#include <dart/dynamics/RevoluteJoint.hpp>
#include <dart/dynamics/Skeleton.hpp>
#endif

namespace {

using namespace twoport;
using Arm = ArmModel;
using Joints = Arm::Joints;

const Eigen::Vector3d kGravity{0.0, 0.0, -9.81};

const ArmParameters& parameters() {
  static const ArmParameters arm = load_arm(TWOPORT_ARMS "/fr3.textproto");
  return arm;
}

/// Positions that follow each other, so that nothing is computed once.
struct Walk {
  Joints q = joint_vector(parameters().ready_position), v = Joints::Constant(7, 0.3), a = Joints::Constant(7, 0.7);
  void next() { q[0] += 1e-4, q[3] -= 1e-5, q[5] += 2e-5; }
};

template <class Compute>
void own(benchmark::State& state, Compute compute) {
  const Arm arm{parameters()};
  Walk w;
  for (auto _ : state) {
    w.next();
    auto result = compute(arm, w);
    benchmark::DoNotOptimize(result);
  }
}

const int registered = [] {
  const auto add = [](const char* name, auto compute) {
    benchmark::RegisterBenchmark(name, [compute](benchmark::State& s) { own(s, compute); });
  };
  add("own/forward_kinematics", [](const Arm& m, const Walk& w) { return m.pose(w.q); });
  add("own/jacobian", [](const Arm& m, const Walk& w) { return m.jacobian(m.pose(w.q)); });
  add("own/gravity_torque", [](const Arm& m, const Walk& w) { return m.gravity_torque(m.pose(w.q), kGravity); });
  add("own/inverse_dynamics",
      [](const Arm& m, const Walk& w) { return m.inverse_dynamics(m.pose(w.q), w.v, w.a, kGravity); });
  add("own/inertia_matrix", [](const Arm& m, const Walk& w) { return m.inertia(m.pose(w.q)); });
  add("own/forward_dynamics",
      [](const Arm& m, const Walk& w) { return m.forward_dynamics(m.pose(w.q), w.v, w.a, kGravity); });
  return 0;
}();

/// A tick of the simulated arm at 2 kHz: controller, plant, wrist.
void plant(benchmark::State& state, const char* world) {
  const Scene scene = parse_scene(std::string{"dof: 6 duration_s: 1 robot { arm { file: \"" TWOPORT_ARMS
                                              "/fr3.textproto\" tool_mass_kg: 0.5 } } "} +
                                      world,
                                  "bench");
  const auto environment = std::make_shared<const Environment<6>>(scene.environment, scene.tool);
  sim::ArmPlant arm{*scene.robot->arm, environment, 5e-4, {}};
  int k = 0;
  for (auto _ : state) {
    Force<6>::Vector f = Force<6>::Vector::Zero();
    f[++k % 3] = 1.0;
    benchmark::DoNotOptimize(arm.advance(Force<6>{f}));
  }
}
BENCHMARK_CAPTURE(plant, free, "");
BENCHMARK_CAPTURE(plant, on_a_wall,
                  "environment { wall { normal: [0, 0, 1] offset_m: 0.001 stiffness_n_per_m: 3000 } }");

#ifdef TWOPORT_KDL
struct Kdl {
  KDL::Chain chain = test::kdl_chain(parameters());
  KDL::JntArray q{7}, v{7}, a{7}, tau{7};
  KDL::Wrenches none = KDL::Wrenches(chain.getNrOfSegments(), KDL::Wrench::Zero());
  Kdl() { q.data = Walk{}.q, v.data = Walk{}.v, a.data = Walk{}.a; }
  void next() { q(0) += 1e-4, q(3) -= 1e-5, q(5) += 2e-5; }
};

template <class Compute>
void kdl(benchmark::State& state, Compute compute) {
  Kdl k;
  for (auto _ : state) {
    k.next();
    compute(k);
    benchmark::ClobberMemory();
  }
}

void kdl_forward_kinematics(benchmark::State& state) {
  KDL::Chain chain = test::kdl_chain(parameters());
  KDL::ChainFkSolverPos_recursive solver{chain};
  KDL::Frame out;
  kdl(state, [&](Kdl& k) { solver.JntToCart(k.q, out); });
}
void kdl_jacobian(benchmark::State& state) {
  KDL::Chain chain = test::kdl_chain(parameters());
  KDL::ChainJntToJacSolver solver{chain};
  KDL::Jacobian out{7};
  kdl(state, [&](Kdl& k) { solver.JntToJac(k.q, out); });
}
void kdl_inverse_dynamics(benchmark::State& state) {
  KDL::Chain chain = test::kdl_chain(parameters());
  KDL::ChainIdSolver_RNE solver{chain, test::kdl(kGravity)};
  kdl(state, [&](Kdl& k) { solver.CartToJnt(k.q, k.v, k.a, k.none, k.tau); });
}
void kdl_inertia_matrix(benchmark::State& state) {
  KDL::Chain chain = test::kdl_chain(parameters());
  KDL::ChainDynParam solver{chain, test::kdl(kGravity)};
  KDL::JntSpaceInertiaMatrix out{7};
  kdl(state, [&](Kdl& k) { solver.JntToMass(k.q, out); });
}
BENCHMARK(kdl_forward_kinematics)->Name("kdl/forward_kinematics");
BENCHMARK(kdl_jacobian)->Name("kdl/jacobian");
BENCHMARK(kdl_inverse_dynamics)->Name("kdl/inverse_dynamics");
BENCHMARK(kdl_inertia_matrix)->Name("kdl/inertia_matrix");
#endif

#ifdef TWOPORT_MUJOCO
struct MuJoCo {
  mjModel* model = nullptr;
  mjData* data = nullptr;
  Walk w;
  MuJoCo() {
    const std::string xml = test::mjcf(parameters(), kGravity);
    const auto files = std::make_unique<mjVFS>();
    mj_defaultVFS(files.get());
    mj_makeEmptyFileVFS(files.get(), "arm.xml", static_cast<int>(xml.size()));
    std::memcpy(files->filedata[0], xml.data(), xml.size());
    std::array<char, 500> error{};
    model = mj_loadXML("arm.xml", files.get(), error.data(), static_cast<int>(error.size()));
    mj_deleteVFS(files.get());
    data = mj_makeData(model);
    std::copy(w.v.begin(), w.v.end(), data->qvel);
    std::copy(w.a.begin(), w.a.end(), data->qacc);
  }
  MuJoCo(const MuJoCo&) = delete;
  ~MuJoCo() {
    mj_deleteData(data);
    mj_deleteModel(model);
  }
};

template <class Compute>
void mujoco(benchmark::State& state, Compute compute) {
  MuJoCo m;
  for (auto _ : state) {
    m.w.next();
    std::copy(m.w.q.begin(), m.w.q.end(), m.data->qpos);
    compute(m.model, m.data);
    benchmark::ClobberMemory();
  }
}
BENCHMARK_CAPTURE(mujoco, forward_kinematics, [](const mjModel* m, mjData* d) { mj_kinematics(m, d); });
BENCHMARK_CAPTURE(mujoco, jacobian, [](const mjModel* m, mjData* d) {
  std::array<mjtNum, 21> linear, angular;
  mj_kinematics(m, d);
  mj_comPos(m, d);
  mj_jacSite(m, d, linear.data(), angular.data(), 0);
  benchmark::DoNotOptimize(linear);
});
BENCHMARK_CAPTURE(mujoco, inverse_dynamics, [](const mjModel* m, mjData* d) { mj_inverse(m, d); });
BENCHMARK_CAPTURE(mujoco, inertia_matrix, [](const mjModel* m, mjData* d) {
  mj_kinematics(m, d);
  mj_comPos(m, d);
  mj_crb(m, d);
});
BENCHMARK_CAPTURE(mujoco, forward_dynamics, [](const mjModel* m, mjData* d) { mj_forward(m, d); });
#endif

#ifdef TWOPORT_DART
/// Without the rotors.
struct Dart {
  dart::dynamics::SkeletonPtr arm = dart::dynamics::Skeleton::create();
  dart::dynamics::BodyNode* last = nullptr;
  Walk w;
  Dart() {
    arm->setGravity(kGravity);
    for (const ArmJoint& j : parameters().joints) {
      dart::dynamics::RevoluteJoint::Properties joint;
      joint.mAxis = Eigen::Vector3d::UnitZ();
      joint.mT_ParentBodyToJoint.linear() = j.rotation;
      joint.mT_ParentBodyToJoint.translation() = j.origin_m;
      dart::dynamics::BodyNode::Properties body;
      body.mInertia = dart::dynamics::Inertia{j.mass_kg, j.center_m, j.inertia};
      last = arm->createJointAndBodyNodePair<dart::dynamics::RevoluteJoint>(last, joint, body).second;
    }
  }
};
template <class Compute>
void dart_arm(benchmark::State& state, Compute compute) {
  Dart d;
  for (auto _ : state) {
    d.w.next();
    d.arm->setPositions(d.w.q);
    d.arm->setVelocities(d.w.v);
    d.arm->setAccelerations(d.w.a);
    compute(d);
    benchmark::ClobberMemory();
  }
}
BENCHMARK_CAPTURE(dart_arm, forward_kinematics, [](Dart& d) { benchmark::DoNotOptimize(d.last->getTransform()); });
BENCHMARK_CAPTURE(dart_arm, jacobian, [](Dart& d) { benchmark::DoNotOptimize(d.arm->getWorldJacobian(d.last)); });
BENCHMARK_CAPTURE(dart_arm, inverse_dynamics, [](Dart& d) { d.arm->computeInverseDynamics(); });
BENCHMARK_CAPTURE(dart_arm, inertia_matrix, [](Dart& d) { benchmark::DoNotOptimize(d.arm->getMassMatrix()); });
BENCHMARK_CAPTURE(dart_arm, forward_dynamics, [](Dart& d) { d.arm->computeForwardDynamics(); });
#endif

}  // namespace

BENCHMARK_MAIN();
