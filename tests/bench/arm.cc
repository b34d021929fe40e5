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

/// `compute(engine)` over and over, the arm a step further each time.
template <class Engine, class Compute>
void add(const char* name, Compute compute) {
  benchmark::RegisterBenchmark(name, [compute](benchmark::State& state) {
    Engine engine;
    for (auto _ : state) {
      engine.next();
      compute(engine);
      benchmark::ClobberMemory();
    }
  });
}

struct Own : Walk {
  const Arm arm{parameters()};
};
void add_own() {
  add<Own>("own/forward_kinematics", [](Own& o) { benchmark::DoNotOptimize(o.arm.pose(o.q)); });
  add<Own>("own/jacobian", [](Own& o) { benchmark::DoNotOptimize(o.arm.jacobian(o.arm.pose(o.q))); });
  add<Own>("own/gravity_torque",
           [](Own& o) { benchmark::DoNotOptimize(o.arm.gravity_torque(o.arm.pose(o.q), kGravity)); });
  add<Own>("own/inverse_dynamics",
           [](Own& o) { benchmark::DoNotOptimize(o.arm.inverse_dynamics(o.arm.pose(o.q), o.v, o.a, kGravity)); });
  add<Own>("own/inertia_matrix", [](Own& o) { benchmark::DoNotOptimize(o.arm.inertia(o.arm.pose(o.q))); });
  add<Own>("own/forward_dynamics",
           [](Own& o) { benchmark::DoNotOptimize(o.arm.forward_dynamics(o.arm.pose(o.q), o.v, o.a, kGravity)); });
}

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
  KDL::ChainFkSolverPos_recursive pose{chain};
  KDL::ChainJntToJacSolver jacobian{chain};
  KDL::ChainIdSolver_RNE inverse_dynamics{chain, test::kdl(kGravity)};
  KDL::ChainDynParam dynamics{chain, test::kdl(kGravity)};
  KDL::Frame frame;
  KDL::Jacobian J{7};
  KDL::JntSpaceInertiaMatrix M{7};
  Kdl() { q.data = Walk{}.q, v.data = Walk{}.v, a.data = Walk{}.a; }
  void next() { q(0) += 1e-4, q(3) -= 1e-5, q(5) += 2e-5; }
};
void add_kdl() {
  add<Kdl>("kdl/forward_kinematics", [](Kdl& k) { k.pose.JntToCart(k.q, k.frame); });
  add<Kdl>("kdl/jacobian", [](Kdl& k) { k.jacobian.JntToJac(k.q, k.J); });
  add<Kdl>("kdl/inverse_dynamics", [](Kdl& k) { k.inverse_dynamics.CartToJnt(k.q, k.v, k.a, k.none, k.tau); });
  add<Kdl>("kdl/inertia_matrix", [](Kdl& k) { k.dynamics.JntToMass(k.q, k.M); });
}
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
  void next() {
    w.next();
    std::copy(w.q.begin(), w.q.end(), data->qpos);
  }
};
void add_mujoco() {
  add<MuJoCo>("mujoco/forward_kinematics", [](MuJoCo& m) { mj_kinematics(m.model, m.data); });
  add<MuJoCo>("mujoco/jacobian", [](MuJoCo& m) {
    std::array<mjtNum, 21> linear, angular;
    mj_kinematics(m.model, m.data);
    mj_comPos(m.model, m.data);
    mj_jacSite(m.model, m.data, linear.data(), angular.data(), 0);
    benchmark::DoNotOptimize(linear);
  });
  add<MuJoCo>("mujoco/inverse_dynamics", [](MuJoCo& m) { mj_inverse(m.model, m.data); });
  add<MuJoCo>("mujoco/inertia_matrix", [](MuJoCo& m) {
    mj_kinematics(m.model, m.data);
    mj_comPos(m.model, m.data);
    mj_crb(m.model, m.data);
  });
  add<MuJoCo>("mujoco/forward_dynamics", [](MuJoCo& m) { mj_forward(m.model, m.data); });
}
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
  void next() {
    w.next();
    arm->setPositions(w.q);
    arm->setVelocities(w.v);
    arm->setAccelerations(w.a);
  }
};
void add_dart() {
  add<Dart>("dart_arm/forward_kinematics", [](Dart& d) { benchmark::DoNotOptimize(d.last->getTransform()); });
  add<Dart>("dart_arm/jacobian", [](Dart& d) { benchmark::DoNotOptimize(d.arm->getWorldJacobian(d.last)); });
  add<Dart>("dart_arm/inverse_dynamics", [](Dart& d) { d.arm->computeInverseDynamics(); });
  add<Dart>("dart_arm/inertia_matrix", [](Dart& d) { benchmark::DoNotOptimize(d.arm->getMassMatrix()); });
  add<Dart>("dart_arm/forward_dynamics", [](Dart& d) { d.arm->computeForwardDynamics(); });
}
#endif

}  // namespace

int main(int argc, char** argv) {
  add_own();
#ifdef TWOPORT_KDL
  add_kdl();
#endif
#ifdef TWOPORT_MUJOCO
  add_mujoco();
#endif
#ifdef TWOPORT_DART
  add_dart();
#endif
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
}
