#include <fmt/format.h>
#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/hardware/admittance.h"
#include "common/hardware/registry.h"
#include "common/hardware/virtual_robot.h"
#include "common/mesh/triangle_mesh.h"

namespace twoport {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr Seconds kWatchdog{0.1};
constexpr double kLeastStep = 1e-5, kLongestStep = 0.02;  // of a world [s]
// That is made good in one tick beyond its own length and a step [s]; a world slower than the clock runs slow.
constexpr double kMostBehind = 5e-3;
// From a set point of position servos, or of a weld, to the tool, as the body in its place counts it.
constexpr Servo kModelServo{.period = Seconds{1e-3}, .delay = Seconds{}, .lag = Seconds{0.02}};

[[noreturn]] void refuse(const std::string& arguments, const std::string& words) {
  throw ConfigError{"--robot mujoco:" + arguments + ": " + words};
}

/// FILE.xml[,site=NAME][,key=NAME][,actuators=off], the options in any order
struct Arguments {
  std::string file, site, key, actuators;
};
Arguments parse(const std::string& text) {
  Arguments a{text, {}, {}, {}};
  for (std::size_t comma; (comma = a.file.rfind(',')) != a.file.npos; a.file.resize(comma)) {
    const std::string option = a.file.substr(comma + 1);
    const std::size_t name = option.find('=') + 1;
    std::string* const value = option.starts_with("site=")        ? &a.site
                               : option.starts_with("key=")       ? &a.key
                               : option.starts_with("actuators=") ? &a.actuators
                                                                  : nullptr;
    if (value == nullptr || !value->empty() || name == option.size())
      refuse(text, "after the file stand ,site=NAME, ,key=NAME and ,actuators=off, each once and with a name");
    *value = option.substr(name);
  }
  if (!a.actuators.empty() && a.actuators != "off")
    refuse(text, "actuators is " + a.actuators + "; it must be off, or absent: position servos are then driven");
  if (a.file.empty())
    refuse(text, "name a model and, where it has several sites, the tool's: mujoco:FILE.xml,site=NAME");
  return a;
}

/// The state of a model, which copies share.
class State {
 public:
  explicit State(const mjModel& model) : model_{&model}, data_{mj_makeData(model_)} {}
  State(const State& o) : model_{o.model_}, data_{mj_copyData(nullptr, model_, o.data_)} {}
  ~State() { mj_deleteData(data_); }
  State& operator=(const State&) = delete;
  [[nodiscard]] mjData* get() const noexcept { return data_; }
  [[nodiscard]] mjData* operator->() const noexcept { return data_; }

 private:
  const mjModel* model_;
  mjData* data_;
};

/// A model of MuJoCo and a tool in it: a site, or the origin of the only body that moves.
class World {
 public:
  explicit World(const std::string& arguments) : World{arguments, parse(arguments)} {}

  [[nodiscard]] std::string name() const { return std::string{"MuJoCo: "} + model_->names; }
  /// Of the tool's point by the joints: translation first, world axes. 0 for a joint that hardly moves it (kLeastMotion).
  [[nodiscard]] Eigen::MatrixXd jacobian() const {
    Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::RowMajor> linear{3, model_->nv}, angular{3, model_->nv};
    const Vector3d at = point();
    mj_jac(model_.get(), data_.get(), linear.data(), angular.data(), at.data(), body_);
    Eigen::MatrixXd J{6, model_->nv};
    J << linear, angular;
    for (int i = 0; i < model_->nv; ++i)
      if (!moves(i, J.col(i).norm())) J.col(i).setZero();
    return J;
  }

