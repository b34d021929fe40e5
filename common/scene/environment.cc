#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <numbers>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/contact/sample_shape.h"
#include "common/mesh/sample_surface.h"
#include "common/scene/blocks.h"
#include "common/scene/mesh_file.h"

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

/// Three numbers, for shapes that have no counterpart on a line.
constexpr Count kPointInSpace{3, 3, ""};

template <class Shape>
void need_space(const Block<Shape>& of, const char* what) {
  if (of.dof() == 1) of.fail(fmt::format("{} is given, but dof is 1; a {} needs dof 3 or 6", of.path(), what));
}
/// An attitude, that of the world where it is absent.
template <class Shape>
Eigen::Matrix3d read_rotation(const Block<Shape>& of) {
  if (!of.has(FIELD(rotation))) return Eigen::Matrix3d::Identity();
  const Numbers q = of.list(FIELD(rotation), Count{4, 4, ""});
  Eigen::Quaterniond rotation{q[0], q[1], q[2], q[3]};
  if (!(std::abs(rotation.norm() - 1.0) <= 1e-3)) of.refuse(FIELD(rotation), "be of length 1");
  return rotation.normalized().toRotationMatrix();
}

Torus read_shape(const Block<schema::Torus>& of) {
  need_space(of, "torus");
  const double radius_m = of.required(FIELD(radius_m), kPositive);
  const double tube_radius_m = of.required(FIELD(tube_radius_m), kPositive);
  if (!(tube_radius_m < radius_m)) of.refuse(FIELD(tube_radius_m), fmt::format("be < radius_m ({:g})", radius_m));
  return {.center_m = vector<3>(of.list(FIELD(center_m), kPointInSpace)),
          .axis = vector<3>(direction(of, FIELD(axis))),
          .radius_m = radius_m,
          .tube_radius_m = tube_radius_m};
}

Capsule read_shape(const Block<schema::Capsule>& of) {
  need_space(of, "capsule");
  of.require(FIELD(end_m), kPointInSpace.words());
  const Capsule capsule{.start_m = vector<3>(of.list(FIELD(start_m), kPointInSpace)),
                        .end_m = vector<3>(of.list(FIELD(end_m), kPointInSpace)),
                        .radius_m = of.required(FIELD(radius_m), kPositive)};
  if (!((capsule.end_m - capsule.start_m).squaredNorm() > 0.0))
    of.refuse(FIELD(end_m), "differ from start_m: a capsule without length is a sphere");
  return capsule;
}

Peg read_shape(const Block<schema::Peg>& of) {
  need_space(of, "peg");
  const double radius_m = of.required(FIELD(radius_m), kPositive), length_m = of.required(FIELD(length_m), kPositive);
  const double chamfer_m = of.number(FIELD(chamfer_m), kNotNegative);
  if (!(chamfer_m < radius_m && chamfer_m < length_m))
    of.refuse(FIELD(chamfer_m), fmt::format("be < radius_m ({:g}) and < length_m ({:g})", radius_m, length_m));
  return Peg::of(vector<3>(of.list(FIELD(end_m), kPointInSpace)), vector<3>(direction(of, FIELD(axis))), radius_m,
                 length_m, chamfer_m);
}

Hole read_shape(const Block<schema::Hole>& of) {
  need_space(of, "hole");
  const double radius_m = of.required(FIELD(radius_m), kPositive), depth_m = of.required(FIELD(depth_m), kPositive);
  const double chamfer_m = of.number(FIELD(chamfer_m), kNotNegative);
  if (!(chamfer_m < depth_m)) of.refuse(FIELD(chamfer_m), fmt::format("be < depth_m ({:g})", depth_m));
  return Hole::of(vector<3>(of.list(FIELD(mouth_m), kPointInSpace)), vector<3>(direction(of, FIELD(axis))), radius_m,
                  depth_m, chamfer_m);
}

