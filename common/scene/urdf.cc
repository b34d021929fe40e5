#include <console_bridge/console.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <urdf_parser/urdf_parser.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <boost/algorithm/string/case_conv.hpp>
#include <boost/property_tree/xml_parser.hpp>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <mutex>
#include <numbers>
#include <set>
#include <sstream>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/text.h"
#include "common/mesh/triangle_mesh.h"
#include "common/scene/arm.h"

namespace twoport {
namespace {

using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;
constexpr double kUnlimited = std::numeric_limits<double>::infinity();

/// Takes what the parser would print, for one thread at a time.
class Complaints final : public console_bridge::OutputHandler {
 public:
  Complaints() : lock_{one_at_a_time()}, before_{console_bridge::getOutputHandler()} {
    console_bridge::useOutputHandler(this);
  }
  ~Complaints() override { console_bridge::useOutputHandler(before_); }
  Complaints(const Complaints&) = delete;
  Complaints& operator=(const Complaints&) = delete;

  void log(const std::string& text, console_bridge::LogLevel level, const char*, int) override {
    if (level == console_bridge::CONSOLE_BRIDGE_LOG_ERROR && first_.empty()) first_ = text;
  }
  [[nodiscard]] const std::string& first() const { return first_; }

 private:
  static std::mutex& one_at_a_time() {
    static std::mutex mutex;
    return mutex;
  }
  std::lock_guard<std::mutex> lock_;
  console_bridge::OutputHandler* before_;
  std::string first_;
};

/// A URDF's text, for the places of errors.
struct Text {
  const std::string &text, &file;