  void push(const Vector6& wrench) noexcept { wrench_ = wrench; }
  /// Do set points move the tool, not forces?
  [[nodiscard]] bool obeys_positions() const noexcept { return !servos_.empty() || mocap_ >= 0; }
  /// In how many of the first `rows` directions do they?
  [[nodiscard]] Eigen::Index rank_of_servos(Eigen::Index rows) {
    if (mocap_ >= 0) return rows;
    look_at_servos();
    return Eigen::ColPivHouseholderQR<Eigen::MatrixXd>{driven_.topRows(rows)}.rank();
  }
  /// Moves the set point of the servos, or the mocap body, towards that tool pose; `axes`: rows that count, 3 or 6.
  template <int axes>
  void want(const Eigen::Isometry3d& pose) noexcept {
    if (mocap_ >= 0) {
      place_mocap(pose);
      return;
    }
    std::copy_n(data_->qpos, model_->nq, wanted_->qpos);
    for (int k = 0; k < 3; ++k) {
      for (const ServoJoint& s : servos_) wanted_->qpos[s.q] = s.q_wanted;
      look_at_servos();
      Vector6 left;
      left << pose.translation() - point_of(wanted_.get()),
          rotation_vector(Eigen::Quaterniond{pose.linear()} * attitude_of(wanted_.get()).conjugate());
      // Damped least squares: a singular pose stretches no joint.
      const auto J = driven_.topRows<axes>();
      Eigen::Matrix<double, axes, axes> square = J * J.transpose();
      square.diagonal().array() += 1e-6;
      const Eigen::Matrix<double, axes, 1> y = square.ldlt().solve(left.head<axes>());
      for (std::size_t i = 0; i < servos_.size(); ++i) {
        double& q = servos_[i].q_wanted;
        q += J.col(static_cast<Eigen::Index>(i)).dot(y);
        const int joint = model_->dof_jntid[servos_[i].dof];
        if (model_->jnt_limited[joint] != 0)
          q = std::clamp(q, model_->jnt_range[2 * joint], model_->jnt_range[2 * joint + 1]);
      }
    }
    command_servos();
  }
  /// Adds to the joints' velocities the least that gives the tool `dv` more; `J`: rows of jacobian().
  void kick(const Eigen::MatrixXd& J, const Eigen::VectorXd& dv) {
    Eigen::Map<Eigen::VectorXd>{data_->qvel, model_->nv} += J.completeOrthogonalDecomposition().solve(dv);
  }
  /// The model as MuJoCo writes it.
  [[nodiscard]] std::string bytes() const {
    std::string all(static_cast<std::size_t>(mj_sizeModel(model_.get())), '\0');
    mj_saveModel(model_.get(), nullptr, all.data(), static_cast<int>(all.size()));
    return all;
  }
  /// `time` has passed, since the last tick, of which each has the length `dt`.
  void advance(Seconds time, Seconds dt) noexcept {
    const double h = model_->opt.timestep;
    behind_ = std::min(behind_ + time.si(), dt.si() + h + kMostBehind);
    Vector6 sum = Vector6::Zero();
    int steps = 0;
    for (; behind_ >= 0.5 * h; behind_ -= h, ++steps) {
      // The force acts on the point; MuJoCo wants it at the body's centre of mass.
      const Vector3d lever = point() - Eigen::Map<const Vector3d>{data_->xipos + 3 * body_}, f = wrench_.head<3>();
      Eigen::Map<Vector3d>{data_->xfrc_applied + 6 * body_} = f;
      Eigen::Map<Vector3d>{data_->xfrc_applied + 6 * body_ + 3} = wrench_.tail<3>() + lever.cross(f);
      mj_step(model_.get(), data_.get());
      sum += contact();
      mj_kinematics(model_.get(), data_.get());
    }
    if (steps == 0) return;
    contact_ = sum / steps;
    mj_comPos(model_.get(), data_.get());
    mj_comVel(model_.get(), data_.get());
  }

