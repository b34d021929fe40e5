#include <ode/ode.h>

#include "lab/peers/peers.h"

namespace twoport::lab {
namespace {

/// ODE's WorldStep: semi-implicit Euler; a soft contact by ERP and CFM, implicit, so that
///
///     K = ERP/(h CFM),  B = (1 - ERP)/CFM
class Ode final : public Engine {
 public:
  explicit Ode(const EngineBody& b) : b_{b} {
    static const bool started = dInitODE2(0) != 0;
    (void)started;
    dAllocateODEDataForThread(static_cast<unsigned>(dAllocateMaskAll));
    world_ = dWorldCreate();
    dWorldSetGravity(world_, 0, 0, 0);
    dWorldSetAutoDisableFlag(world_, 0);
    body_ = dBodyCreate(world_);
    dMass mass;
    dMassSetParameters(&mass, b.mass_kg, 0, 0, 0, b.inertia_kg_m2, b.inertia_kg_m2, b.inertia_kg_m2, 0, 0, 0);
    dBodySetMass(body_, &mass);
    const Eigen::Vector3d p = b.x.translation() - (b.dof == 1 ? kBallRadius : 0.0) * Eigen::Vector3d::UnitX();
    dBodySetPosition(body_, p.x(), p.y(), p.z());
    const Eigen::Quaterniond& q = b.x.attitude();
    const dQuaternion wxyz{q.w(), q.x(), q.y(), q.z()};
    dBodySetQuaternion(body_, wxyz);
    dBodySetLinearVel(body_, b.v[0], b.v[1], b.v[2]);
    dBodySetAngularVel(body_, b.v[3], b.v[4], b.v[5]);
    if (!b.own_contact) return;
    space_ = dSimpleSpaceCreate(nullptr);
    plane_ = dCreatePlane(space_, b.normal.x(), b.normal.y(), b.normal.z(), b.offset_m);
    geom_ = b.dof == 1 ? dCreateSphere(space_, kBallRadius)
                       : dCreateBox(space_, 2 * b.half_size_m.x(), 2 * b.half_size_m.y(), 2 * b.half_size_m.z());
    dGeomSetBody(geom_, body_);
    contacts_ = dJointGroupCreate(0);
  }
  ~Ode() override {
    if (contacts_ != nullptr) dJointGroupDestroy(contacts_);
    if (space_ != nullptr) dSpaceDestroy(space_);
    dWorldDestroy(world_);
  }
  [[nodiscard]] double position() const override { return dBodyGetPosition(body_)[0] + kBallRadius; }
  [[nodiscard]] double velocity() const override { return dBodyGetLinearVel(body_)[0]; }
  void push(double f) override { dBodyAddForce(body_, f, 0, 0); }
  [[nodiscard]] Position<6> pose() const override {
    const dReal *p = dBodyGetPosition(body_), *q = dBodyGetQuaternion(body_);
    return {{p[0], p[1], p[2]}, {q[0], q[1], q[2], q[3]}};
  }
  [[nodiscard]] Velocity<6> twist() const override {
    const dReal *v = dBodyGetLinearVel(body_), *w = dBodyGetAngularVel(body_);
    Velocity<6>::Vector out;
    out << v[0], v[1], v[2], w[0], w[1], w[2];
    return Velocity<6>{out};
  }
  void push(const Force<6>& f) override {
    dBodyAddForce(body_, f[0], f[1], f[2]);
    dBodyAddTorque(body_, f[3], f[4], f[5]);
  }
  void step() override {
    if (b_.own_contact) touch();
    dWorldStep(world_, b_.period_s);
    if (b_.own_contact) dJointGroupEmpty(contacts_);
  }

 private:
  void touch() {
    dContact contacts[8];
    const int count = dCollide(geom_, plane_, 8, &contacts[0].geom, sizeof(dContact));
    const double hk = b_.period_s * b_.stiffness_n_per_m;
    for (int i = 0; i < count; ++i) {
      dSurfaceParameters& s = contacts[i].surface;
      s = {};
      s.mode = dContactSoftERP | dContactSoftCFM | dContactApprox1;
      s.mu = b_.friction;
      s.soft_erp = hk / (hk + b_.damping_n_s_per_m);
      s.soft_cfm = 1.0 / (hk + b_.damping_n_s_per_m);
      dJointAttach(dJointCreateContact(world_, contacts_, &contacts[i]), body_, nullptr);
    }
  }

  EngineBody b_;
  dWorldID world_;
  dBodyID body_;
  dSpaceID space_ = nullptr;
  dGeomID plane_ = nullptr, geom_ = nullptr;
  dJointGroupID contacts_ = nullptr;
};

}  // namespace

std::unique_ptr<Engine> ode(const EngineBody& body) {
  return std::make_unique<Ode>(body);
}

}  // namespace twoport::lab