  /// 0: not found.
  [[nodiscard]] long line_of(std::string_view element, std::string_view name) const {
    const std::string open = fmt::format("<{}", element);
    for (std::size_t at = text.find(open); at != text.npos; at = text.find(open, at + 1)) {
      const std::string_view tag = std::string_view{text}.substr(at, text.find('>', at) - at);
      if (tag.find(fmt::format("name=\"{}\"", name)) != tag.npos ||
          tag.find(fmt::format("name='{}'", name)) != tag.npos)
        return 1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n');
    }
    return 0;
  }
  /// Of the first attribute of this name whose value is no number; 0: there is none.
  [[nodiscard]] long line_of_no_number(std::string_view attribute) const {
    static const std::set<std::string_view> kNumbers{"ixx",      "iyy",     "izz",     "ixy",   "ixz",
                                                     "iyz",      "value",   "lower",   "upper", "effort",
                                                     "velocity", "damping", "friction"};
    if (!kNumbers.contains(attribute)) return 0;
    const std::string open = fmt::format("{}=", attribute);
    for (std::size_t at = text.find(open); at != text.npos; at = text.find(open, at + 1)) {
      const std::size_t from = at + open.size() + 1, to = text.find(text[from - 1], from);
      if (to == text.npos) return 0;
      const std::string_view value = trimmed(std::string_view{text}.substr(from, to - from));
      if (!number_from<double>(value.starts_with('+') ? value.substr(1) : value))
        return 1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n');
    }
    return 0;
  }
  /// Of the first attribute with this word, which is no number; 0: there is none.
  [[nodiscard]] long line_of_value(std::string_view word) const {
    constexpr std::string_view kAround = " \t\r\n'\"";
    if (word.empty() || number_from<double>(word)) return 0;
    for (std::size_t at = text.find(word, 1); at != text.npos; at = text.find(word, at + 1))
      if (const std::size_t end = at + word.size();
          end < text.size() && kAround.find(text[at - 1]) != kAround.npos && kAround.find(text[end]) != kAround.npos)
        return 1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n');
    return 0;
  }
  [[noreturn]] void fail(long line, const std::string& words) const {
    throw ConfigError{line > 0 ? fmt::format("{}:{}: {}", file, line, words) : fmt::format("{}: {}", file, words)};
  }
  template <class... Values>
  [[noreturn]] void fail_joint(const std::string& name, fmt::format_string<Values...> words, Values&&... values) const {
    fail(line_of("joint", name),
         fmt::format("joint \"{}\" {}", name, fmt::format(words, std::forward<Values>(values)...)));
  }
  template <class... Values>
  [[noreturn]] void fail_link(const std::string& name, fmt::format_string<Values...> words, Values&&... values) const {
    fail(line_of("link", name),
         fmt::format("link \"{}\" {}", name, fmt::format(words, std::forward<Values>(values)...)));
  }
};

/// The file, where `with_shapes` is false without them: blank, so that lines stay. Refuses what keeps the parsers too long, which call
/// themselves for each level and look through all links for each.
std::string checked(const Text& of, bool with_shapes) {
  constexpr int kDeepest = 100, kMostLinks = 2000;
  const std::string_view all = of.text;
  std::string text = of.text;
  int depth = 0, links = 0, depth_of_shape = -1;
  for (std::size_t at = all.find('<'), shape = 0, end = 0; at != all.npos; at = all.find('<', end)) {
    const std::string_view rest = all.substr(at);
    bool is_tag = true;
    for (const auto& [begins, ends] : {std::pair{"<!--", "-->"}, {"<![CDATA[", "]]>"}, {"<?", "?>"}, {"<!", ">"}})
      if (is_tag && rest.starts_with(begins)) {
        is_tag = false;
        end = all.find(ends, at);
      }
    if (!is_tag && end == all.npos) break;
    if (!is_tag) continue;
    char quote = 0;
    for (end = at; end < all.size() && (quote != 0 || all[end] != '>'); ++end)
      quote = quote == 0 && (all[end] == '"' || all[end] == '\'') ? all[end] : all[end] == quote ? char{0} : quote;
    if (end == all.size()) break;
    const bool closes = rest.starts_with("</"), opens = !closes && all[end - 1] != '/';
    const std::string_view tag = rest.substr(closes ? 2 : 1), name = tag.substr(0, tag.find_first_of(" \t\r\n/>"));
    if (!closes && depth_of_shape < 0 && (name == "visual" || name == "collision")) shape = at, depth_of_shape = depth;
    depth += opens ? 1 : closes ? -1 : 0;
    links += !closes && name == "link";
    if (depth < 0) break;
    if (depth > kDeepest) of.fail(0, fmt::format("has elements in more than {} levels", kDeepest));
    if (links > kMostLinks) of.fail(0, fmt::format("has more than {} links", kMostLinks));
    if (depth != depth_of_shape) continue;
    depth_of_shape = -1;
    if (!with_shapes)
      for (std::size_t i = shape; i <= end; ++i)
        if (text[i] != '\n') text[i] = ' ';
  }
  return text;
}

/// What a file that the parser refuses has wrong.
[[noreturn]] void explain(const Text& of, const std::string& complaint) {
  try {
    std::istringstream in{of.text};
    boost::property_tree::ptree tree;
    boost::property_tree::read_xml(in, tree);
  } catch (const boost::property_tree::xml_parser_error& e) {
    of.fail(static_cast<long>(e.line()), fmt::format("no well-formed XML: {}", e.message()));
  }
  if (of.text.find("<xacro:") != of.text.npos)
    of.fail(0, "these are macros; expand them first: xacro FILE.xacro > FILE.urdf");
  if (complaint.find("No root link") != complaint.npos)
    of.fail(0, "no one link is the root, the child of no joint; an arm has one, and no loops");
  // The parser puts names in brackets or quotes, or names an attribute whose value is no number.
  long line = 0;
  std::istringstream words{complaint};
  for (std::string word; line == 0 && words >> word;) line = of.line_of_no_number(word);
  for (std::size_t at = complaint.find_first_of("['\""); line == 0 && at != complaint.npos;
       at = complaint.find_first_of("['\"", at + 1)) {
    const std::string name = complaint.substr(at + 1, complaint.find_first_of("]'\"", at + 1) - at - 1);
    line = std::max({of.line_of("joint", name), of.line_of("link", name), of.line_of_value(name)});
  }
  of.fail(line, complaint.empty() ? std::string{"no URDF: it has no element <robot>"} : complaint);
}

urdf::ModelInterfaceSharedPtr parse(const Text& of, bool with_shapes) {
  const std::string text = checked(of, with_shapes);
  std::string complaint;
  urdf::ModelInterfaceSharedPtr model;
  {
    const Complaints complaints;
    try {
      model = urdf::parseURDF(text);
    } catch (const std::exception& e) {
      complaint = e.what();
    }
    if (!complaints.first().empty()) complaint = complaints.first();
  }
  // Some errors are only said: the parser then leaves a part out.
  if (!model || !complaint.empty()) explain(of, complaint);
  return model;
}

/// Each link hangs on one joint at most, and on the root.
void check_tree(const Text& of, const urdf::ModelInterface& model) {
  std::map<std::string, std::string> hangs_on;
  for (const auto& [name, joint] : model.joints_)
    if (const auto [other, first] = hangs_on.emplace(joint->child_link_name, name); !first)
      of.fail_joint(name, "and joint \"{}\" both move link \"{}\"; an arm has no loops", other->second,
                    joint->child_link_name);
  for (const auto& [name, link] : model.links_) {
    const urdf::Link* at = link.get();
    for (std::size_t steps = 0; at->parent_joint; ++steps) {
      if (steps > model.links_.size()) of.fail_link(name, "hangs on a loop of joints; an arm has no loops");
      at = model.links_.at(at->parent_joint->parent_link_name).get();
    }
  }
}

std::string tip_of(const Text& of, const urdf::ModelInterface& model, const std::string& wanted) {
  std::vector<std::string> all, leaves, moved;
  const auto is_moved = [&](const urdf::Link* at) {
    for (; at->parent_joint; at = model.links_.at(at->parent_joint->parent_link_name).get())
      if (at->parent_joint->type != urdf::Joint::FIXED) return true;
    return false;
  };
  for (const auto& [name, link] : model.links_) {
    all.push_back(name);
    if (!link->child_links.empty()) continue;
    leaves.push_back(name);
    if (is_moved(link.get())) moved.push_back(name);
  }
  // A frame at the base is no tip.
  if (!moved.empty()) leaves = moved;
  if (wanted.empty()) {
    if (leaves.size() == 1) return leaves[0];
    of.fail(0, fmt::format("{} links have no children: {}; name the tip by --tip, or by tip in a file beside the URDF",
                           leaves.size(), fmt::join(leaves, ", ")));
  }
  if (!model.links_.contains(wanted))
    of.fail(0, fmt::format("the tip is \"{}\", but there is no link of this name; did you mean {}?", wanted,
                           fmt::join(nearest_names(wanted, all, 3), ", ")));
  return wanted;
}

Isometry3d transform(const urdf::Pose& pose) {
  const urdf::Rotation& r = pose.rotation;
  Isometry3d T = Isometry3d::Identity();
  T.linear() = Eigen::Quaterniond{r.w, r.x, r.y, r.z}.normalized().toRotationMatrix();
  T.translation() << pose.position.x, pose.position.y, pose.position.z;
  return T;
}
Vector3d axis(const urdf::Joint& joint) {
  return Vector3d{joint.axis.x, joint.axis.y, joint.axis.z};
}

// ---- shapes

/// Where the file is that a URDF names: package://PACKAGE/REST in the folder PACKAGE that the URDF lies in, or in one beside a folder it
/// lies in; else REST, or its last part, beside the URDF.
std::string mesh_file(const std::string& named, const std::string& urdf) {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::path beside = fs::absolute(urdf, error).lexically_normal().parent_path();
  const std::size_t scheme = named.find("://");
  fs::path rest{scheme == named.npos ? named : named.substr(scheme + 3)};
  std::vector<fs::path> places;
  if (named.starts_with("package://") || named.starts_with("model://")) {
    const fs::path package = *rest.begin(), whole = rest;
    rest = rest.lexically_relative(package);
    for (fs::path above = beside; above.has_relative_path(); above = above.parent_path()) {
      if (above.filename() == package) places.push_back(above / rest);
      places.push_back(above / whole);
    }
  }
  places.insert(places.end(), {beside / rest, beside / rest.filename()});
  for (const fs::path& place : places)
    if (fs::is_regular_file(place, error)) return place.string();
  throw ConfigError{fmt::format("{}: no such file in a folder above {}, nor beside it", named, urdf)};
}

TriangleMesh mesh_of(const urdf::Mesh& mesh, const std::string& urdf) {
  const std::string ending = boost::to_lower_copy(std::filesystem::path{mesh.filename}.extension().string());
  if (ending != ".stl" && ending != ".obj") throw ConfigError{mesh.filename + " is neither STL nor OBJ"};
  const std::string path = mesh_file(mesh.filename, urdf);
  return parse_mesh(read_whole(path), path);
}

/// The shape in axes of the link; empty: one without a geometry.
TriangleMesh shape_of(const urdf::GeometrySharedPtr& geometry, const urdf::Pose& origin, const std::string& urdf) {
  if (!geometry) return {};
  TriangleMesh shape;
  Vector3d size = Vector3d::Ones();
  if (const auto* box = dynamic_cast<const urdf::Box*>(geometry.get())) {
    shape = unit_box();
    size << box->dim.x, box->dim.y, box->dim.z;
  } else if (const auto* cylinder = dynamic_cast<const urdf::Cylinder*>(geometry.get())) {
    shape = unit_cylinder();
    size << cylinder->radius, cylinder->radius, cylinder->length;
  } else if (const auto* sphere = dynamic_cast<const urdf::Sphere*>(geometry.get())) {
    shape = capsule(1.0, 0.0);
    size.setConstant(sphere->radius);
  } else if (const auto* mesh = dynamic_cast<const urdf::Mesh*>(geometry.get())) {
    shape = mesh_of(*mesh, urdf);
    size << mesh->scale.x, mesh->scale.y, mesh->scale.z;
    if (!(size.cwiseAbs().minCoeff() > 1e-9))
      throw ConfigError{
          fmt::format("{} has the scale {} {} {}; none may be 0", mesh->filename, size.x(), size.y(), size.z())};
  }
  TriangleMesh placed;
  append(placed, shape, transform(origin) * Eigen::Scaling(size));
  for (const Vector3d& v : placed.vertices)
    if (!(v.cwiseAbs().maxCoeff() <= 1e6))
      throw ConfigError{"a shape reaches beyond 1e6 m, or its numbers are not finite"};
  return placed;
}

/// Links that move as one.
struct Body {
  double mass = 0.0;
  Vector3d first = Vector3d::Zero();   ///< Σ m c
  Matrix3d second = Matrix3d::Zero();  ///< about the origin