  [[nodiscard]] Vector3d point() const noexcept { return point_of(data_.get()); }
  [[nodiscard]] Eigen::Quaterniond attitude() const noexcept { return attitude_of(data_.get()); }
  [[nodiscard]] Vector6 velocity() const noexcept {
    Vector6 angular_first;
    mj_objectVelocity(model_.get(), data_.get(), site_ >= 0 ? mjOBJ_SITE : mjOBJ_XBODY, site_ >= 0 ? site_ : body_,
                      angular_first.data(), 0);
    Vector6 v;
    v << angular_first.tail<3>(), angular_first.head<3>();
    return v;
  }
  /// Of all contacts on the tool about its point, a mean over the last interval.
  [[nodiscard]] const Vector6& contact_wrench() const noexcept { return contact_; }
  [[nodiscard]] bool touches() const noexcept { return touches_; }
  /// The geoms of the groups that MuJoCo's own viewer shows.
  [[nodiscard]] WorldPicture picture() const {
    constexpr int kShownGroups = 3;
    const Eigen::Isometry3d tool = Eigen::Translation3d{point()} * attitude();
    WorldPicture all;
    for (int geom = 0; geom < model_->ngeom; ++geom) {
      const int body = model_->geom_bodyid[geom];
      const bool of_tool = of_tool_[static_cast<std::size_t>(body)];
      if (model_->geom_group[geom] >= kShownGroups || (!of_tool && model_->body_weldid[body] != 0)) continue;
      using Rows = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
      Eigen::Affine3d at = Eigen::Translation3d{Eigen::Map<const Vector3d>{data_->geom_xpos + 3 * geom}} *
                           Matrix3d{Eigen::Map<const Rows>{data_->geom_xmat + 9 * geom}};
      if (of_tool) at = tool.inverse() * at;
      append(of_tool ? all.tool : all.still, shape_of(geom), at);
    }
    return all;
  }
  /// Why it is no more what the model says; null: it is.
  [[nodiscard]] const char* lost() const noexcept {
    // It then begins anew.
    for (const mjtWarning bad : {mjWARN_BADQPOS, mjWARN_BADQVEL, mjWARN_BADQACC})
      if (data_->warning[bad].number > 0)
        return "MuJoCo has lost the world to a number that is not finite; take a smaller timestep";
    // It then leaves contacts out.
    for (const mjtWarning full : {mjWARN_CONTACTFULL, mjWARN_CNSTRFULL})
      if (data_->warning[full].number > 0)
        return "MuJoCo has no room for all contacts; give the model larger nconmax and njmax, in <size>";
    return nullptr;
  }

 private:
  /// A joint that a position servo drives: ctrl = scale q + offset.
  struct ServoJoint {
    int actuator, q, dof;
    double scale, offset, q_wanted;
  };

  /// Does a joint of this lever move the tool? Its mass, damping and spring are counted, not its servo.
  [[nodiscard]] bool moves(int dof, double lever) const noexcept {
    constexpr double kForce = 100.0, kLeastMotion = 1e-3;  // in 1 s [N, m; N m, rad]
    const double holds = model_->dof_M0[dof] + model_->dof_damping[dof] + model_->jnt_stiffness[model_->dof_jntid[dof]];
    return kForce * lever * lever >= kLeastMotion * holds;
  }
  [[nodiscard]] Vector3d point_of(const mjData* d) const noexcept {
    return Eigen::Map<const Vector3d>{site_ >= 0 ? d->site_xpos + 3 * site_ : d->xpos + 3 * body_};
  }
  [[nodiscard]] Eigen::Quaterniond attitude_of(const mjData* d) const noexcept {
    using Axes = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
    return Eigen::Quaterniond{
        Matrix3d{Eigen::Map<const Axes>{site_ >= 0 ? d->site_xmat + 9 * site_ : d->xmat + 9 * body_}}};
  }
  /// Pose and Jacobian of the tool where the set point has its joints; the other joints are where they are.
  void look_at_servos() noexcept {
    mjData* const d = wanted_.get();
    mj_kinematics(model_.get(), d);
    mj_comPos(model_.get(), d);
    const Vector3d at = point_of(d);
    mj_jac(model_.get(), d, linear_.data(), angular_.data(), at.data(), body_);
    for (std::size_t i = 0; i < servos_.size(); ++i)
      driven_.col(static_cast<Eigen::Index>(i)) << linear_.col(servos_[i].dof), angular_.col(servos_[i].dof);
  }
  World(const std::string& arguments, const Arguments& a)
      : model_{load(arguments, a)}, data_{*model_}, wanted_{*model_} {
    choose_tool(arguments, a.site);
    if (!a.key.empty()) {
      mj_resetDataKeyframe(model_.get(), data_.get(), keyframe(arguments, a.key));
    }
    mj_forward(model_.get(), data_.get());
    // The tool is what is welded to its body, and what hangs on that.
    const int weld = model_->body_weldid[body_];
    for (int body = 0; body < model_->nbody; ++body) {
      int at = body;
      while (at != 0 && model_->body_weldid[at] != weld) at = model_->body_parentid[at];
      of_tool_.push_back(at != 0);
    }
    find_servos(arguments);
    find_weld(arguments);
  }

