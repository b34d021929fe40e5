#include "common/scene/arm.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/scene/find.h"
#include "common/scene/reader.h"
#include "common/scene/text.h"
#include "proto/arm.pb.h"

namespace twoport {

#ifndef TWOPORT_URDF
[[noreturn]] static void refuse_urdf(const std::string& file) {
  throw ConfigError{file + ": this build reads no URDF: liburdfdom was missing (Debian package liburdfdom-dev)"};
}
ArmParameters read_urdf(const std::string&, const std::string& file, const std::string&) {
  refuse_urdf(file);
}
ShownArm read_urdf_shapes(const std::string&, const std::string& file, const std::string&) {
  refuse_urdf(file);
}
#endif

namespace {

Eigen::Matrix3d rotation_rpy(const List& rpy) {
  const Eigen::Vector3d r = vector<3>(rpy);
  return (Eigen::AngleAxisd{r.z(), Eigen::Vector3d::UnitZ()} * Eigen::AngleAxisd{r.y(), Eigen::Vector3d::UnitY()} *
          Eigen::AngleAxisd{r.x(), Eigen::Vector3d::UnitX()})
      .toRotationMatrix();
}

Eigen::Matrix3d read_inertia(const Block<schema::ArmJoint>& of) {
  const List& n = of->inertia_kg_m2();
  Eigen::Matrix3d inertia = vector<3>(n).asDiagonal();
  if (n.size() == 6) {
    inertia(0, 1) = inertia(1, 0) = n[3];
    inertia(0, 2) = inertia(2, 0) = n[4];
    inertia(1, 2) = inertia(2, 1) = n[5];
  }
  if (const std::string words = inertia_fault(inertia); !words.empty()) of.refuse(FIELD(inertia_kg_m2), words);
  return inertia;
}

ArmJoint read_joint(const Block<schema::ArmJoint>& of) {
  ArmJoint joint{.origin_m = vector<3>(of->origin_m()),
                 .rotation = rotation_rpy(of->rotation_rpy_rad()),
                 .mass_kg = of->mass_kg(),
                 .center_m = vector<3>(of->center_m()),
                 .inertia = read_inertia(of),
                 .rotor_inertia_kg_m2 = of->rotor_inertia_kg_m2(),
                 .max_torque_n_m = of->max_torque_n_m(),
                 .max_speed_rad_per_s = of->max_speed_rad_per_s(),
                 .lower_rad = of->lower_rad(),
                 .upper_rad = of->upper_rad()};
  if (!(joint.lower_rad < joint.upper_rad))
    of.refuse(FIELD(upper_rad), fmt::format("be > lower_rad, which is {}", joint.lower_rad));
  return joint;
}

ArmParameters load_urdf(const std::string& path, const std::string& tip) {
  return read_urdf(read_text(path), path, tip);
}
schema::ArmParameters parse_arm(const std::string& path) {
  schema::ArmParameters message;
  const std::string text = read_text(path);
  if (text.starts_with('<'))
    throw ConfigError{
        path + ": this is XML; a URDF's name ends in .urdf, and macros are expanded first: xacro FILE > FILE.urdf"};
  if (const auto error = parse_text(text, message))
    throw ConfigError{fmt::format("{}:{}: {}", path, error->place, error->sentence)};
  return message;
}

/// The joints of a URDF and what it cannot say.
ArmParameters read_described(const Block<schema::ArmParameters>& of, const std::string& tip) {
  const auto refuse_beside = [&](const auto&... fields) {
    const auto refuse = [&](const auto& field) {
      if (of.has(field)) of.fail(fmt::format("{} is given, but so is urdf, which has it", field.name));
    };
    (refuse(fields), ...);
  };
  refuse_beside(FIELD(joint), FIELD(flange_m), FIELD(flange_rotation_rpy_rad));
  ArmParameters arm = load_urdf(file_beside(of.context().file, of->urdf()), tip.empty() ? of->tip() : tip);
  of.need_length(FIELD(joint_rotor_inertia_kg_m2), static_cast<int>(arm.joints.size()));
  const Numbers rotors = numbers(of->joint_rotor_inertia_kg_m2());
  for (std::size_t i = 0; i < rotors.size(); ++i) arm.joints[i].rotor_inertia_kg_m2 = rotors[i];
  if (of->has_name()) arm.name = of->name();
  return arm;
}
ArmParameters read_joints(const Block<schema::ArmParameters>& of, const std::string& tip) {
  if (of->has_tip() || !tip.empty())
    of.fail(fmt::format("the tip \"{}\" is named, but only links of a URDF have names", tip.empty() ? of->tip() : tip));
  if (of.has(FIELD(joint_rotor_inertia_kg_m2)))
    of.fail("joint_rotor_inertia_kg_m2 is given without urdf; each joint has its rotor_inertia_kg_m2");
  ArmParameters arm;
  arm.name = of->name();
  for (const auto& each : of.blocks(FIELD(joint))) {
    arm.joints.push_back(read_joint(each));
    arm.joints.back().name = fmt::format("joint {}", arm.joints.size());
  }
  if (arm.joints.empty()) of.fail("joint is given 0 times; an arm must have 6 or 7 joints");
  arm.flange_m = vector<3>(of->flange_m());
  arm.flange_rotation = rotation_rpy(of->flange_rotation_rpy_rad());
  return arm;
}

}  // namespace

std::string inertia_fault(const Eigen::Matrix3d& inertia, double rounding) {
  const Eigen::Vector3d moments = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>{inertia}.eigenvalues();
  if (!(moments[0] > -rounding)) return "be positive definite";
  // Identified parameters miss it by rounding; by more they belong to no body.
  if (moments[2] > 1.05 * (moments[0] + moments[1]) + rounding)
    return "keep the triangle inequality: no principal moment exceeds the sum of the other two by more than 5 %";
  return {};
}

ArmParameters load_arm(const std::string& path, const std::string& tip) {
  if (path.ends_with(".urdf")) return load_urdf(path, tip);
  const schema::ArmParameters message = parse_arm(path);
  const Context context{.file = path, .dof = 6};
  const Block of{context, message};
  of.check_fields();
  ArmParameters arm = message.has_urdf() ? read_described(of, tip) : read_joints(of, tip);
  arm.source.assign(message.source().begin(), message.source().end());
  const auto joints = static_cast<int>(arm.joints.size());
  of.require(FIELD(ready_position_rad), fmt::format("hold {} numbers", joints));
  of.need_length(FIELD(ready_position_rad), joints);
  arm.ready_position_rad = numbers(of->ready_position_rad());
  for (std::size_t i = 0; i < arm.joints.size(); ++i)
    if (!(arm.ready_position_rad[i] >= arm.joints[i].lower_rad && arm.ready_position_rad[i] <= arm.joints[i].upper_rad))
      of.refuse(FIELD(ready_position_rad),
                fmt::format("lie within the joints' limits; number {} must be between {} and {}", i + 1,
                            arm.joints[i].lower_rad, arm.joints[i].upper_rad));
  return arm;
}

ShownArm load_arm_shapes(const std::string& path) {
  if (path.ends_with(".urdf")) return read_urdf_shapes(read_text(path), path, "");
  const schema::ArmParameters message = parse_arm(path);
  if (!message.has_urdf()) return {};
  const std::string urdf = file_beside(path, message.urdf());
  return read_urdf_shapes(read_text(urdf), urdf, message.tip());
}

}  // namespace twoport
