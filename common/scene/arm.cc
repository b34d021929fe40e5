#include "common/scene/arm.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "common/arm/arm_model.h"
#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/base/file.h"
#include "common/mesh/triangle_mesh.h"
#include "common/scene/blocks.h"
#include "common/scene/find.h"
#include "common/scene/reader.h"
#include "common/scene/shown.h"
#include "common/scene/source.h"
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

constexpr double kUnlimited = std::numeric_limits<double>::infinity();
static_assert(same_number(JointType::revolute, schema::REVOLUTE) &&
              same_number(JointType::continuous, schema::CONTINUOUS) &&
              same_number(JointType::prismatic, schema::PRISMATIC));

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
  const bool slides = of->type() == schema::PRISMATIC, limited = of->type() != schema::CONTINUOUS;
  const auto refuse_unless = [&](bool belongs, const auto&... fields) {
    const auto refuse = [&](const auto& field) {
      if (!belongs && of.has(field))
        of.refuse(field, fmt::format("be absent: the joint is {}", schema::JointType_Name(of->type())));
    };
    (refuse(fields), ...);
  };
  const auto require_if = [&](bool belongs, const auto&... fields) {
    refuse_unless(belongs, fields...);
    if (belongs) (of.require(fields), ...);
  };
  refuse_unless(!slides, FIELD(rotor_inertia_kg_m2));
  refuse_unless(slides, FIELD(rotor_mass_kg), FIELD(mirrored));
  require_if(!slides, FIELD(max_torque_n_m), FIELD(max_speed_rad_per_s));
  require_if(slides, FIELD(max_force_n), FIELD(max_speed_m_per_s), FIELD(lower_m), FIELD(upper_m));
  require_if(!slides && limited, FIELD(lower_rad), FIELD(upper_rad));
  ArmJoint joint{.origin_m = vector<3>(of->origin_m()),
                 .rotation = rotation_rpy(of->rotation_rpy_rad()),
                 .mass_kg = of->mass_kg(),
                 .center_m = vector<3>(of->center_m()),
                 .inertia = read_inertia(of),
                 .rotor_inertia = slides ? of->rotor_mass_kg() : of->rotor_inertia_kg_m2(),
                 .max_effort = slides ? of->max_force_n() : of->max_torque_n_m(),
                 .max_speed = slides ? of->max_speed_m_per_s() : of->max_speed_rad_per_s(),
                 .lower = -kUnlimited,
                 .upper = kUnlimited,
                 .type = static_cast<JointType>(of->type()),
                 .mirrored = of->mirrored()};
  const auto limit = [&](double lower, const auto& upper, const char* unit) {
    joint.lower = lower, joint.upper = upper.value(of.message());
    if (!(joint.lower < joint.upper)) of.refuse(upper, fmt::format("be > lower_{}, which is {}", unit, joint.lower));
  };
  if (slides)
    limit(of->lower_m(), FIELD(upper_m), "m");
  else if (limited)
    limit(of->lower_rad(), FIELD(upper_rad), "rad");
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
  for (std::size_t i = 0; i < rotors.size(); ++i) arm.joints[i].rotor_inertia = rotors[i];
  of.need_length(FIELD(joint_max_torque_n_m), static_cast<int>(arm.joints.size()));
  const Numbers torques = numbers(of->joint_max_torque_n_m());
  for (std::size_t i = 0; i < torques.size(); ++i) arm.joints[i].max_effort = torques[i];
  if (of->has_name()) arm.name = of->name();
  return arm;
}
ArmParameters read_joints(const Block<schema::ArmParameters>& of, const std::string& tip) {
  if (of->has_tip() || !tip.empty())
    of.fail(fmt::format("the tip \"{}\" is named, but only links of a URDF have names", tip.empty() ? of->tip() : tip));
  if (of.has(FIELD(joint_rotor_inertia_kg_m2)))
    of.fail("joint_rotor_inertia_kg_m2 is given without urdf; each joint has its rotor_inertia_kg_m2");
  if (of.has(FIELD(joint_max_torque_n_m)))
    of.fail("joint_max_torque_n_m is given without urdf; each joint has its max_torque_n_m");
  ArmParameters arm;
  arm.name = of->name();
  for (const auto& each : of.blocks(FIELD(joint))) {
    arm.joints.push_back(read_joint(each));
    arm.joints.back().name = fmt::format("joint {}", arm.joints.size());
  }
  if (arm.joints.empty() || arm.joints.size() > kMostArmJoints)
    of.fail(fmt::format("joint is given {} times; an arm must have 1 to {} joints", arm.joints.size(), kMostArmJoints));
  for (std::size_t i = 0; i < arm.joints.size(); ++i)
    if (arm.joints[i].mirrored && (i == 0 || i + 1 < arm.joints.size()))
      of.fail(
          fmt::format("joint[{}].mirrored is true; it must be false of every joint but the last of two or more", i));
  arm.flange_m = vector<3>(of->flange_m());
  arm.flange_rotation = rotation_rpy(of->flange_rotation_rpy_rad());
  return arm;
}

}  // namespace