  /// By its name, or its number from 0.
  [[nodiscard]] int keyframe(const std::string& arguments, const std::string& name) const {
    int key = mj_name2id(model_.get(), mjOBJ_KEY, name.c_str());
    for (int i = 0; key < 0 && i < model_->nkey; ++i)
      if (name == std::to_string(i)) key = i;
    if (key < 0)
      refuse(arguments, model_->nkey == 0
                            ? "the model has no keyframes"
                            : fmt::format("no keyframe \"{}\"; there are {}, by name or number from 0: {}", name,
                                          model_->nkey, list(model_->nkey, model_->name_keyadr)));
    return key;
  }
  [[nodiscard]] std::string name_of(mjtObj kind, int id) const {
    const char* const name = mj_id2name(model_.get(), kind, id);
    return name != nullptr ? "\"" + std::string{name} + "\"" : "number " + std::to_string(id);
  }
  /// Is it the tool's or between it and the world?
  [[nodiscard]] bool carries_tool(int body) const noexcept {
    int at = body_;
    while (at != 0 && at != body) at = model_->body_parentid[at];
    return body != 0 && (at == body || of_tool_[static_cast<std::size_t>(body)]);
  }

  /// Empty: the actuator is no position servo of a joint.
  [[nodiscard]] std::optional<ServoJoint> servo(int a) const {
    const double* const bias = model_->actuator_biasprm + static_cast<std::ptrdiff_t>(a) * mjNBIAS;
    const double gain = model_->actuator_gainprm[static_cast<std::ptrdiff_t>(a) * mjNGAIN];
    if (const int of = model_->actuator_trntype[a]; of != mjTRN_JOINT && of != mjTRN_JOINTINPARENT) return {};
    const int joint = model_->actuator_trnid[static_cast<std::ptrdiff_t>(a) * 2], q = model_->jnt_qposadr[joint];
    const bool one = model_->jnt_type[joint] == mjJNT_HINGE || model_->jnt_type[joint] == mjJNT_SLIDE;
    if (!one || model_->actuator_dyntype[a] != mjDYN_NONE || model_->actuator_gaintype[a] != mjGAIN_FIXED ||
        model_->actuator_biastype[a] != mjBIAS_AFFINE || bias[1] >= 0.0 || gain <= 0.0)
      return {};
    return ServoJoint{.actuator = a,
                      .q = q,
                      .dof = model_->jnt_dofadr[joint],
                      .scale = -bias[1] * model_->actuator_gear[static_cast<std::ptrdiff_t>(a) * 6] / gain,
                      .offset = -bias[0] / gain,
                      .q_wanted = data_->qpos[q]};
  }
  /// The actuators of the joints that move the tool. Torque motors hold nothing; position servos are driven by set points; others
  /// would hold the tool, and are refused. Position servos of other joints hold them where they start, unless the start has controls.
  void find_servos(const std::string& arguments) {
    bool held = false;
    std::string why;
    const bool without_controls = std::all_of(data_->ctrl, data_->ctrl + model_->nu, [](double c) { return c == 0.0; });
    for (int a = 0; a < model_->nu; ++a) {
      const double* const moment = data_->actuator_moment + static_cast<std::ptrdiff_t>(a) * model_->nv;
      int dof = -1;
      for (int i = 0; i < model_->nv; ++i) {
        int at = body_;
        while (at != 0 && at != model_->dof_bodyid[i]) at = model_->body_parentid[at];
        if (at != 0 && moment[i] != 0.0) dof = i;
      }
      const std::optional<ServoJoint> of_joint = servo(a);
      if (dof < 0) {
        if (of_joint && without_controls) command(*of_joint);
        continue;
      }
      if (model_->actuator_biastype[a] == mjBIAS_NONE) continue;
      if (of_joint) servos_.push_back(*of_joint);
      if (!of_joint && !held)
        why = "the actuator " + name_of(mjOBJ_ACTUATOR, a) + " holds the joint " +
              name_of(mjOBJ_JOINT, model_->dof_jntid[dof]) +
              ", which moves the tool, and is no position servo of it; ,actuators=off lets it go";
      held = held || !of_joint;
    }
    if (held) refuse(arguments, why);
    std::copy_n(data_->qpos, model_->nq, wanted_->qpos);
    linear_.resize(3, model_->nv);
    angular_.resize(3, model_->nv);
    driven_.setZero(6, static_cast<Eigen::Index>(servos_.size()));
    command_servos();
  }
  /// A weld of what carries the tool to a mocap body is moved, from where it pulls at nothing; other constraints of it are named.
  void find_weld(const std::string& arguments) {
    for (int e = 0; e < model_->neq; ++e) {
      if (model_->eq_active[e] == 0 || (model_->eq_type[e] != mjEQ_WELD && model_->eq_type[e] != mjEQ_CONNECT))
        continue;
      const int one = model_->eq_obj1id[e], two = model_->eq_obj2id[e];
      if (!carries_tool(one) && !carries_tool(two)) continue;
      const int other = carries_tool(one) ? two : one, mocap = model_->body_mocapid[other];
      const bool of_tool = of_tool_[static_cast<std::size_t>(other == two ? one : two)];
      if (mocap >= 0 && model_->eq_type[e] == mjEQ_WELD && of_tool) {
        mocap_ = mocap;
        // By MuJoCo the first body holds an anchor of the second, and has a pose of that relative to it.
        const double* const data = model_->eq_data + static_cast<std::ptrdiff_t>(e) * mjNEQDATA;
        const Eigen::Isometry3d second_in_first =
            pose_of(data + 3, data + 6) * Eigen::Translation3d{-Eigen::Map<const Vector3d>{data}};
        const int held = other == two ? one : two;
        const Eigen::Isometry3d body = pose_of(data_->xpos + 3 * held, data_->xquat + 4 * held);
        weld_ = tool().inverse() * body * (other == two ? second_in_first : second_in_first.inverse());
        place_mocap(tool());
      } else if (model_->body_weldid[other] == 0) {
        refuse(arguments,
               "the equality constraint " + name_of(mjOBJ_EQUALITY, e) +
                   " holds a body that carries the tool; a weld of the tool's body to a mocap body is moved, and "
                   "active=\"false\" lets go");
      }
    }
  }
  /// Where the weld pulls at nothing with the tool at that pose.
  void place_mocap(const Eigen::Isometry3d& tool) noexcept {
    const Eigen::Isometry3d at = tool * weld_;
    const Eigen::Quaterniond q{at.linear()};
    Eigen::Map<Vector3d>{data_->mocap_pos + 3 * mocap_} = at.translation();
    Eigen::Map<Eigen::Vector4d>{data_->mocap_quat + 4 * mocap_} = Eigen::Vector4d{q.w(), q.x(), q.y(), q.z()};
  }
  static Eigen::Isometry3d pose_of(const double* at, const double* wxyz) {
    return Eigen::Translation3d{at[0], at[1], at[2]} * Eigen::Quaterniond{wxyz[0], wxyz[1], wxyz[2], wxyz[3]};
  }
  [[nodiscard]] Eigen::Isometry3d tool() const noexcept { return Eigen::Translation3d{point()} * attitude(); }