  static Matrix3d of_point(double m, const Vector3d& c) {
    return m * (c.squaredNorm() * Matrix3d::Identity() - c * c.transpose());
  }
  void add(const Isometry3d& at, const urdf::Inertial& part) {
    const Isometry3d frame = at * transform(part.origin);
    Matrix3d inertia;
    inertia << part.ixx, part.ixy, part.ixz, part.ixy, part.iyy, part.iyz, part.ixz, part.iyz, part.izz;
    mass += part.mass;
    first += part.mass * frame.translation();
    second += frame.linear() * inertia * frame.linear().transpose() + of_point(part.mass, frame.translation());
  }
  [[nodiscard]] Vector3d center() const { return mass > 0.0 ? Vector3d{first / mass} : Vector3d::Zero(); }
  [[nodiscard]] Matrix3d inertia() const { return second - of_point(mass, center()); }
};

class ArmOfTree {
 public:
  ArmOfTree(const Text& of, const urdf::ModelInterface& model, const std::string& tip) : of_{of}, model_{model} {
    for (const urdf::Link* at = model.links_.at(tip).get(); at->parent_joint;
         at = model.links_.at(at->parent_joint->parent_link_name).get())
      path_.push_back(at->parent_joint.get());
    std::reverse(path_.begin(), path_.end());
    for (const urdf::Joint* joint : path_)
      if (joint->type != urdf::Joint::FIXED) moving_.insert(joint->name);
    if (moving_.empty()) of.fail_link(tip, "is the tip, but no joint moves it");
    if (moving_.size() > kMostArmJoints)
      of.fail_link(tip, "is the tip, and {} joints move it: {}; an arm must have 1 to {} joints", moving_.size(),
                   fmt::join(moving_, ", "), kMostArmJoints);
  }

