#include "common/page/describe.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
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

std::string number(double value) {
  return std::isfinite(value) ? fmt::format("{:.9g}", value) : std::string{"null"};
}
std::string vector(const Eigen::Vector3d& v) {
  return fmt::format("[{},{},{}]", number(v.x()), number(v.y()), number(v.z()));
}
std::string shape(const Wall& s) {
  return fmt::format(R"("normal":{},"offset_m":{})", vector(s.normal), number(s.offset_m));
}
std::string shape(const Sphere& s) {
  return fmt::format(R"("center_m":{},"radius_m":{})", vector(s.center_m), number(s.radius_m));
}
std::string shape(const Cylinder& s) {
  return fmt::format(R"("point_m":{},"axis":{},"radius_m":{})", vector(s.point_m), vector(s.axis), number(s.radius_m));
}
std::string shape(const Box& s) {
  return fmt::format(R"("center_m":{},"half_size_m":{})", vector(s.center_m), vector(s.half_size_m));
}
std::string attitude(const Eigen::Matrix3d& rotation) {
  const Eigen::Quaterniond q{rotation};
  return fmt::format("[{},{},{},{}]", number(q.w()), number(q.x()), number(q.y()), number(q.z()));
}
template <class Values, class Text>
std::string list(const Values& values, Text text) {
  std::string out = "[";
  for (const auto& value : values) {
    if (out.size() > 1) out += ',';
    out += text(value);
  }
  out += ']';
  return out;
}

std::string shape(const Torus& s) {
  return fmt::format(R"("center_m":{},"axis":{},"radius_m":{},"tube_radius_m":{})", vector(s.center_m), vector(s.axis),
                     number(s.radius_m), number(s.tube_radius_m));
}
std::string shape(const Capsule& s) {
  return fmt::format(R"("start_m":{},"end_m":{},"radius_m":{})", vector(s.start_m), vector(s.end_m),
                     number(s.radius_m));
}
/// The corners of the profile; where it comes from infinity, from its first one on.
std::string shape(const Revolved& s) {
  std::vector<Eigen::Vector2d> corners;
  for (const Profile::Segment& segment : s.profile->segments())
    if (std::isfinite(segment.from)) corners.push_back(segment.origin);
  corners.emplace_back(0.0, corners.back().y());
  return fmt::format(
      R"("point_m":{},"axis":{},"profile_m":{})", vector(s.point_m), vector(s.axis),
      list(corners, [](const Eigen::Vector2d& c) { return fmt::format("[{},{}]", number(c.x()), number(c.y())); }));
}
std::string shape(const Plate& s) {
  return fmt::format(R"("center_m":{},"attitude":{},"half_size_m":{},"holes_m":{})", vector(s.center_m),
                     attitude(s.rotation), vector(s.half_size_m), list(*s.holes, [](const PlateHole& h) {
                       return fmt::format("[{},{},{}]", number(h.center_m.x()), number(h.center_m.y()),
                                          number(h.radius_m));
                     }));
}
/// Its triangles stand apart.
std::string shape(const Mesh&) {
  return R"("apart":true)";
}
std::string shape(const TriangleMesh& m) {
  return fmt::format(
      R"("vertices_m":{},"triangles":{})",
      list(m.vertices,
           [](const Eigen::Vector3d& v) { return fmt::format("{:.5g},{:.5g},{:.5g}", v.x(), v.y(), v.z()); }),
      list(m.triangles, [](const TriangleMesh::Triangle& t) { return fmt::format("{},{},{}", t[0], t[1], t[2]); }));
}
template <class Shape>
std::string part(const Shape& s) {
  const char* kind = Mesh::kName;
  if constexpr (!std::is_same_v<Shape, TriangleMesh>) kind = Shape::kName;
  return fmt::format(R"({{"kind":{},{}}})", json_string(kind), shape(s));
}

std::string arm(const Scene& s, const ShownArm& shown) {
  if (!s.robot || !s.robot->arm) return "null";
  const ArmParameters& p = *s.robot->arm->parameters;
  return fmt::format(R"({{"joints":{},"flange_m":{},"links":{},"left_out":{}}})",
                     list(p.joints,
                          [](const ArmJoint& j) {
                            return fmt::format(R"({{"origin_m":{},"attitude":{},"slides":{}}})", vector(j.origin_m),
                                               attitude(j.rotation), j.type == JointType::prismatic);
                          }),
                     vector(p.flange_m), list(shown.links, part<TriangleMesh>), list(shown.left_out, json_string));
}