  void command(const ServoJoint& s) noexcept { data_->ctrl[s.actuator] = s.scale * s.q_wanted + s.offset; }
  void command_servos() noexcept {
    for (const ServoJoint& s : servos_) command(s);
  }

  static std::shared_ptr<const mjModel> load(const std::string& arguments, const Arguments& a) {
    const std::string& file = a.file;
    std::error_code none;
    if (!std::filesystem::is_regular_file(file, none))
      refuse(arguments, "there is no such file; give the path of a model in MJCF or URDF");
    static_cast<void>(read_text(file, "--robot mujoco:" + arguments));  // refuses other encodings
    // They would write a file, and wait for a key.
    mju_user_warning = [](const char* words) { std::fprintf(stderr, "MuJoCo: %s\n", words); };
    mju_user_error = [](const char* words) {
      std::fprintf(stderr, "MuJoCo: %s\n", words);
      std::exit(1);
    };
    std::array<char, 1000> error{};
    mjModel* const model = mj_loadXML(file.c_str(), nullptr, error.data(), static_cast<int>(error.size()));
    if (model == nullptr) {
      std::string words{error.data()};
      std::replace(words.begin(), words.end(), '\n', ' ');
      refuse(arguments, "MuJoCo " + std::string{mj_versionString()} + " cannot read it: " + words);
    }
    if (!a.actuators.empty()) model->opt.disableflags |= mjDSBL_ACTUATION;
    if (!a.actuators.empty()) std::fill_n(model->actuator_biastype, model->nu, static_cast<int>(mjBIAS_NONE));
    std::shared_ptr<const mjModel> loaded{model, [](const mjModel* m) { mj_deleteModel(const_cast<mjModel*>(m)); }};
    if (const double h = loaded->opt.timestep; !(h >= kLeastStep && h <= kLongestStep))
      refuse(arguments,
             fmt::format("its timestep is {:g} s; it must be between {:g} and {:g}", h, kLeastStep, kLongestStep));
    return loaded;
  }
  [[nodiscard]] std::string list(int count, const int* names) const {
    std::string all;
    for (int i = 0; i < count; ++i) {
      const std::string name{model_->names + names[i]};
      all += (i > 0 ? ", " : "") + (name.empty() ? std::to_string(i) : name);
    }
    return all;
  }
  void choose_tool(const std::string& arguments, const std::string& site) {
    if (!site.empty() || model_->nsite > 0) {
      site_ = site.empty() ? 0 : mj_name2id(model_.get(), mjOBJ_SITE, site.c_str());
      if (site_ < 0)
        refuse(arguments, model_->nsite == 0
                              ? "the model has no sites"
                              : "no site \"" + site + "\"; there are " + list(model_->nsite, model_->name_siteadr));
      if (site.empty() && model_->nsite > 1)
        refuse(arguments, "the model has the sites " + list(model_->nsite, model_->name_siteadr) + "; add ,site=NAME");
      body_ = model_->site_bodyid[site_];
      return;
    }
    for (int body = 1; body < model_->nbody; ++body) {
      if (model_->body_jntnum[body] == 0) continue;
      if (body_ > 0) refuse(arguments, "the model has several bodies that move; put a site on the tool");
      body_ = body;
    }
    if (body_ == 0) refuse(arguments, "no body of the model moves");
  }