  ArmParameters read() {
    ArmParameters arm;
    arm.name = model_.getName();
    Isometry3d since = Isometry3d::Identity();  // the last joint's frame from the present link
    for (const urdf::Joint* joint : path_) {
      since = since * transform(joint->parent_to_joint_origin_transform);
      if (joint->type == urdf::Joint::FIXED) continue;
      const Matrix3d z_to_axis = turned_to_axis(*joint);
      arm.joints.push_back(read_joint(*joint));
      ArmJoint& j = arm.joints.back();
      j.origin_m = since.translation();
      j.rotation = since.linear() * z_to_axis;
      since = Isometry3d::Identity();
      since.linear() = z_to_axis.transpose();
      Body body;
      for_each_carried(*model_.links_.at(joint->child_link_name), since,
                       [&](const auto& link, const auto& at) { add(link, at, body); });
      j.mass_kg = body.mass, j.center_m = body.center(), j.inertia = body.inertia();
      check(*joint, j);
    }
    arm.flange_m = since.translation();
    arm.flange_rotation = since.linear();
    return arm;
  }

  ShownArm shapes() const {
    ShownArm arm;
    const auto add_link = [&](const urdf::Link& first, const Isometry3d& from) {
      arm.links.emplace_back();
      for_each_carried(first, from, [&](const auto& link, const auto& at) { show(link, at, arm); });
    };
    add_link(*model_.getRoot(), Isometry3d::Identity());
    for (const urdf::Joint* joint : path_) {
      if (joint->type == urdf::Joint::FIXED) continue;
      Isometry3d from = Isometry3d::Identity();
      from.linear() = turned_to_axis(*joint).transpose();
      add_link(*model_.links_.at(joint->child_link_name), from);
    }
    return arm;
  }

