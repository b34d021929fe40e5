#include <fmt/format.h>
#include <mujoco/mujoco.h>

#include <algorithm>
#include <cstring>

#include "common/base/check.h"
#include "lab/peers/peers.h"

namespace twoport::lab {
namespace {

/// MuJoCo's Euler (semi-implicit). Its contact is a constraint on the acceleration, of impedance d, not a stiffness in
/// N/m: with negative solref = -k, -b, and m' = 1/body_invweight0 (m for a free body, 3 m on one slide: the mean of
/// three axes)
///
///     K = k m'/(1 - d),   B = b m'/(1 - d)
///
/// d also reduces every other force, so it is the smallest that MuJoCo allows. The stiffness of a pyramidal cone
/// depends on the direction, so the cone is elliptic.
class MuJoCo final : public Engine {
 public:
  explicit MuJoCo(const EngineBody& b) : b_{b} {
    constexpr double kImpedance = 1e-4;
    const Eigen::Vector3d p = b.x.translation();
    const Eigen::Quaterniond& q = b.x.attitude();
    const std::string geom =
        b.dof == 1 ? fmt::format("type='sphere' size='{}' pos='{} 0 0'", kBallRadius, -kBallRadius)
                   : fmt::format("type='box' size='{} {} {}'", b.half_size_m.x(), b.half_size_m.y(), b.half_size_m.z());
    const std::string contact = b.own_contact
                                    ? fmt::format("solref='-1 -1' solimp='{} {} 0.001' friction='{} 0 0' condim='{}'",
                                                  kImpedance, kImpedance, b.friction, b.friction > 0 ? 3 : 1)
                                    : "contype='0' conaffinity='0'";
    const std::string plane =
        b.own_contact ? fmt::format("<geom type='plane' size='1 1 1' pos='{} {} {}' zaxis='{} {} {}' {}/>",
                                    b.offset_m * b.normal.x(), b.offset_m * b.normal.y(), b.offset_m * b.normal.z(),
                                    b.normal.x(), b.normal.y(), b.normal.z(), contact)
                      : "";
    const std::string xml = fmt::format(
        "<mujoco><option timestep='{}' gravity='0 0 0' integrator='Euler' cone='elliptic'/><worldbody>{}<body pos='{} "
        "{} {}' quat='{} {} {} {}'><inertial pos='0 0 0' mass='{}' diaginertia='{} {} {}'/>{}<geom {} "
        "{}/></body></worldbody></mujoco>",
        b.period_s, plane, b.dof == 1 ? 0.0 : p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z(), b.mass_kg,
        b.inertia_kg_m2, b.inertia_kg_m2, b.inertia_kg_m2,
        b.dof == 1 ? "<joint type='slide' axis='1 0 0'/>" : "<freejoint/>", geom, contact);
    const auto files = std::make_unique<mjVFS>();
    mj_defaultVFS(files.get());
    mj_makeEmptyFileVFS(files.get(), "body.xml", static_cast<int>(xml.size()));
    std::memcpy(files->filedata[0], xml.data(), xml.size());
    char error[500] = "";
    model_ = mj_loadXML("body.xml", files.get(), error, sizeof error);
    mj_deleteVFS(files.get());
    if (model_ == nullptr) throw ConfigError{fmt::format("MuJoCo: {}", error)};
    const double scale = (1.0 - kImpedance) * model_->body_invweight0[2];
    for (int geom_id = 0; b.own_contact && geom_id < model_->ngeom; ++geom_id) {
      mjtNum* solref = model_->geom_solref + mjNREF * geom_id;
      solref[0] = -scale * b.stiffness_n_per_m;
      solref[1] = std::min(-scale * b.damping_n_s_per_m, -1e-9);  // 0 would mean the other format
    }
    data_ = mj_makeData(model_);
    if (b.dof == 1) {
      data_->qpos[0] = p.x();
      data_->qvel[0] = b.v[0];
    } else {
      const Eigen::Vector3d w = q.conjugate() * Eigen::Vector3d{b.v[3], b.v[4], b.v[5]};  // body axes
      for (int i = 0; i < 3; ++i) data_->qvel[i] = b.v[i], data_->qvel[3 + i] = w[i];
    }
    mj_forward(model_, data_);
  }
  ~MuJoCo() override {
    mj_deleteData(data_);
    mj_deleteModel(model_);
  }
  [[nodiscard]] double position() const override { return data_->qpos[0]; }
  [[nodiscard]] double velocity() const override { return data_->qvel[0]; }
  void push(double f) override { data_->qfrc_applied[0] = f; }
  [[nodiscard]] Position<6> pose() const override {
    const mjtNum* q = data_->qpos;
    return {{q[0], q[1], q[2]}, {q[3], q[4], q[5], q[6]}};
  }
  [[nodiscard]] Velocity<6> twist() const override {
    const mjtNum *q = data_->qpos, *v = data_->qvel;
    const Eigen::Vector3d w = Eigen::Quaterniond{q[3], q[4], q[5], q[6]} * Eigen::Vector3d{v[3], v[4], v[5]};
    Velocity<6>::Vector out;
    out << v[0], v[1], v[2], w;
    return Velocity<6>{out};
  }
  void push(const Force<6>& f) override {
    for (int i = 0; i < 6; ++i) data_->xfrc_applied[6 + i] = f[i];
  }
  void step() override { mj_step(model_, data_); }

 private:
  EngineBody b_;
  mjModel* model_;
  mjData* data_;
};

}  // namespace

std::unique_ptr<Engine> mujoco(const EngineBody& body) {
  return std::make_unique<MuJoCo>(body);
}

}  // namespace twoport::lab
