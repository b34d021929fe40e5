#include "common/page/describe.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <iterator>
#include <string_view>
#include <type_traits>
#include <variant>
#include <vector>

#include "common/arm/parameters.h"
#include "common/base/text.h"
#include "common/contact/contact_law.h"
#include "common/page/channel.h"
#include "common/page/judge.h"
#include "common/safety/limits.h"
#include "common/scene/scene.h"
#include "common/scene/shown.h"

namespace twoport {
namespace {

/// Text that is JSON already.
struct Json {
  std::string text;
};
template <class Values, class Text>
Json list(const Values& values, Text text) {
  std::string out = "[";
  for (const auto& value : values) (out += out.size() > 1 ? "," : "") += text(value);
  return {out + "]"};
}
/// Numbers, texts, attitudes, and lists of them.
template <class T>
std::string json(const T& v) {
  if constexpr (std::is_same_v<T, Json>)
    return v.text;
  else if constexpr (std::is_same_v<T, double>)
    return std::isfinite(v) ? fmt::format("{:.9g}", v) : "null";
  else if constexpr (std::is_integral_v<T>)
    return fmt::format("{}", v);
  else if constexpr (std::is_convertible_v<T, std::string_view>)
    return json_string(v);
  else if constexpr (std::is_same_v<T, Eigen::Quaterniond>)
    return json(Eigen::Vector4d{v.w(), v.x(), v.y(), v.z()});
  else
    return list(v, json<std::decay_t<decltype(*std::begin(v))>>).text;
}
/// "NAME":VALUE,... of name, value, ...
template <class Value, class... Rest>
std::string fields(std::string_view name, const Value& value, const Rest&... rest) {
  std::string out = fmt::format("\"{}\":{}", name, json(value));
  if constexpr (sizeof...(rest) > 0) (out += ',') += fields(rest...);
  return out;
}
Json object(const auto&... name_and_value) {
  return {fmt::format("{{{}}}", fields(name_and_value...))};
}

struct Fields {
  std::string operator()(const Wall& s) const { return fields("normal", s.normal, "offset_m", s.offset_m); }
  std::string operator()(const Sphere& s) const { return fields("center_m", s.center_m, "radius_m", s.radius_m); }
  std::string operator()(const Cylinder& s) const {
    return fields("point_m", s.point_m, "axis", s.axis, "radius_m", s.radius_m);
  }
  std::string operator()(const Box& s) const { return fields("center_m", s.center_m, "half_size_m", s.half_size_m); }
  std::string operator()(const Torus& s) const {
    return fields("center_m", s.center_m, "axis", s.axis, "radius_m", s.radius_m, "tube_radius_m", s.tube_radius_m);
  }
  std::string operator()(const Capsule& s) const {
    return fields("start_m", s.start_m, "end_m", s.end_m, "radius_m", s.radius_m);
  }
  /// The corners of the profile; where it comes from infinity, from its first one on.
  std::string operator()(const Revolved& s) const {
    std::vector<Eigen::Vector2d> corners;
    for (const Profile::Segment& segment : s.profile->segments())
      if (std::isfinite(segment.from)) corners.push_back(segment.origin);
    corners.emplace_back(0.0, corners.back().y());
    return fields("point_m", s.point_m, "axis", s.axis, "profile_m", corners);
  }
  std::string operator()(const Plate& s) const {
    const Json holes = list(*s.holes, [](const PlateHole& h) {
      return json(Eigen::Vector3d{h.center_m.x(), h.center_m.y(), h.radius_m});
    });
    return fields("center_m", s.center_m, "attitude", Eigen::Quaterniond{s.rotation}, "half_size_m", s.half_size_m,
                  "holes_m", holes);
  }
  /// Its triangles stand apart.
  std::string operator()(const Mesh&) const { return fields("apart", true); }
  std::string operator()(const TriangleMesh& m) const {
    return fields(
        "vertices_m",
        list(m.vertices,
             [](const Eigen::Vector3d& v) { return fmt::format("{:.5g},{:.5g},{:.5g}", v.x(), v.y(), v.z()); }),
        "triangles",
        list(m.triangles, [](const TriangleMesh::Triangle& t) { return fmt::format("{},{},{}", t[0], t[1], t[2]); }));
  }
};
template <class Shape>
std::string part(const Shape& s) {
  const char* kind = Mesh::kName;
  if constexpr (!std::is_same_v<Shape, TriangleMesh>) kind = Shape::kName;
  return fmt::format("{{{},{}}}", fields("kind", kind), Fields{}(s));
}

Json arm(const ArmSpec& spec, const ShownArm& shown) {
  const ArmParameters& p = *spec.parameters;
  const auto joint = [](const ArmJoint& j) {
    return object("origin_m", j.origin_m, "attitude", Eigen::Quaterniond{j.rotation}, "slides",
                  j.type == JointType::prismatic, "mirrored", j.mirrored)
        .text;
  };
  return object("joints", list(p.joints, joint), "flange_m", p.flange_m, "links",
                shown.as_robot ? Json{"null"} : list(shown.links, part<TriangleMesh>), "left_out", shown.left_out);
}

std::string element(const EnvironmentSpec& spec) {
  if (const auto* surface = std::get_if<Surface>(&spec))
    return fmt::format("{{{},{}}}",
                       fields("kind", name(spec), "stiffness_n_per_m", surface->material.stiffness_n_per_m, "friction",
                              surface->material.friction),
                       std::visit(Fields{}, surface->shape));
  const auto& spring = std::get<Spring>(spec);
  return object("kind", name(spec), "stiffness_n_per_m", spring.stiffness_n_per_m, "anchor_m", spring.anchor_m).text;
}

Json network(double delay_ms, double jitter_ms, double loss) {
  return object("delay_ms", delay_ms, "jitter_ms", jitter_ms, "loss", loss);
}
Json network(const ImpairmentOptions& o) {
  return network(1e3 * o.delay_s, 1e3 * o.jitter_s, o.loss);
}

}  // namespace

std::string describe_for_page(const Scene& s, const PageIntroduction& i) {
  std::vector<Json> layout;
  PageSample sample;
  const bool joints = s.joints > 0;
  const auto field = [&](const char* name, std::size_t size, const double*) {
    layout.push_back({fmt::format("[{},{}]", json_string(name), size)});
  };
  for_each_page_field(sample, field, joints);
  // Where the handle's gripper starts: as far as the page opens it.
  Json gripper{"null"};
  if (s.gripper) {
    const bool placed = s.gripper->device && !s.gripper->device->position_m.empty();
    gripper.text = json(placed ? s.gripper->device->position_m[0] : 0.0);
  }
  std::array<std::string_view, kEnvironmentAnswers> answers;
  for (std::size_t a = 0; a < answers.size(); ++a) answers[a] = sentence(static_cast<EnvironmentAnswer>(a));
  std::array<std::string_view, kZeroAnswers> zero_answers;
  for (std::size_t a = 0; a < zero_answers.size(); ++a) zero_answers[a] = sentence(static_cast<ZeroAnswer>(a));
  const Eigen::Vector3d home = s.device ? vector<3>(s.device->position_m) : Eigen::Vector3d::Zero().eval();
  const Eigen::Vector3d robot_home = s.robot ? vector<3>(s.robot->position_m) : Eigen::Vector3d::Zero().eval();
  std::vector<int> without_motor;
  for (int axis = 0; axis < kJointPort; ++axis)
    if ((s.control.without_motor >> axis & 1) != 0) without_motor.push_back(axis);
  const ShownShapes shown = i.world ? *i.world : shown_shapes(s);
  const auto of_scene = [&](const Json& all) { return i.world ? Json{"[]"} : all; };
  const auto figure = [](const LayerFigure& f) {
    return fmt::format("[{},{},{}]", json(f.name), json(f.unit), f.least_dof);
  };
  const auto any_part = [](const auto& each) { return std::visit([](const auto& p) { return part(p); }, each); };
  return object("scene", s.name, "dof", joints ? 6 : s.dof, "joints", s.joints, "rate_hz", s.master_rate_hz,
                "architecture", to_string(s.control.architecture), "method", s.control.method_name, "methods",
                i.methods, "plain_method", kPlainMethod, "initial_energies_j", initial_energies_j(s), "device",
                i.device, "pointer", i.has_pointer, "home_m", home, "robot_home_m", robot_home, "without_motor",
                without_motor, "restarts", i.restarts, "grip_n_per_m", i.grip_n_per_m, "grip_limits_n_per_m",
                std::array{kPageGripLeast, kPageGripMost}, "max_force_n", s.control.max_force_n, "motion_scale",
                joints ? 1.0 : s.control.motion_scale, "force_scale", s.control.force_scale, "limits", kLimitNames,
                "linked", s.control.architecture != Architecture::render, "to_slave", network(s.to_slave), "to_master",
                network(s.to_master), "network_limits", network(kPageDelayMs, kPageJitterMs, kPageLoss), "environment",
                of_scene(list(s.environment, element)), "meshes", list(shown.meshes, part<TriangleMesh>),
                "environment_answers", answers, "zero_answers", zero_answers, "surface_limits",
                object("stiffness_n_per_m", kSurfaceStiffnessMost, "friction", kSurfaceFrictionMost), "layer_figures",
                list(kLayerFigures, figure), "tool", of_scene({json(s.tool)}), "tool_parts",
                list(shown.tool_parts, any_part), "tool_alone", shown.tool_alone, "arm",
                i.world || !s.robot || !s.robot->arm ? Json{"null"} : arm(*s.robot->arm, shown_arm(s)), "leader",
                joints ? arm(*s.device->arm, shown_arm(s, true)) : Json{"null"}, "object_half_size_m",
                s.object ? Json{json(s.object->half_size_m)} : Json{"null"}, "gripper_m", gripper, "fields", layout)
      .text;
}

}  // namespace twoport