 private:
  /// The frame of an arm's link has the joint's axis as z: the joint's frame from it.
  Matrix3d turned_to_axis(const urdf::Joint& joint) const {
    const Vector3d axis = checked_axis(joint);
    const bool down = axis.z() < 0.0;
    const Vector3d to = down ? Vector3d{-axis} : axis;
    // By half the angle from z to `to`, and where the axis points down by half a turn about x before.
    const Eigen::Quaterniond least = Eigen::Quaterniond{1.0 + to.z(), -to.y(), to.x(), 0.0}.normalized();
    return (down ? least * Eigen::Quaterniond{0.0, 1.0, 0.0, 0.0} : least).matrix();
  }
  Vector3d checked_axis(const urdf::Joint& joint) const {
    switch (joint.type) {
      case urdf::Joint::REVOLUTE:
      case urdf::Joint::CONTINUOUS:
      case urdf::Joint::PRISMATIC:
        break;
      case urdf::Joint::FLOATING:
        refuse_type(joint, "floating");
      case urdf::Joint::PLANAR:
        refuse_type(joint, "planar");
      default:
        refuse_type(joint, "of an unknown type");
    }
    if (joint.mimic)
      of_.fail_joint(joint.name, "mimics joint \"{}\"; each joint of an arm moves by itself", joint.mimic->joint_name);
    const Vector3d along = axis(joint);
    if (!along.allFinite() || !(along.norm() > 1e-6))
      of_.fail_joint(joint.name, "has the axis {} {} {}; it must have a direction", along.x(), along.y(), along.z());
    return along.normalized();
  }
  [[noreturn]] void refuse_type(const urdf::Joint& joint, const char* type) const {
    of_.fail_joint(joint.name, "is {}; an arm has revolute, continuous, prismatic and fixed joints", type);
  }

  ArmJoint read_joint(const urdf::Joint& joint) const {
    ArmJoint j{};
    j.name = joint.name;
    j.type = joint.type == urdf::Joint::REVOLUTE    ? JointType::revolute
             : joint.type == urdf::Joint::PRISMATIC ? JointType::prismatic
                                                    : JointType::continuous;
    j.max_effort = j.max_speed = j.upper = kUnlimited;
    j.lower = -kUnlimited;
    if (joint.limits) {
      j.max_effort = joint.limits->effort, j.max_speed = joint.limits->velocity;
      if (!(j.max_effort >= 0.0)) of_.fail_joint(joint.name, "has the effort {}; it must be >= 0", j.max_effort);
      if (!(j.max_speed >= 0.0)) of_.fail_joint(joint.name, "has the velocity {}; it must be >= 0", j.max_speed);
    }
    if (j.type != JointType::continuous) {
      if (!joint.limits) of_.fail_joint(joint.name, "has no <limit>; a joint without limits is continuous");
      j.lower = joint.limits->lower, j.upper = joint.limits->upper;
      if (!(j.lower < j.upper))
        of_.fail_joint(joint.name, "has the limits {} and {}; lower must be < upper", j.lower, j.upper);
    }
    if (joint.dynamics) {
      j.damping = joint.dynamics->damping;
      j.coulomb_friction = joint.dynamics->friction;
      for (const auto& [name, value] :
           {std::pair{"damping", joint.dynamics->damping}, {"friction", joint.dynamics->friction}})
        if (!(value >= 0.0 && value < kUnlimited))
          of_.fail_joint(joint.name, "has the {} {}; it must be >= 0", name, value);
    }
    return j;
  }