std::string element(const EnvironmentSpec& spec) {
  const std::string kind = json_string(name(spec));
  if (const auto* surface = std::get_if<Surface>(&spec))
    return fmt::format(R"({{"kind":{},"stiffness_n_per_m":{},"friction":{},{}}})", kind,
                       number(surface->material.stiffness_n_per_m), number(surface->material.friction),
                       std::visit([](const auto& s) { return shape(s); }, surface->shape));
  const auto& spring = std::get<Spring>(spec);
  return fmt::format(R"({{"kind":{},"stiffness_n_per_m":{},"anchor_m":{}}})", kind, number(spring.stiffness_n_per_m),
                     vector(spring.anchor_m));
}

std::string network(const ImpairmentOptions& o) {
  return fmt::format(R"({{"delay_ms":{},"jitter_ms":{},"loss":{}}})", number(1e3 * o.delay_s), number(1e3 * o.jitter_s),
                     number(o.loss));
}

const char* name_of(Architecture a) {
  switch (a) {
    case Architecture::render:
      return "RENDER";
    case Architecture::position_force:
      return "POSITION_FORCE";
    case Architecture::position_measured_force:
      return "POSITION_MEASURED_FORCE";
    case Architecture::position_position:
      return "POSITION_POSITION";
    case Architecture::uncontrolled:
      break;
  }
  return "UNCONTROLLED";
}

}  // namespace

std::string describe_for_page(const Scene& s, const PageIntroduction& i) {
  std::string fields;
  PageSample sample;
  for_each_page_field(sample, [&](const char* name, std::size_t size, const double*) {
    fields += fmt::format("{}[{},{}]", fields.empty() ? "" : ",", json_string(name), size);
  });
  // Where the handle's gripper starts: as far as the page opens it.
  std::string gripper = "null";
  if (s.gripper) {
    const bool placed = s.gripper->device && !s.gripper->device->position_m.empty();
    gripper = number(placed ? s.gripper->device->position_m[0] : 0.0);
  }
  std::array<std::string_view, kEnvironmentAnswers> answers;
  for (std::size_t a = 0; a < answers.size(); ++a) answers[a] = sentence(static_cast<EnvironmentAnswer>(a));
  const auto axis = [](const Eigen::Vector3d& v) { return vector(v); };
  const Eigen::Vector3d home = s.device ? vector<3>(s.device->position_m) : Eigen::Vector3d::Zero().eval();
  const ShownShapes shown = i.world ? *i.world : shown_shapes(s);
  const auto of_scene = [&](const auto& all, const auto& text) {
    return i.world ? std::string{"[]"} : list(all, text);
  };
  const auto any_part = [](const auto& each) { return std::visit([](const auto& p) { return part(p); }, each); };
  return fmt::format(
      R"({{"scene":{},"dof":{},"rate_hz":{},"architecture":{},"method":{},"methods":{},"plain_method":{},"initial_energies_j":{},"device":{},"pointer":{},"home_m":{},"restarts":{},)"
      R"("grip_n_per_m":{},"grip_limits_n_per_m":[{},{}],"max_force_n":{},"motion_scale":{},"force_scale":{},)"
      R"("limits":{},"linked":{},"to_slave":{},"to_master":{},"network_limits":{{"delay_ms":{},"jitter_ms":{},"loss":{}}},)"
      R"("environment":{},"meshes":{},"environment_answers":{},"surface_limits":{{"stiffness_n_per_m":{},"friction":{}}},)"
      R"("layer_figures":{},"tool":{},"tool_parts":{},"tool_alone":{},"arm":{},"gripper_m":{},"fields":[{}]}})",
      json_string(s.name), s.dof, number(s.master_rate_hz), json_string(name_of(s.control.architecture)),
      json_string(s.control.method_name), list(i.methods, json_string), json_string(kPlainMethod),
      list(initial_energies_j(s), number), json_string(i.device), i.has_pointer, vector(home), i.restarts,
      number(i.grip_n_per_m), number(kPageGripLeast), number(kPageGripMost), number(s.control.max_force_n),
      number(s.control.motion_scale), number(s.control.force_scale), list(kLimitNames, json_string),
      s.control.architecture != Architecture::render, network(s.to_slave), network(s.to_master), number(kPageDelayMs),
      number(kPageJitterMs), number(kPageLoss), of_scene(s.environment, element),
      list(shown.meshes, part<TriangleMesh>), list(answers, json_string), number(kSurfaceStiffnessMost),
      number(kSurfaceFrictionMost),
      list(kLayerFigures,
           [](const LayerFigure& f) {
             return fmt::format("[{},{},{}]", json_string(f.name), json_string(f.unit), f.least_dof);
           }),
      of_scene(s.tool, axis), list(shown.tool_parts, any_part), shown.tool_alone,
      i.world ? "null" : arm(s, shown_arm(s)), gripper, fields);
}

}  // namespace twoport
