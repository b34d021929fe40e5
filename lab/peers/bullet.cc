#include <btBulletDynamicsCommon.h>

#include "lab/peers/peers.h"

namespace twoport::lab {
namespace {

/// Bullet in double precision: semi-implicit Euler; soft contact by contact stiffness and damping, implicit.
class Bullet final : public Engine {
 public:
  explicit Bullet(const EngineBody& b) : b_{b} {
    world_.setGravity({0, 0, 0});
    const Eigen::Vector3d p = b.x.translation() - (b.dof == 1 ? kBallRadius : 0.0) * Eigen::Vector3d::UnitX();
    const Eigen::Quaterniond& q = b.x.attitude();
    if (b.dof == 1) {
      shape_ = std::make_unique<btSphereShape>(kBallRadius);
    } else {
      shape_ = std::make_unique<btBoxShape>(btVector3{b.half_size_m.x(), b.half_size_m.y(), b.half_size_m.z()});
    }
    const btVector3 inertia{b.inertia_kg_m2, b.inertia_kg_m2, b.inertia_kg_m2};
    body_ = std::make_unique<btRigidBody>(b.mass_kg, nullptr, shape_.get(), inertia);
    body_->setCenterOfMassTransform(btTransform{{q.x(), q.y(), q.z(), q.w()}, {p.x(), p.y(), p.z()}});
    body_->setLinearVelocity({b.v[0], b.v[1], b.v[2]});
    body_->setAngularVelocity({b.v[3], b.v[4], b.v[5]});
    body_->setDamping(0, 0);
    body_->setSleepingThresholds(0, 0);
    body_->setActivationState(DISABLE_DEACTIVATION);
    body_->setFriction(b.friction);
    if (b.own_contact) {
      ground_shape_ =
          std::make_unique<btStaticPlaneShape>(btVector3{b.normal.x(), b.normal.y(), b.normal.z()}, b.offset_m);
      ground_ = std::make_unique<btRigidBody>(0.0, nullptr, ground_shape_.get());
      ground_->setFriction(1.0);  // Bullet multiplies the two
      for (btRigidBody* each : {body_.get(), ground_.get()}) {
        // Two in series: 1/K = 1/K1 + 1/K2.
        each->setContactStiffnessAndDamping(2.0 * b.stiffness_n_per_m, 2.0 * b.damping_n_s_per_m);
        each->setRestitution(0);
      }
      world_.addRigidBody(ground_.get());
    }
    world_.addRigidBody(body_.get(), b.own_contact ? 1 : 0, b.own_contact ? -1 : 0);
  }
  ~Bullet() override {
    world_.removeRigidBody(body_.get());
    if (ground_) world_.removeRigidBody(ground_.get());
  }
  [[nodiscard]] double position() const override { return body_->getCenterOfMassPosition().x() + kBallRadius; }
  [[nodiscard]] double velocity() const override { return body_->getLinearVelocity().x(); }
  void push(double f) override { body_->applyCentralForce({f, 0, 0}); }
  [[nodiscard]] Position<6> pose() const override {
    const btVector3& p = body_->getCenterOfMassPosition();
    const btQuaternion q = body_->getOrientation();
    return {{p.x(), p.y(), p.z()}, {q.w(), q.x(), q.y(), q.z()}};
  }
  [[nodiscard]] Velocity<6> twist() const override {
    const btVector3 &v = body_->getLinearVelocity(), &w = body_->getAngularVelocity();
    Velocity<6>::Vector out;
    out << v.x(), v.y(), v.z(), w.x(), w.y(), w.z();
    return Velocity<6>{out};
  }
  void push(const Force<6>& f) override {
    body_->applyCentralForce({f[0], f[1], f[2]});
    body_->applyTorque({f[3], f[4], f[5]});
  }
  void step() override { world_.stepSimulation(b_.period_s, 0); }

 private:
  EngineBody b_;
  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  btDbvtBroadphase broadphase_;
  btSequentialImpulseConstraintSolver solver_;
  btDiscreteDynamicsWorld world_{&dispatcher_, &broadphase_, &solver_, &configuration_};
  std::unique_ptr<btCollisionShape> shape_, ground_shape_;
  std::unique_ptr<btRigidBody> body_, ground_;
};

}  // namespace

std::unique_ptr<Engine> bullet(const EngineBody& body) {
  return std::make_unique<Bullet>(body);
}

}  // namespace twoport::lab
