#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/arm/arm_model.h"
#include "common/base/check.h"
#include "common/base/text.h"
#include "common/scene/arm.h"
#include "lab/cli/commands.h"
#include "lab/study/grid.h"
#include "sim/plant/arm.h"

namespace twoport::lab {
namespace {

struct Arguments {
  std::string file, tip, q;
};

/// "[1, 2]", in the fewest digits that give the same numbers back; null: not finite.
std::string json(double x) {
  return std::isfinite(x) ? fmt::format("{}", x + 0.0) : "null";
}
std::string json(const Eigen::VectorXd& v) {
  std::vector<std::string> all;
  for (const double each : v) all.push_back(json(each));
  return fmt::format("[{}]", fmt::join(all, ", "));
}
std::string json_rows(const Eigen::MatrixXd& m) {
  std::vector<std::string> rows;
  for (Eigen::Index i = 0; i < m.rows(); ++i) rows.push_back(json(Eigen::VectorXd{m.row(i).transpose()}));
  return fmt::format("[{}]", fmt::join(rows, ", "));
}
std::string json(const std::optional<double>& x) {
  return x ? json(*x) : "null";
}
std::string json(const ArmJoint& j) {
  static constexpr std::array<const char*, 3> kNames{"revolute", "continuous", "prismatic"};
  const bool slides = j.type == JointType::prismatic;
  const char *q = slides ? "m" : "rad", *effort = slides ? "force_n" : "torque_n_m",
             *rotor = slides ? "mass_kg" : "inertia_kg_m2", *friction = slides ? "n" : "n_m";
  return fmt::format(
      R"({{"name": {}, "type": "{}", "limits": {{"lower_{}": {}, "upper_{}": {}, "max_{}": {}, "max_speed_{}_per_s": {}}}, )"
      R"("rotor_{}": {}, "damping_{}_s_per_{}": {}, "coulomb_friction_{}": {}}})",
      json_string(j.name), kNames[static_cast<std::size_t>(j.type)], q, json(j.lower), q, json(j.upper), effort,
      json(j.max_effort), q, json(j.max_speed), rotor, json(j.rotor_inertia), friction, q, json(j.damping), friction,
      json(j.coulomb_friction));
}

/// The given positions; absent: those of the file, or 0, or the middle of limits that leave 0 out.
Eigen::VectorXd positions(const ArmParameters& arm, const std::string& given) {
  const auto joints = static_cast<Eigen::Index>(arm.joints.size());
  if (!given.empty()) {
    std::vector<double> q;
    for (const std::string_view word : parts_of(given, ',')) {
      const std::optional<double> value = number_from<double>(word);
      if (!value || !std::isfinite(*value))
        throw ConfigError{fmt::format(
            "--q {}: \"{}\" is no finite number; numbers in rad or m stand with commas between", given, word)};
      q.push_back(*value);
    }
    if (q.size() != arm.joints.size()) {
      std::vector<std::string_view> names;
      for (const ArmJoint& joint : arm.joints) names.push_back(joint.name);
      throw ConfigError{fmt::format("--q {} holds {} number{}; it must hold {}, of {}", given, q.size(),
                                    q.size() == 1 ? "" : "s", joints, fmt::join(names, ", "))};
    }
    return Eigen::Map<const Eigen::VectorXd>{q.data(), joints};
  }
  if (!arm.ready_position.empty()) return Eigen::Map<const Eigen::VectorXd>{arm.ready_position.data(), joints};
  Eigen::VectorXd q{joints};
  for (Eigen::Index i = 0; i < joints; ++i) {
    const ArmJoint& j = arm.joints[static_cast<std::size_t>(i)];
    q[i] = j.lower <= 0.0 && j.upper >= 0.0 ? 0.0 : 0.5 * (j.lower + j.upper);
  }
  return q;
}

void print(const ArmParameters& arm, const Eigen::VectorXd& at) {
  const ArmModel model{arm};
  const ArmModel::Pose pose = model.pose(at);
  Eigen::Quaterniond attitude{pose.tool_rotation};
  if (attitude.w() < 0.0) attitude.coeffs() = -attitude.coeffs();
  std::vector<std::string> joints;
  for (const ArmJoint& joint : arm.joints) joints.push_back(json(joint));
  fmt::print(
      "{{\n  \"name\": {},\n  \"q\": {},\n  \"position_m\": {},\n  \"quaternion_wxyz\": {},\n  \"jacobian\": {},\n"
      "  \"mass_matrix\": {},\n  \"gravity_torque\": {},\n  \"joints\": [\n    {}\n  ]\n}}\n",
      json_string(arm.name), json(at), json(pose.tool),
      json(Eigen::Vector4d{attitude.w(), attitude.x(), attitude.y(), attitude.z()}), json_rows(model.jacobian(pose)),
      json_rows(model.inertia(pose)), json(model.gravity_torque(pose, sim::ArmPlant::kGravity)),
      fmt::join(joints, ",\n    "));
}
int arm_command(const Arguments& a) {
  const ArmParameters arm = load_arm(arm_file(a.file), a.tip);
  print(arm, positions(arm, a.q));
  return 0;
}

}  // namespace

void add_arm_command(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<Arguments>();
  CLI::App& arm = *app.add_subcommand("arm", "Print kinematics and dynamics of an arm at one position, as JSON");
  arm.add_option("file", a->file, "Arm (.textproto or .urdf), or the name of an arm of the project")->required();
  arm.add_option("--tip", a->tip, "Link of a URDF that is the flange; absent: its only link without children");
  arm.add_option("--q", a->q,
                 "Positions of the joints [rad], prismatic [m], q1,q2,...; absent: the file's ready position, or 0 "
                 "where limits allow");
  arm.footer(
      R"(position_m and quaternion_wxyz of the flange in axes of the base, jacobian (translation first, axes of the base), mass_matrix
with rotors [kg m2], gravity_torque [N m] that holds the arm at rest, and for each joint name, type and limits; null: none.
Of prismatic joints m, kg and N stand for rad, kg m2 and N m. An arm may have 1 to 8 joints; in a scene it has 6 to 8.)");
  arm.callback([a, &chosen] { chosen = [a] { return arm_command(*a); }; });
}

}  // namespace twoport::lab
