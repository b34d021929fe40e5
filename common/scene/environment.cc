#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <numbers>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/contact/sample_shape.h"
#include "common/mesh/distance_field.h"
#include "common/mesh/joined.h"
#include "common/mesh/solids.h"
#include "common/mesh/triangle_mesh.h"
#include "common/scene/blocks.h"
#include "common/scene/find.h"
#include "common/scene/shown.h"
#include "common/scene/source.h"

namespace twoport {
namespace {

/// The four contact numbers of a surface, which the text has beside its shape.
template <class Shape>
Material read_material(const Block<Shape>& of) {
  of.require(FIELD(stiffness_n_per_m));
  return {.stiffness_n_per_m = of->stiffness_n_per_m(),
          .damping_n_s_per_m = of->damping_n_s_per_m(),
          .friction = of->friction(),
          .viscous_friction_n_s_per_m = of->viscous_friction_n_s_per_m()};
}

Wall read_shape(const Block<schema::Wall>& of) {
  return {.normal = vector<3>(direction(of->normal())), .offset_m = of->offset_m()};
}

Sphere read_shape(const Block<schema::Sphere>& of) {
  return {.center_m = vector<3>(of->center_m()), .radius_m = of->radius_m()};
}

Cylinder read_shape(const Block<schema::Cylinder>& of) {
  return {.point_m = vector<3>(of->point_m()), .axis = vector<3>(direction(of->axis())), .radius_m = of->radius_m()};
}

Box read_shape(const Block<schema::Box>& of) {
  return {.center_m = vector<3>(of->center_m()), .half_size_m = vector<3>(of->half_size_m())};
}

Torus read_shape(const Block<schema::Torus>& of) {
  const double radius_m = of->radius_m(), tube_radius_m = of->tube_radius_m();
  if (!(tube_radius_m < radius_m)) of.refuse(FIELD(tube_radius_m), fmt::format("be < radius_m ({:g})", radius_m));
  return {.center_m = vector<3>(of->center_m()),
          .axis = vector<3>(direction(of->axis())),
          .radius_m = radius_m,
          .tube_radius_m = tube_radius_m};
}

Capsule read_shape(const Block<schema::Capsule>& of) {
  const Capsule capsule{
      .start_m = vector<3>(of->start_m()), .end_m = vector<3>(of->end_m()), .radius_m = of->radius_m()};
  if (!((capsule.end_m - capsule.start_m).squaredNorm() > 0.0))
    of.refuse(FIELD(end_m), "differ from start_m: a capsule without length is a sphere");
  return capsule;
}

Peg read_shape(const Block<schema::Peg>& of) {
  const double radius_m = of->radius_m(), length_m = of->length_m(), chamfer_m = of->chamfer_m();
  if (!(chamfer_m < radius_m && chamfer_m < length_m))
    of.refuse(FIELD(chamfer_m), fmt::format("be < radius_m ({:g}) and < length_m ({:g})", radius_m, length_m));
  return Peg::of(vector<3>(of->end_m()), vector<3>(direction(of->axis())), radius_m, length_m, chamfer_m);
}

Hole read_shape(const Block<schema::Hole>& of) {
  const double radius_m = of->radius_m(), depth_m = of->depth_m(), chamfer_m = of->chamfer_m();
  if (!(chamfer_m < depth_m)) of.refuse(FIELD(chamfer_m), fmt::format("be < depth_m ({:g})", depth_m));
  return Hole::of(vector<3>(of->mouth_m()), vector<3>(direction(of->axis())), radius_m, depth_m, chamfer_m);
}

Cone read_shape(const Block<schema::Cone>& of) {
  return Cone::of(vector<3>(of->apex_m()), vector<3>(direction(of->axis())), of->base_radius_m(), of->height_m());
}

Plate read_shape(const Block<schema::Plate>& of) {
  const List& half_size = of->half_size_m();
  std::vector<PlateHole> holes;
  for (const auto& each : of.blocks(FIELD(hole))) {
    each.require(FIELD(center_m), "hold 2 numbers");
    const PlateHole hole{vector<2>(each->center_m()), each->radius_m()};
    for (int axis = 0; axis < 2; ++axis)
      if (!(std::abs(hole.center_m[axis]) + hole.radius_m < half_size[axis]))
        each.refuse(FIELD(radius_m), fmt::format("be less than what is left to the plate's side, {:g}",
                                                 half_size[axis] - std::abs(hole.center_m[axis])));
    for (std::size_t i = 0; i < holes.size(); ++i) {
      const double apart = (hole.center_m - holes[i].center_m).norm();
      if (!(apart > hole.radius_m + holes[i].radius_m))
        each.refuse(FIELD(radius_m),
                    fmt::format("be less than the distance to hole[{}], {:g}", i, apart - holes[i].radius_m));
    }
    holes.push_back(hole);
  }
  return {.center_m = vector<3>(of->center_m()),
          .rotation = attitude(of->rotation()).toRotationMatrix(),
          .half_size_m = vector<3>(half_size),
          .holes = std::make_shared<const std::vector<PlateHole>>(std::move(holes))};
}

constexpr std::size_t kMostShells = 256;  // each costs a distance field while the scene is read

/// The closed mesh of a file, with its coordinates times `scale`. Throws ConfigError that begins with the path for a file that
/// cannot be read or whose mesh does not bound a solid.
TriangleMesh read_mesh_file(const std::string& path, double scale) {
  TriangleMesh mesh = parse_mesh(read_whole(path), path);
  for (Eigen::Vector3d& v : mesh.vertices) v *= scale;
  const auto text = [](const Eigen::Vector3d& p) { return fmt::format("({:.6g}, {:.6g}, {:.6g})", p[0], p[1], p[2]); };
  const MeshFaults faults = faults_of(mesh);
  if (faults.open_edges > 0) {
    const std::vector<Eigen::AlignedBox3d> gaps = gaps_of(mesh);
    throw ConfigError{fmt::format(
        "{} has {} edges of one triangle only, in {} gap{} of which the largest is around {} m and {:.3g} m across; "
        "the "
        "mesh must be closed: in MeshLab by Merge Close Vertices, then Close Holes, in Blender by Merge by Distance, "
        "then Fill Holes",
        path, faults.open_edges, gaps.size(), gaps.size() == 1 ? "" : "s", text(gaps[0].center()),
        gaps[0].sizes().norm())};
  }
  if (faults.odd_edges > 0)
    throw ConfigError{fmt::format(
        "{} has {} edges that do not join two triangles of the same orientation, one of them at {} m; every edge must: "
        "in MeshLab by Remove Duplicate Faces, then Re-Orient All Faces Coherently, in Blender by Merge by Distance, "
        "then Recalculate Outside",
        path, faults.odd_edges, text(odd_edge_of(mesh)))};
  if (faults.volume_m3 == 0.0) throw ConfigError{fmt::format("{} encloses no volume at scale {}", path, scale)};
  if (!(faults.volume_m3 > 0.0))
    throw ConfigError{fmt::format(
        "{} has its triangles facing inwards; their corners must be counterclockwise seen from outside: in MeshLab by "
        "Invert Faces Orientation, in Blender by Recalculate Outside",
        path)};
  const std::vector<TriangleMesh> shells = shells_of(mesh);
  if (shells.size() > kMostShells)
    throw ConfigError{
        fmt::format("{} has {} separate surfaces; at most {} are read", path, shells.size(), kMostShells)};
  for (const TriangleMesh& shell : shells) {
    if (const auto where = BoundingVolumeTree{shell}.crossing())
      throw ConfigError{fmt::format("{} has a surface that crosses itself at {} m; surfaces may only cross others",
                                    path, text(*where))};
    if (const auto where = misplaced(shell))
      throw ConfigError{fmt::format(
          "{} has a triangle around {} m with no inside behind it: it lies on another one, or a part is inside out",
          path, text(*where))};
  }
  if (const auto where = solids_of(mesh).inward)
    throw ConfigError{
        fmt::format("{} has a surface at {} m that faces inwards and lies in no other; a cavity must lie in a solid",
                    path, text(*where))};
  return mesh;
}

/// The triangles of a file, in metres.
TriangleMesh read_triangles(const Block<schema::Mesh>& of) {
  of.require(FIELD(file), "name a file: STL or Wavefront OBJ");
  const double scale = of->scale();
  try {
    return read_mesh_file(file_beside(of.context().file, of->file()), scale);
  } catch (const ConfigError& e) {
    of.fail(fmt::format("{}: {}", of.path_of("file"), e.what()));
  }
}

/// Of the box around it.
Eigen::Vector3d sides_of(const TriangleMesh& mesh) {
  Eigen::Vector3d low = mesh.vertices[0], high = low;
  for (const Eigen::Vector3d& v : mesh.vertices) low = low.cwiseMin(v), high = high.cwiseMax(v);
  return high - low;
}

/// Its distance field. While one of the same mesh and spacing is in use anywhere in the program, that one.
std::shared_ptr<const DistanceField> shared_field(const TriangleMesh& mesh, double spacing_m) {
  // Two hashes of 64 bits: two meshes of one scene will not have both in common.
  std::uint64_t first = 0xcbf29ce484222325, second = 0x9e3779b97f4a7c15;
  const auto add = [&](std::uint64_t value) {
    first = (first ^ value) * 0x100000001b3;
    second = (std::rotl(second, 5) ^ value) * 0xbf58476d1ce4e5b9;
  };
  for (const Eigen::Vector3d& v : mesh.vertices)
    for (int i = 0; i < 3; ++i) add(std::bit_cast<std::uint64_t>(v[i]));
  for (const TriangleMesh::Triangle& t : mesh.triangles)
    for (const std::uint32_t i : t) add(i);
  add(std::bit_cast<std::uint64_t>(spacing_m));

  static std::mutex mutex;
  static std::map<std::pair<std::uint64_t, std::uint64_t>, std::weak_ptr<const DistanceField>> fields;
  static std::shared_ptr<const DistanceField> latest;  // runs of a sweep follow each other
  const std::lock_guard lock{mutex};
  std::weak_ptr<const DistanceField>& known = fields[{first, second}];
  std::shared_ptr<const DistanceField> field = known.lock();
  if (!field) known = field = std::make_shared<const DistanceField>(mesh, spacing_m);
  latest = field;
  return field;
}

Mesh read_shape(const Block<schema::Mesh>& of) {
  const TriangleMesh mesh = read_triangles(of);
  const double longest = sides_of(mesh).maxCoeff(), thickness = sides_of(mesh).minCoeff(), coarsest = thickness / 2.0;
  const double voxel_m = GIVEN(of, voxel_m).value_or(std::min(longest / 100.0, coarsest));
  if (!(voxel_m <= coarsest))
    of.refuse(FIELD(voxel_m), fmt::format("be at most {:.3g}, half of the mesh's shortest side", coarsest));
  const double nodes = DistanceField::nodes(mesh, voxel_m);
  constexpr double kMost = static_cast<double>(DistanceField::kMostNodes);
  if (!(nodes <= kMost) && !of->has_voxel_m())
    of.fail(
        fmt::format("{} is {:.3g} m long and {:.3g} m thick; half of that as voxel_m makes {:.3g} samples of the "
                    "distance, and {:g} are allowed: give a thicker part, or a box or capsule",
                    of.path_of("file"), longest, thickness, nodes, kMost));
  if (!(nodes <= kMost))
    of.refuse(FIELD(voxel_m), fmt::format("make at most {:g} samples of the distance, and makes {:.3g}", kMost, nodes));
  return {.position_m = vector<3>(of->position_m()),
          .rotation = attitude(of->rotation()).toRotationMatrix(),
          .field = shared_field(mesh, voxel_m)};
}

AnchorMotion read_anchor_motion(const Block<schema::AnchorMotion>& of) {
  const int axis = of->axis(), axes = std::min(of.dof(), 3);
  if (axis < 0 || axis >= axes) of.refuse(FIELD(axis), fmt::format("be between 0 and {}", axes - 1));
  return {.axis = axis, .amplitude_m = of->amplitude_m(), .frequency_hz = of->frequency_hz()};
}

Spring read_spring(const Block<schema::Spring>& of) {
  Spring spring{.stiffness_n_per_m = of->stiffness_n_per_m(),
                .damping_n_s_per_m = of->damping_n_s_per_m(),
                .anchor_m = vector<3>(of->anchor_m())};
  if (of->has_anchor_motion()) spring.motion = read_anchor_motion(of.block(FIELD(anchor_motion)));
  spring.contact_point = of->contact_point();
  if (spring.contact_point < -1)
    of.refuse(FIELD(contact_point), "be the index of a contact point of the tool, or -1 for all");
  return spring;
}

/// The field that holds each shape. One of the list in common/contact/shape.h that has none here does not compile.
#define TWOPORT_FIELD_OF(Shape, NAME)        \
  auto field_of(std::type_identity<Shape>) { \
    return FIELD(NAME);                      \
  }
TWOPORT_FIELD_OF(Wall, wall)
TWOPORT_FIELD_OF(Sphere, sphere)
TWOPORT_FIELD_OF(Cylinder, cylinder)
TWOPORT_FIELD_OF(Box, box)
TWOPORT_FIELD_OF(Torus, torus)
TWOPORT_FIELD_OF(Capsule, capsule)
TWOPORT_FIELD_OF(Peg, peg)
TWOPORT_FIELD_OF(Hole, hole)
TWOPORT_FIELD_OF(Cone, cone)
TWOPORT_FIELD_OF(Plate, plate)
TWOPORT_FIELD_OF(Mesh, mesh)

// --- parts of the tool ---

template <class Shape>
void refuse_material(const Block<Shape>& of) {
  const auto check = [&of](const auto& field) {
    if (of.has(field))
      of.fail(fmt::format("{} is given, but of a tool's part only the shape counts; it belongs to the environment",
                          of.path_of(field.name)));
  };
  check(FIELD(stiffness_n_per_m)), check(FIELD(damping_n_s_per_m)), check(FIELD(friction));
  check(FIELD(viscous_friction_n_s_per_m));
}

constexpr double kMostPoints = 5000.0;  // of a part

/// The points of one part, sample(spacing); `area_m2` is that of its surface, at most.
template <class Sample>
std::vector<Eigen::Vector3d> points_of(const Block<schema::ToolPart>& of, double area_m2, Sample sample) {
  const double spacing_m = of->spacing_m();
  const double least = std::sqrt(area_m2 / kMostPoints);
  if (!(spacing_m >= least))
    of.refuse(FIELD(spacing_m), fmt::format("be >= {:.3g} here: a part has at most {:g} points", least, kMostPoints));
  return sample(spacing_m);
}

}  // namespace

std::vector<Eigen::Vector3d> read_tool_part(const Block<schema::ToolPart>& of) {
  using std::numbers::pi;
  std::optional<std::vector<Eigen::Vector3d>> points;
  const auto read = [&](const auto& field, auto area_m2) {
    if (!of.has(field)) return;
    const auto shape = of.block(field);
    refuse_material(shape);
    const auto part = read_shape(shape);
    points = points_of(of, area_m2(shape.message()), [&](double h) { return sample(part, h); });
  };
  read(FIELD(torus), [](const auto& s) { return 4 * pi * pi * s.radius_m() * s.tube_radius_m(); });
  read(FIELD(capsule), [](const auto& s) {
    return 2 * pi * s.radius_m() * ((vector<3>(s.end_m()) - vector<3>(s.start_m())).norm() + 2 * s.radius_m());
  });
  read(FIELD(peg), [](const auto& s) { return 2 * pi * s.radius_m() * (s.length_m() + s.radius_m()); });
  read(FIELD(cone), [](const auto& s) {
    return pi * s.base_radius_m() * (std::hypot(s.base_radius_m(), s.height_m()) + s.base_radius_m());
  });
  if (points) return *points;
  if (!of->has_mesh())
    of.fail(fmt::format("{} is empty; it must hold one of torus, capsule, peg, cone, mesh", of.path()));
  const Block shape = of.block(FIELD(mesh));
  refuse_material(shape);
  const TriangleMesh mesh = read_triangles(shape);
  const Eigen::Vector3d position = vector<3>(shape->position_m());
  const Eigen::Matrix3d rotation = attitude(shape->rotation()).toRotationMatrix();
  points = points_of(of, area_of(mesh), [&](double h) { return sample_surface(mesh, h); });
  for (Eigen::Vector3d& p : *points) p = Eigen::Vector3d{position + rotation * p};
  return *points;
}

namespace {

TriangleMesh shown(const Block<schema::Mesh>& of, std::size_t most) {
  const std::string path = file_beside(of.context().file, of->file());
  TriangleMesh mesh = decimated(parse_mesh(read_whole(path), path), most);
  const Eigen::Affine3d place =
      Eigen::Translation3d{vector<3>(of->position_m())} * attitude(of->rotation()) * Eigen::Scaling(of->scale());
  for (Eigen::Vector3d& v : mesh.vertices) v = place * v;
  return mesh;
}

}  // namespace

std::vector<std::string> left_out_of_meshes(const Scene& scene) {
  if (!scene.source) return {};
  const schema::Scene& message = scene.source->message;
  std::vector<std::string> all;
  const auto add = [&](const auto& each) {
    if (!each.has_mesh()) return;
    const std::string path = file_beside(scene.source->file, each.mesh().file());
    std::string sentence;
    parse_mesh(read_whole(path), path, sentence);
    if (!sentence.empty()) all.push_back(std::move(sentence));
  };
  for (const auto& each : message.environment()) add(each);
  for (const auto& each : message.tool().part()) add(each);
  return all;
}

ShownShapes shown_shapes(const Scene& scene) {
  if (!scene.source) return {};
  const auto& [message, file, use] = *scene.source;
  const Context context{.file = file, .dof = scene.dof};
  const Block of{context, message};
  const Block tool = of.block(FIELD(tool));
  const auto environment = of.blocks(FIELD(environment));
  const auto parts = tool.blocks(FIELD(part));
  const auto has_mesh = [](const auto& block) { return block->has_mesh(); };
  const auto meshes = std::count_if(environment.begin(), environment.end(), has_mesh) +
                      std::count_if(parts.begin(), parts.end(), has_mesh);
  const std::size_t most = kMostShownTriangles / static_cast<std::size_t>(std::max<std::ptrdiff_t>(meshes, 1));
  ShownShapes all;
  for (const auto& each : environment)
    if (each->has_mesh()) all.meshes.push_back(shown(each.block(FIELD(mesh)), most));
  for (const auto& part : parts) {
    if (part->has_mesh()) all.tool_parts.emplace_back(shown(part.block(FIELD(mesh)), most));
    const auto add = [&](const auto& field) {
      if (part.has(field)) all.tool_parts.emplace_back(read_shape(part.block(field)));
    };
    add(FIELD(torus)), add(FIELD(capsule)), add(FIELD(peg)), add(FIELD(cone));
  }
  all.tool_alone = static_cast<std::size_t>(tool->contact_point_size());
  return all;
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
  if (!of->has_spring()) of.refuse_empty();
  return read_spring(of.block(FIELD(spring)));
}

}  // namespace twoport
