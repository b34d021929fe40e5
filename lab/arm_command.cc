#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
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

constexpr std::size_t kMostJoints = 12;

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
std::string json(const ArmJoint& j) {
  const bool turns_for_ever = std::isinf(j.lower_rad) && std::isinf(j.upper_rad);
  return fmt::format(
      R"({{"name": {}, "type": "{}", "limits": {{"lower_rad": {}, "upper_rad": {}, "max_torque_n_m": {}, )"
      R"("max_speed_rad_per_s": {}}}, "rotor_inertia_kg_m2": {}, "damping_n_m_s_per_rad": {}, "coulomb_friction_n_m": {}}})",
      json_string(j.name), turns_for_ever ? "continuous" : "revolute", json(j.lower_rad), json(j.upper_rad),
      json(j.max_torque_n_m), json(j.max_speed_rad_per_s), json(j.rotor_inertia_kg_m2),
      j.damping_n_m_s_per_rad ? json(*j.damping_n_m_s_per_rad) : "null",
      j.coulomb_friction_n_m ? json(*j.coulomb_friction_n_m) : "null");
}

/// The given positions; absent: those of the file, or 0, or the middle of limits that leave 0 out.
Eigen::VectorXd positions(const ArmParameters& arm, const std::string& given) {
  const auto joints = static_cast<Eigen::Index>(arm.joints.size());
  if (!given.empty()) {
    std::vector<double> q;
    for (const std::string_view word : parts_of(given, ',')) {
      const std::optional<double> value = number_from<double>(word);
      if (!value || !std::isfinite(*value))
        throw ConfigError{
            fmt::format("--q {}: \"{}\" is no finite number; numbers in rad stand with commas between", given, word)};
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
  if (!arm.ready_position_rad.empty()) return Eigen::Map<const Eigen::VectorXd>{arm.ready_position_rad.data(), joints};
  Eigen::VectorXd q{joints};
  for (Eigen::Index i = 0; i < joints; ++i) {
    const ArmJoint& j = arm.joints[static_cast<std::size_t>(i)];
    q[i] = j.lower_rad <= 0.0 && j.upper_rad >= 0.0 ? 0.0 : 0.5 * (j.lower_rad + j.upper_rad);
  }
  return q;
}

template <int n>
void print(const ArmParameters& arm, const Eigen::VectorXd& at) {
  const ArmModel<n> model{arm};
  const auto pose = model.pose(at);
  Eigen::Quaterniond attitude{pose.tool_rotation};
  if (attitude.w() < 0.0) attitude.coeffs() = -attitude.coeffs();
  std::vector<std::string> joints;
  for (const ArmJoint& joint : arm.joints) joints.push_back(json(joint));
  fmt::print(
      "{{\n  \"name\": {},\n  \"q_rad\": {},\n  \"position_m\": {},\n  \"quaternion_wxyz\": {},\n  \"jacobian\": {},\n"
      "  \"mass_matrix\": {},\n  \"gravity_torque\": {},\n  \"joints\": [\n    {}\n  ]\n}}\n",
      json_string(arm.name), json(at), json(pose.tool),
      json(Eigen::Vector4d{attitude.w(), attitude.x(), attitude.y(), attitude.z()}), json_rows(model.jacobian(pose)),
      json_rows(model.inertia(pose)), json(model.gravity_torque(pose, sim::ArmPlant::kGravity)),
      fmt::join(joints, ",\n    "));
}
template <std::size_t... i>
void print_any(const ArmParameters& arm, const Eigen::VectorXd& at, std::index_sequence<i...>) {
  ((arm.joints.size() == i + 1 ? print<static_cast<int>(i + 1)>(arm, at) : void()), ...);
}

int arm_command(const Arguments& a) {
  const std::string file = arm_file(a.file);
  const ArmParameters arm = load_arm(file, a.tip);
  if (arm.joints.size() > kMostJoints)
    throw ConfigError{fmt::format("{}: has {} joints; at most {} are computed", file, arm.joints.size(), kMostJoints)};
  print_any(arm, positions(arm, a.q), std::make_index_sequence<kMostJoints>{});
  return 0;
}

}  // namespace

void add_arm_command(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<Arguments>();
  CLI::App& arm = *app.add_subcommand("arm", "Print kinematics and dynamics of an arm at one position, as JSON");
  arm.add_option("file", a->file, "Arm (.textproto or .urdf), or the name of an arm of the project")->required();
  arm.add_option("--tip", a->tip, "Link of a URDF that is the flange; absent: its only link without children");
  arm.add_option(
      "--q", a->q,
      "Positions of the joints [rad], q1,q2,...; absent: the file's ready position, or 0 where limits allow");
  arm.footer(
      R"(position_m and quaternion_wxyz of the flange in axes of the base, jacobian (translation first, axes of the base), mass_matrix
with rotors [kg m2], gravity_torque [N m] that holds the arm at rest, and for each joint name, type and limits; null: none.
An arm may have 1 to 12 joints here; in a scene it has 6 or 7.)");
  arm.callback([a, &chosen] { chosen = [a] { return arm_command(*a); }; });
}

}  // namespace twoport::lab