  /// Calls f(link, its place) for the link and all that is fixed to it or held.
  template <class F>
  void for_each_carried(const urdf::Link& link, const Isometry3d& at, const F& f) const {
    f(link, at);
    for (const auto& joint : link.child_joints)
      if (!moving_.contains(joint->name))
        for_each_carried(*model_.links_.at(joint->child_link_name),
                         at * transform(joint->parent_to_joint_origin_transform) * held(*joint), f);
  }
  void add(const urdf::Link& link, const Isometry3d& at, Body& body) const {
    if (!link.inertial) return;
    if (!(link.inertial->mass >= 0.0))
      of_.fail_link(link.name, "has the mass {}; it must be >= 0", link.inertial->mass);
    body.add(at, *link.inertial);
  }
  /// What is drawn of it, and what cannot be.
  void show(const urdf::Link& link, const Isometry3d& at, ShownArm& arm) const {
    const auto all = [&](const auto& shapes) {
      TriangleMesh mesh;
      for (const auto& each : shapes)
        append(mesh, shape_of(each->geometry, each->origin, of_.file), Eigen::Affine3d{at});
      return mesh;
    };
    const auto say = [&](const char* other, const ConfigError& e) {
      arm.left_out.push_back(fmt::format("Link \"{}\" is drawn {}: {}.", link.name, other, e.what()));
    };
    TriangleMesh mesh;
    try {
      mesh = all(link.visual_array);
    } catch (const ConfigError& e) {
      try {
        mesh = all(link.collision_array);
        say(mesh.triangles.empty() ? "without its shape" : "by its collision shape", e);
      } catch (const ConfigError&) {
        say("without its shape", e);
      }
    }
    append(arm.links.back(), mesh, Eigen::Affine3d::Identity());
  }
  Isometry3d held(const urdf::Joint& joint) const {
    Isometry3d T = Isometry3d::Identity();
    const double q = held_position(joint, 0);
    if (joint.type == urdf::Joint::REVOLUTE || joint.type == urdf::Joint::CONTINUOUS)
      T.linear() = Eigen::AngleAxisd{q, axis(joint).normalized()}.toRotationMatrix();
    else if (joint.type == urdf::Joint::PRISMATIC)
      T.translation() = q * axis(joint).normalized();
    return T;
  }
  double held_position(const urdf::Joint& joint, std::size_t depth) const {
    if (!joint.mimic) {
      const bool limited = joint.limits && joint.type != urdf::Joint::CONTINUOUS;
      return limited ? std::max(joint.limits->lower, std::min(0.0, joint.limits->upper)) : 0.0;
    }
    const std::string& name = joint.mimic->joint_name;
    const urdf::JointConstSharedPtr other = model_.getJoint(name);
    if (!other) of_.fail_joint(joint.name, "mimics joint \"{}\", which there is not", name);
    if (depth > model_.joints_.size())
      of_.fail_joint(joint.name, "mimics joint \"{}\"; each joint of an arm moves by itself", name);
    return joint.mimic->offset + joint.mimic->multiplier * held_position(*other, depth + 1);
  }

  void check(const urdf::Joint& joint, const ArmJoint& j) const {
    const std::string& link = joint.child_link_name;
    if (!j.origin_m.allFinite() || !j.rotation.allFinite())
      of_.fail_joint(joint.name, "has an origin that is not finite");
    if (!std::isfinite(j.mass_kg) || !j.center_m.allFinite() || !j.inertia.allFinite())
      of_.fail_link(link, "has an <inertial> that is not finite");
    if (!(j.mass_kg > 0.0))
      of_.fail_link(link,
                    "moves with joint \"{}\" and has no mass: neither it nor a link fixed to it has an <inertial>",
                    joint.name);
    if (const std::string words = inertia_fault(j.inertia, 1e-12); !words.empty())
      of_.fail_link(link, "has, with what is fixed to it, an inertia that must {}", words);
  }

  const Text& of_;
  const urdf::ModelInterface& model_;
  std::vector<const urdf::Joint*> path_;  ///< from the root
  std::set<std::string> moving_;
};

}  // namespace

ArmParameters read_urdf(const std::string& text, const std::string& file, const std::string& tip) {
  const Text of{text, file};
  const urdf::ModelInterfaceSharedPtr model = parse(of, false);
  check_tree(of, *model);
  return ArmOfTree{of, *model, tip_of(of, *model, tip)}.read();
}

ShownArm read_urdf_shapes(const std::string& text, const std::string& file, const std::string& tip) {
  const Text of{text, file};
  const urdf::ModelInterfaceSharedPtr model = parse(of, true);
  check_tree(of, *model);
  return ArmOfTree{of, *model, tip_of(of, *model, tip)}.shapes();
}

}  // namespace twoport