  /// In axes of the geom; empty: of a kind that is not shown.
  [[nodiscard]] TriangleMesh shape_of(int geom) const {
    constexpr double kPlane = 0.3, kThin = 1e-3;  // half size of one without end, thickness [m]
    const Eigen::Map<const Vector3d> size{model_->geom_size + 3 * geom};
    const auto scaled = [](const TriangleMesh& unit, const Vector3d& by) {
      TriangleMesh shape;
      append(shape, unit, Eigen::Affine3d{Eigen::Scaling(by)});
      return shape;
    };
    switch (model_->geom_type[geom]) {
      case mjGEOM_PLANE: {
        const auto side = [](double half) { return 2.0 * (half > 0.0 ? half : kPlane); };
        TriangleMesh plane;
        append(plane, unit_box(),
               Eigen::Translation3d{0.0, 0.0, -0.5 * kThin} * Eigen::Scaling(side(size[0]), side(size[1]), kThin));
        return plane;
      }
      case mjGEOM_SPHERE:
        return capsule(size[0], 0.0);
      case mjGEOM_CAPSULE:
        return capsule(size[0], size[1]);
      case mjGEOM_ELLIPSOID:
        return scaled(capsule(1.0, 0.0), size);
      case mjGEOM_CYLINDER:
        return scaled(unit_cylinder(), {size[0], size[0], 2.0 * size[1]});
      case mjGEOM_BOX:
        return scaled(unit_box(), 2.0 * size);
      case mjGEOM_MESH: {
        const int mesh = model_->geom_dataid[geom];
        TriangleMesh shape;
        for (int v = 0; v < model_->mesh_vertnum[mesh]; ++v)
          shape.vertices.push_back(
              Eigen::Map<const Eigen::Vector3f>{model_->mesh_vert + 3 * (model_->mesh_vertadr[mesh] + v)}
                  .cast<double>());
        for (int f = 0; f < model_->mesh_facenum[mesh]; ++f) {
          const int* const face = model_->mesh_face + 3 * (model_->mesh_faceadr[mesh] + f);
          shape.triangles.push_back({static_cast<std::uint32_t>(face[0]), static_cast<std::uint32_t>(face[1]),
                                     static_cast<std::uint32_t>(face[2])});
        }
        return shape;
      }
      default:
        return {};
    }
  }