std::string inertia_fault(const Eigen::Matrix3d& inertia, double rounding) {
  const Eigen::Vector3d moments = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>{inertia}.eigenvalues();
  if (!(moments[0] > -rounding))
    return fmt::format("be positive definite: no principal moment is below 0, and one is {:.3g} kg m²", moments[0]);
  // Identified parameters miss it by rounding; by more they belong to no body.
  const double sum = moments[0] + moments[1];
  if (moments[2] > 1.05 * sum + rounding)
    return fmt::format(
        "keep the triangle inequality: no principal moment exceeds the sum of the other two by more than 5 %, and "
        "{:.4g} exceeds {:.4g} + {:.4g} kg m² by {:.3g} %",
        moments[2], moments[0], moments[1], 100.0 * (moments[2] / sum - 1.0));
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
  of.need_length(FIELD(ready_position_rad), joints);
  arm.ready_position = numbers(of->ready_position_rad());
  for (std::size_t i = 0; i < arm.ready_position.size(); ++i)
    if (!(arm.ready_position[i] >= arm.joints[i].lower && arm.ready_position[i] <= arm.joints[i].upper))
      of.refuse(FIELD(ready_position_rad),
                fmt::format("lie within the joints' limits; number {} must be between {} and {}", i + 1,
                            arm.joints[i].lower, arm.joints[i].upper));
  return arm;
}

ShownArm load_arm_shapes(const std::string& path) {
  if (path.ends_with(".urdf")) return read_urdf_shapes(read_text(path), path, "");
  const schema::ArmParameters message = parse_arm(path);
  if (!message.has_urdf()) return {};
  const std::string urdf = file_beside(path, message.urdf());
  return read_urdf_shapes(read_text(urdf), urdf, message.tip());
}

namespace {

/// Damping, friction and rotors of the joints: the scene's where it gives them, else the file's.
void complete(const Block<schema::Arm>& of, const std::string& path, ArmParameters& parameters) {
  const auto joints = static_cast<int>(parameters.joints.size());
  if (joints < 6 && !of.context().joints)
    of.fail(fmt::format("{}: an arm must have 6 to {} joints, or the scene space JOINTS; this one has {}", path,
                        kMostArmJoints, joints));
  const Numbers friction = numbers(of->joint_coulomb_friction_n_m());
  of.need_length(FIELD(joint_coulomb_friction_n_m), joints);
  if (!std::ranges::all_of(friction, [](double f) { return f >= 0.0; }))
    of.refuse(FIELD(joint_coulomb_friction_n_m), "be >= 0 each");
  for (std::size_t i = 0; i < parameters.joints.size(); ++i) {
    ArmJoint& joint = parameters.joints[i];
    if (of->has_joint_damping_n_m_s_per_rad() || !joint.damping) joint.damping = of->joint_damping_n_m_s_per_rad();
    if (!friction.empty()) joint.coulomb_friction = friction[i];
    const auto refuse = [&](const char* what, double value, const char* words) {
      of.fail(fmt::format("{}: joint \"{}\" has the {} {}; in a scene it must be {}", path, joint.name, what, value,
                          words));
    };
    if (*joint.damping > 300.0) refuse("damping", *joint.damping, "at most 300");
    if (!(joint.max_effort > 0.0))
      refuse("effort", joint.max_effort, "> 0: give joint_max_torque_n_m in a file beside the URDF that names it");
    if (const std::string words = inertia_fault(joint.inertia); !words.empty())
      of.fail(fmt::format("{}: the link behind joint \"{}\" has an inertia that must {}", path, joint.name, words));
  }
}

}  // namespace