Cone read_shape(const Block<schema::Cone>& of) {
  need_space(of, "cone");
  return Cone::of(vector<3>(of.list(FIELD(apex_m), kPointInSpace)), vector<3>(direction(of, FIELD(axis))),
                  of.required(FIELD(base_radius_m), kPositive), of.required(FIELD(height_m), kPositive));
}

Plate read_shape(const Block<schema::Plate>& of) {
  need_space(of, "plate");
  of.require(FIELD(half_size_m), kPointInSpace.words());
  const Numbers half_size = of.list(FIELD(half_size_m), kPointInSpace);
  if (!std::all_of(half_size.begin(), half_size.end(), kPositive.holds))
    of.refuse(FIELD(half_size_m), "hold numbers > 0");
  std::vector<PlateHole> holes;
  for (const auto& each : of.blocks(FIELD(hole))) {
    each.require(FIELD(center_m), "hold 2 numbers");
    const PlateHole hole{vector<2>(each.list(FIELD(center_m), Count{2, 2, ""})),
                         each.required(FIELD(radius_m), kPositive)};
    for (int axis = 0; axis < 2; ++axis)
      if (!(std::abs(hole.center_m[axis]) + hole.radius_m < half_size[static_cast<std::size_t>(axis)]))
        each.refuse(FIELD(radius_m),
                    fmt::format("be less than what is left to the plate's side, {:g}",
                                half_size[static_cast<std::size_t>(axis)] - std::abs(hole.center_m[axis])));
    for (std::size_t i = 0; i < holes.size(); ++i) {
      const double apart = (hole.center_m - holes[i].center_m).norm();
      if (!(apart > hole.radius_m + holes[i].radius_m))
        each.refuse(FIELD(radius_m),
                    fmt::format("be less than the distance to hole[{}], {:g}", i, apart - holes[i].radius_m));
    }
    holes.push_back(hole);
  }
  return {.center_m = vector<3>(of.list(FIELD(center_m), kPointInSpace)),
          .rotation = read_rotation(of),
          .half_size_m = vector<3>(half_size),
          .holes = std::make_shared<const std::vector<PlateHole>>(std::move(holes))};
}

/// The triangles of a file, in metres.
TriangleMesh read_triangles(const Block<schema::Mesh>& of) {
  need_space(of, "mesh");
  of.require(FIELD(file), "name a file: STL or Wavefront OBJ");
  const std::filesystem::path folder = std::filesystem::path{of.context().file}.parent_path();
  const double scale = of.number(FIELD(scale), kPositive);
  try {
    return read_mesh_file((folder / of.text(FIELD(file))).string(), scale);
  } catch (const ConfigError& e) {
    of.fail(fmt::format("{}: {}", of.path_of("file"), e.what()));
  }
}