  /// Wrench on the tool.
  [[nodiscard]] Vector6 contact() noexcept {
    Vector6 sum = Vector6::Zero();
    touches_ = false;
    for (int i = 0; i < data_->ncon; ++i) {
      const mjContact& c = data_->contact[i];
      const bool first = of_tool_[static_cast<std::size_t>(model_->geom_bodyid[c.geom1])],
                 second = of_tool_[static_cast<std::size_t>(model_->geom_bodyid[c.geom2])];
      if (first == second || c.efc_address < 0) continue;
      touches_ = true;
      Vector6 in_frame;  // on the second body, in axes of the contact
      mj_contactForce(model_.get(), data_.get(), i, in_frame.data());
      const Eigen::Map<const Matrix3d> axes{c.frame};  // by rows: its columns are the axes
      const Vector3d f = axes * in_frame.head<3>() * (second ? 1.0 : -1.0),
                     t = axes * in_frame.tail<3>() * (second ? 1.0 : -1.0);
      sum.head<3>() += f;
      sum.tail<3>() += t + (Eigen::Map<const Vector3d>{c.pos} - point()).cross(f);
    }
    return sum;
  }

  using JointRows = Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::RowMajor>;

  std::shared_ptr<const mjModel> model_;
  State data_;
  State wanted_;  ///< joints of the set point
  std::vector<ServoJoint> servos_;
  JointRows linear_, angular_;
  Eigen::Matrix<double, 6, Eigen::Dynamic> driven_;         ///< columns of the servos
  int mocap_ = -1;                                          ///< welded to the tool's body
  Eigen::Isometry3d weld_ = Eigen::Isometry3d::Identity();  ///< of that body in axes of the tool
  int site_ = -1, body_ = 0;                                ///< of the tool; no site: the body's origin
  std::vector<bool> of_tool_;                               ///< by body: the tool's and those that hang on it
  double behind_ = 0.0;                                     ///< the clock [s]
  bool touches_ = false;
  Vector6 wrench_ = Vector6::Zero(), contact_ = Vector6::Zero();
};

/// A tool in a world of MuJoCo, driven by forces; where position servos or a weld move it, by the set points of an Admittance. With one axis: along the joint that moves it.
template <int N>
class MujocoRobot final : public VirtualRobot<N> {
 public:
  explicit MujocoRobot(const DriverOptions& o) : arguments_{o.arguments}, world_{o.arguments} {
    const Eigen::MatrixXd J = world_.jacobian();
    if constexpr (N == 1) {
      Eigen::Index most = 0;
      if (J.cols() > 0)
        if (J.topRows<3>().colwise().norm().maxCoeff(&most) > 0.0) axis_ = J.col(most).head<3>().normalized();
    }
    const Eigen::Index free =
        J.cols() == 0 ? 0 : Eigen::ColPivHouseholderQR<Eigen::MatrixXd>{J.topRows(N == 6 ? 6 : 3)}.rank();
    if (free < N)
      refuse(o.arguments, "where it starts, its joints move the tool in " + std::to_string(free) +
                              " directions; a scene with dof " + std::to_string(N) + " needs " + std::to_string(N) +
                              (free > 0 ? "; ,key=NAME starts at a keyframe" : ""));
    if (!world_.obeys_positions()) return;
    if (const Eigen::Index driven = world_.rank_of_servos(N == 6 ? 6 : 3); driven < N)
      refuse(o.arguments, "where it starts, its position servos move the tool in " + std::to_string(driven) +
                              " directions; a scene with dof " + std::to_string(N) + " needs " + std::to_string(N) +
                              "; ,actuators=off lets them go");
    start_ = Eigen::Translation3d{world_.point()} * world_.attitude();
    body_.emplace(kModelServo);
    body_->rest(position());
  }