ArmSpec read_arm(const Block<schema::Arm>& of) {
  of.require(FIELD(file), "be the path of a file");
  if (of->file().empty()) of.refuse(FIELD(file), "be the path of a file");
  const std::string path = arm_file(of->file(), std::filesystem::path{of.context().file}.parent_path().string());
  const auto parameters = std::make_shared<ArmParameters>(load_arm(path));
  complete(of, path, *parameters);
  const int joints = static_cast<int>(parameters->joints.size());
  const auto feedback = of.block(FIELD(force_feedback));
  if (parameters->ready_position.empty())
    of.require(FIELD(joint_position_rad), fmt::format("hold {} numbers: the arm's file names none", joints));
  of.need_length(FIELD(joint_position_rad), joints);
  ArmSpec arm{.parameters = parameters,
              .joint_position_rad = numbers(of->joint_position_rad()),
              .null_space_stiffness_n_m_per_rad = of->null_space_stiffness_n_m_per_rad(),
              .null_space_damping_n_m_s_per_rad = of->null_space_damping_n_m_s_per_rad(),
              .joint_damping_n_m_s_per_rad = *parameters->joints[0].damping,
              .tool_mass_kg = of->tool_mass_kg(),
              .tool_center_m = numbers(of->tool_center_m()),
              .force_feedback_gain = feedback->gain(),
              .force_feedback_torque_gain = GIVEN(feedback, torque_gain).value_or(feedback->gain()),
              .force_feedback_cutoff_hz = feedback->has_cutoff_hz() ? feedback->cutoff_hz() : 0.0};
  // The least, from which the scene takes a lower bound of the damping at the tool.
  for (const ArmJoint& joint : parameters->joints) {
    arm.joint_damping_n_m_s_per_rad = std::min(arm.joint_damping_n_m_s_per_rad, *joint.damping);
    arm.joint_coulomb_friction_n_m.push_back(joint.coulomb_friction.value_or(0.0));
  }
  if (arm.joint_position_rad.empty()) arm.joint_position_rad = parameters->ready_position;
  for (std::size_t i = 0; i < arm.joint_position_rad.size(); ++i) {
    const ArmJoint& joint = parameters->joints[i];
    if (!(arm.joint_position_rad[i] > joint.lower && arm.joint_position_rad[i] < joint.upper))
      of.refuse(FIELD(joint_position_rad),
                fmt::format("lie within the joints' limits; number {} must be between {} and {}", i + 1, joint.lower,
                            joint.upper));
  }
  if (joints < 7 || of.context().joints) {
    const auto refuse = [&](const auto& field, const std::string& why) {
      if (of.has(field)) of.refuse(field, "be absent: " + why);
    };
    const std::string why = of.context().joints ? "with space JOINTS the coupling commands every joint"
                                                : fmt::format("an arm of {} joints has no null space", joints);
    refuse(FIELD(null_space_stiffness_n_m_per_rad), why);
    refuse(FIELD(null_space_damping_n_m_s_per_rad), why);
    if (of.context().joints) refuse(FIELD(force_feedback), why);
    arm.null_space_stiffness_n_m_per_rad = arm.null_space_damping_n_m_s_per_rad = 0.0;
  }
  return arm;
}

EffectiveInertia effective_inertia(const ArmSpec& arm) {
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  if constexpr (!built_for(6)) return {};
  const ArmTool tool{.mass_kg = arm.tool_mass_kg, .center_m = vector<3>(arm.tool_center_m)};
  const ArmModel::Joints q = joint_vector(arm.joint_position_rad);
  const ArmModel with_tool{*arm.parameters, tool};
  Matrix6 mobility = tool_mobility(with_tool, q);
  const double lighter = 1.0 + arm.force_feedback_gain, turns_lighter = 1.0 + arm.force_feedback_torque_gain;
  if (lighter > 1.0 || turns_lighter > 1.0) {
    const Matrix6 alone = tool_mobility(ArmModel{*arm.parameters}, q).inverse(), whole = mobility.inverse();
    Matrix6 felt = alone;
    felt.topLeftCorner<3, 3>() /= lighter;
    felt.bottomRightCorner<3, 3>() /= turns_lighter;
    felt.topRightCorner<3, 3>() /= std::sqrt(lighter * turns_lighter);
    felt.bottomLeftCorner<3, 3>() /= std::sqrt(lighter * turns_lighter);
    mobility = (felt + (whole - alone)).inverse();
  }
  const ArmModel::Jacobian J = with_tool.jacobian(with_tool.pose(q));
  const Matrix6 by_damping = J.lazyProduct(J.transpose());
  return {.mass_kg = 1.0 / largest_eigenvalue(mobility.topLeftCorner<3, 3>()),
          .inertia_kg_m2 = 1.0 / largest_eigenvalue(mobility.bottomRightCorner<3, 3>()),
          .damping_n_s_per_m =
              arm.joint_damping_n_m_s_per_rad / lighter / largest_eigenvalue(by_damping.topLeftCorner<3, 3>()),
          .rotational_damping_n_m_s_per_rad = arm.joint_damping_n_m_s_per_rad / turns_lighter /
                                              largest_eigenvalue(by_damping.bottomRightCorner<3, 3>())};
}

namespace {

/// What a mesh with few triangles does not need, those with many get.
void decimate_together(std::vector<TriangleMesh>& meshes) {
  std::vector<TriangleMesh*> all;
  for (TriangleMesh& mesh : meshes) all.push_back(&mesh);
  std::ranges::sort(all, {}, [](const TriangleMesh* mesh) { return mesh->triangles.size(); });
  std::size_t left = kMostShownTriangles;
  for (std::size_t i = 0; i < all.size(); ++i) {
    *all[i] = decimated(*all[i], left / (all.size() - i));
    left -= all[i]->triangles.size();
  }
}

}  // namespace

ShownArm shown_arm(const Scene& scene, bool of_leader) {
  if (!scene.source) return {};
  const schema::Scene& message = scene.source->message;
  if (!(of_leader ? message.device().has_arm() : message.robot().has_arm())) return {};
  const std::string& file = of_leader ? message.device().arm().file() : message.robot().arm().file();
  if (of_leader && file == message.robot().arm().file()) return {.links = {}, .left_out = {}, .as_robot = true};
  const std::string folder = std::filesystem::path{scene.source->file}.parent_path().string();
  ShownArm arm = load_arm_shapes(arm_file(file, folder));
  decimate_together(arm.links);
  return arm;
}

}  // namespace twoport