Mesh read_shape(const Block<schema::Mesh>& of) {
  const TriangleMesh mesh = read_triangles(of);
  const double absent = longest_side(mesh) / 100.0;
  const double voxel_m = of.number_or(FIELD(voxel_m), kPositive, absent);
  const double coarsest = shortest_side(mesh) / 2.0;
  if (!(voxel_m <= coarsest))
    of.refuse(FIELD(voxel_m), fmt::format("be at most {:.3g}, half of the mesh's shortest side", coarsest));
  const double nodes = DistanceField::nodes(mesh, voxel_m);
  constexpr double kMost = static_cast<double>(DistanceField::kMostNodes);
  if (!(nodes <= kMost))
    of.refuse(FIELD(voxel_m), fmt::format("make at most {:g} samples of the distance, and makes {:.3g}", kMost, nodes));
  return {.position_m = vector<3>(of.list(FIELD(position_m), kPointInSpace)),
          .rotation = read_rotation(of),
          .field = shared_field(mesh, voxel_m)};
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

auto field_of(std::type_identity<Torus>) {
  return FIELD(torus);
}
auto field_of(std::type_identity<Capsule>) {
  return FIELD(capsule);
}
auto field_of(std::type_identity<Peg>) {
  return FIELD(peg);
}
auto field_of(std::type_identity<Hole>) {
  return FIELD(hole);
}
auto field_of(std::type_identity<Cone>) {
  return FIELD(cone);
}
auto field_of(std::type_identity<Plate>) {
  return FIELD(plate);
}
auto field_of(std::type_identity<Mesh>) {
  return FIELD(mesh);
}

// --- parts of the tool ---

template <class Shape>
void refuse_material(const Block<Shape>& of) {
  const auto check = [&of](const auto& field) {
    static_cast<void>(of.number(field, kFinite));
    if (of.has(field))
      of.fail(fmt::format("{} is given, but of a tool's part only the shape counts; it belongs to the environment",
                          of.path_of(field.name)));
  };
  check(FIELD(stiffness_n_per_m)), check(FIELD(damping_n_s_per_m)), check(FIELD(friction));
  check(FIELD(viscous_friction_n_s_per_m));
}

constexpr double kMostPoints = 5000.0;  // of a part

/// The points of one part; `area_m2` is that of its surface, at most.
template <class Part>
std::vector<Eigen::Vector3d> points_of(const Block<schema::ToolPart>& of, const Part& sampled, double area_m2) {
  const double spacing_m = of.required(FIELD(spacing_m), kPositive);
  const double least = std::sqrt(area_m2 / kMostPoints);
  if (!(spacing_m >= least))
    of.refuse(FIELD(spacing_m), fmt::format("be >= {:.3g} here: a part has at most {:g} points", least, kMostPoints));
  return sampled(spacing_m);
}

}  // namespace

std::vector<Eigen::Vector3d> read_tool_part(const Block<schema::ToolPart>& of) {
  using std::numbers::pi;
  if (of.has(FIELD(torus))) {
    const Block shape = of.block(FIELD(torus));
    refuse_material(shape);
    const Torus part = read_shape(shape);
    return points_of(
        of, [&](double h) { return sample(part, h); }, 4 * pi * pi * part.radius_m * part.tube_radius_m);
  }
  if (of.has(FIELD(capsule))) {
    const Block shape = of.block(FIELD(capsule));
    refuse_material(shape);
    const Capsule part = read_shape(shape);
    const double r = part.radius_m;
    return points_of(
        of, [&](double h) { return sample(part, h); }, 2 * pi * r * ((part.end_m - part.start_m).norm() + 2 * r));
  }
  if (of.has(FIELD(peg))) {
    const Block shape = of.block(FIELD(peg));
    refuse_material(shape);
    const Peg part = read_shape(shape);
    const double r = shape.message().radius_m();
    return points_of(
        of, [&](double h) { return sample(part, h); }, 2 * pi * r * (shape.message().length_m() + r));
  }
  if (of.has(FIELD(cone))) {
    const Block shape = of.block(FIELD(cone));
    refuse_material(shape);
    const Cone part = read_shape(shape);
    const double r = shape.message().base_radius_m();
    return points_of(
        of, [&](double h) { return sample(part, h); }, pi * r * (std::hypot(r, shape.message().height_m()) + r));
  }
  if (!of.has(FIELD(mesh)))
    of.fail(fmt::format("{} is empty; it must hold one of torus, capsule, peg, cone, mesh", of.path()));
  const Block shape = of.block(FIELD(mesh));
  refuse_material(shape);
  const TriangleMesh mesh = read_triangles(shape);
  const Eigen::Vector3d position = vector<3>(shape.list(FIELD(position_m), kPointInSpace));
  const Eigen::Matrix3d rotation = read_rotation(shape);
  std::vector<Eigen::Vector3d> points = points_of(
      of, [&](double h) { return sample_surface(mesh, h); }, area_of(mesh));
  for (Eigen::Vector3d& p : points) p = Eigen::Vector3d{position + rotation * p};
  return points;
}

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