  [[nodiscard]] RobotInfo info() const override { return {.name = world_.name(), .watchdog = kWatchdog}; }
  RobotSample<N> sense(const Tick<SlaveClock>& tick) noexcept override {
    if (started_) {
      unheard_ = unheard_ + tick.ended;
      if (unheard_ > std::max(kWatchdog, 1.5 * tick.dt)) release();
      world_.advance(tick.ended, tick.dt);
    }
    dt_ = tick.dt;
    const Force<N> on_robot{of_axes(world_.contact_wrench())};
    truth_ = {.f_environment = on_robot, .touches = world_.touches()};
    RobotSample<N> sample;
    sample.x = position();
    sample.v = Velocity<N>{of_axes(world_.velocity())};
    if (body_) {
      tool_ = sample.x;
      sample.x = body_->x();
      sample.v = body_->v();
      felt_ = -on_robot;
    }
    sample.f_environment = -on_robot;
    if (world_.lost() != nullptr) sample.status = HardwareStatus::fault;
    return sample;
  }
  void actuate(const RobotCommand<N>& command) noexcept override {
    unheard_ = Seconds{0.0};
    if (body_) {
      body_->step(command.f, felt_ - command.not_of_environment, dt_);
      return world_.want < N == 6 ? 6 : 3 > (pose_of(body_->x()));
    }
    Vector6 wrench = Vector6::Zero();
    if constexpr (N == 1)
      wrench.head<3>() = command.f[0] * axis_;
    else
      wrench.head<N>() = command.f.vec();
    world_.push(wrench);
  }
  void start() noexcept override { started_ = true; }
  void release() noexcept override {
    world_.push(Vector6::Zero());
    if (body_) body_->stop();
  }
  [[nodiscard]] std::string trouble() const override {
    const char* const why = world_.lost();
    return why != nullptr ? why : "";
  }
  [[nodiscard]] const RobotTruth<N>* truth() const noexcept override { return &truth_; }
  [[nodiscard]] const Position<N>* tool() const noexcept override { return body_ ? &tool_ : nullptr; }

  [[nodiscard]] std::unique_ptr<VirtualRobot<N>> copy() const override { return std::make_unique<MujocoRobot>(*this); }
  void kick(const Velocity<N>& dv) noexcept override {
    if (body_) return body_->kick(dv);
    const Eigen::MatrixXd J = world_.jacobian();
    if constexpr (N == 1)
      world_.kick(axis_.transpose() * J.topRows<3>(), dv.vec());
    else
      world_.kick(J.topRows<N>(), dv.vec());
  }
  [[nodiscard]] WorldPicture picture() const override { return world_.picture(); }
  [[nodiscard]] std::string fingerprint() const override { return arguments_ + world_.bytes(); }

 private:
  [[nodiscard]] Eigen::Matrix<double, N, 1> of_axes(const Vector6& all) const noexcept {
    if constexpr (N == 1)
      return Eigen::Matrix<double, 1, 1>{axis_.dot(all.head<3>())};
    else
      return all.head<N>();
  }

  [[nodiscard]] Position<N> position() const noexcept {
    if constexpr (N == 6)
      return Position<6>{world_.point(), world_.attitude()};
    else if constexpr (N == 3)
      return Position<3>{world_.point()};
    else
      return Position<1>{Position<1>::Vector{axis_.dot(world_.point())}};
  }
  /// Of the tool; what the port has not is as at the start.
  [[nodiscard]] Eigen::Isometry3d pose_of(const Position<N>& x) const noexcept {
    Eigen::Isometry3d pose = start_;
    if constexpr (N == 6) {
      pose = Eigen::Translation3d{x.translation()} * x.attitude();
    } else if constexpr (N == 3) {
      pose.translation() = x.translation();
    } else {
      pose.translation() += (x.translation()[0] - axis_.dot(start_.translation())) * axis_;
    }
    return pose;
  }

  std::string arguments_;
  World world_;
  std::optional<Admittance<N>> body_;  ///< in place of a tool that set points move
  Eigen::Isometry3d start_ = Eigen::Isometry3d::Identity();
  Force<N> felt_;
  Seconds dt_{};
  Vector3d axis_ = Vector3d::UnitX();
  RobotTruth<N> truth_;
  Position<N> tool_;   ///< where a body stands in its place
  Seconds unheard_{};  ///< since the last command
  bool started_ = false;
};

}  // namespace

void add_mujoco(Registry& all) {
  all.robots.add<MujocoRobot>(
      "mujoco",
      "mujoco:FILE.xml[,site=NAME][,key=NAME][,actuators=off], a tool in a world of MuJoCo, driven by forces; by set "
      "points where position servos or a weld to a mocap body move it");
}

}  // namespace twoport
