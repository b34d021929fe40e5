#include <algorithm>
#include <optional>
#include <type_traits>

#include "common/scene/blocks.h"

namespace twoport {
namespace {

/// The four contact numbers of a surface, which the text has beside its shape.
template <class Shape>
Material read_material(const Block<Shape>& of) {
  return {.stiffness_n_per_m = of.required(FIELD(stiffness_n_per_m), kPositive),
          .damping_n_s_per_m = of.number(FIELD(damping_n_s_per_m), kNotNegative),
          .friction = of.number(FIELD(friction), kNotNegative),
          .viscous_friction_n_s_per_m = of.number(FIELD(viscous_friction_n_s_per_m), kNotNegative)};
}

Wall read_shape(const Block<schema::Wall>& of) {
  return {.normal = vector<3>(direction(of, FIELD(normal))), .offset_m = of.number(FIELD(offset_m), kFinite)};
}

Sphere read_shape(const Block<schema::Sphere>& of) {
  return {.center_m = vector<3>(of.list(FIELD(center_m), of.context().point())),
          .radius_m = of.required(FIELD(radius_m), kPositive)};
}

Cylinder read_shape(const Block<schema::Cylinder>& of) {
  if (of.dof() == 1) of.fail(fmt::format("{} is given, but dof is 1; a cylinder needs dof 3 or 6", of.path()));
  return {.point_m = vector<3>(of.list(FIELD(point_m), of.context().point())),
          .axis = vector<3>(direction(of, FIELD(axis))),
          .radius_m = of.required(FIELD(radius_m), kPositive)};
}

Box read_shape(const Block<schema::Box>& of) {
  of.require(FIELD(half_size_m), of.context().point().words());
  const Numbers half_size = of.list(FIELD(half_size_m), of.context().point());
  if (!std::all_of(half_size.begin(), half_size.end(), kPositive.holds))
    of.refuse(FIELD(half_size_m), "hold numbers > 0");
  return {.center_m = vector<3>(of.list(FIELD(center_m), of.context().point())), .half_size_m = vector<3>(half_size)};
}

AnchorMotion read_anchor_motion(const Block<schema::AnchorMotion>& of) {
  if (of.dof() == 6) of.fail(fmt::format("{} is given, but dof is 6; it needs dof 1 or 3", of.path()));
  const int axis = of.integer(FIELD(axis));
  if (axis < 0 || axis >= of.dof()) of.refuse(FIELD(axis), fmt::format("be between 0 and {}", of.dof() - 1));
  return {.axis = axis,
          .amplitude_m = of.required(FIELD(amplitude_m), kNotNegative),
          .frequency_hz = of.required(FIELD(frequency_hz), kNotNegative)};
}

Spring read_spring(const Block<schema::Spring>& of) {
  Spring spring{.stiffness_n_per_m = of.required(FIELD(stiffness_n_per_m), kNotNegative),
                .damping_n_s_per_m = of.number(FIELD(damping_n_s_per_m), kNotNegative),
                .anchor_m = vector<3>(of.list(FIELD(anchor_m), of.context().point()))};
  if (of.has(FIELD(anchor_motion))) spring.motion = read_anchor_motion(of.block(FIELD(anchor_motion)));
  of.only_with_rotation(FIELD(contact_point));
  spring.contact_point = of.integer(FIELD(contact_point));
  if (spring.contact_point < -1)
    of.refuse(FIELD(contact_point), "be the index of a contact point of the tool, or -1 for all");
  return spring;
}

/// The field that holds each shape. One of the list in common/contact/shape.h that has none here does not compile.
auto field_of(std::type_identity<Wall>) {
  return FIELD(wall);
}
auto field_of(std::type_identity<Sphere>) {
  return FIELD(sphere);
}
auto field_of(std::type_identity<Cylinder>) {
  return FIELD(cylinder);
}
auto field_of(std::type_identity<Box>) {
  return FIELD(box);
}

}  // namespace

EnvironmentSpec read_environment(const Block<schema::Environment>& of) {
  std::optional<EnvironmentSpec> found;
  for_each_shape([&](auto shape) {
    const auto field = field_of(shape);
    if (!of.has(field)) return;
    const auto block = of.block(field);
    found = Surface{read_shape(block), read_material(block)};
  });
  if (found) return *found;
  if (!of.has(FIELD(spring))) of.refuse_empty();
  return read_spring(of.block(FIELD(spring)));
}

}  // namespace twoport
