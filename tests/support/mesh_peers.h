#pragma once

// Nearest points of a mesh by CGAL (TWOPORT_CGAL) and Embree (TWOPORT_EMBREE), where they are installed: for tests and benchmarks.

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <vector>

#include "common/mesh/triangle_mesh.h"

#ifdef TWOPORT_CGAL
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Simple_cartesian.h>
#endif
#ifdef TWOPORT_EMBREE
#include <embree3/rtcore.h>
#endif

namespace twoport::test {

#ifdef TWOPORT_CGAL
class CgalTree {
 public:
  explicit CgalTree(const TriangleMesh& mesh) {
    const auto point = [](const Eigen::Vector3d& v) { return Kernel::Point_3{v.x(), v.y(), v.z()}; };
    for (const TriangleMesh::Triangle& t : mesh.triangles)
      triangles_.emplace_back(point(mesh.vertices[t[0]]), point(mesh.vertices[t[1]]), point(mesh.vertices[t[2]]));
    tree_.insert(triangles_.begin(), triangles_.end());
    tree_.accelerate_distance_queries();
  }
  [[nodiscard]] double distance(const Eigen::Vector3d& p) const {
    return std::sqrt(tree_.squared_distance({p.x(), p.y(), p.z()}));
  }

 private:
  using Kernel = CGAL::Simple_cartesian<double>;
  using Triangles = std::vector<Kernel::Triangle_3>;
  using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::iterator>;
  Triangles triangles_;
  CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>> tree_;
};
#endif

#ifdef TWOPORT_EMBREE
class EmbreeTree {
 public:
  explicit EmbreeTree(const TriangleMesh& mesh) : mesh_{mesh} {
    device_ = rtcNewDevice(nullptr);
    scene_ = rtcNewScene(device_);
    RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                                 3 * sizeof(float), mesh.vertices.size()));
    for (const Eigen::Vector3d& v : mesh.vertices)
      for (int i = 0; i < 3; ++i) *vertices++ = static_cast<float>(v[i]);
    auto* indices = static_cast<unsigned*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                                   3 * sizeof(unsigned), mesh.triangles.size()));
    for (const TriangleMesh::Triangle& t : mesh.triangles)
      for (const std::uint32_t v : t) *indices++ = v;
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene_);
  }
  ~EmbreeTree() { rtcReleaseScene(scene_), rtcReleaseDevice(device_); }
  EmbreeTree(const EmbreeTree&) = delete;
  EmbreeTree& operator=(const EmbreeTree&) = delete;

  /// The triangles' corners in double, the boxes in float.
  [[nodiscard]] double distance(const Eigen::Vector3d& p) const {
    Query query{&mesh_, p, std::numeric_limits<double>::infinity()};
    RTCPointQuery point{static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()), 0.0f,
                        std::numeric_limits<float>::infinity()};
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    rtcPointQuery(scene_, &point, &context, visit, &query);
    return std::sqrt(query.squared);
  }

 private:
  struct Query {
    const TriangleMesh* mesh;
    Eigen::Vector3d p;
    double squared;
  };
  static bool visit(RTCPointQueryFunctionArguments* a) {
    Query& query = *static_cast<Query*>(a->userPtr);
    const TriangleMesh::Triangle& t = query.mesh->triangles[a->primID];
    const double squared =
        (query.p - nearest(query.mesh->vertices[t[0]], query.mesh->vertices[t[1]], query.mesh->vertices[t[2]], query.p))
            .squaredNorm();
    if (squared >= query.squared) return false;
    query.squared = squared;
    a->query->radius = static_cast<float>(std::sqrt(squared)) * 1.000001f + 1e-9f;
    return true;
  }
  /// By projection onto the plane and, outside of the triangle, onto its edges: another way than BoundingVolumeTree's.
  static Eigen::Vector3d nearest(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                                 const Eigen::Vector3d& p) {
    const Eigen::Vector3d n = (b - a).cross(c - a);
    const Eigen::Vector3d q = p - n.dot(p - a) / n.squaredNorm() * n;
    if ((b - a).cross(q - a).dot(n) >= 0 && (c - b).cross(q - b).dot(n) >= 0 && (a - c).cross(q - c).dot(n) >= 0)
      return q;
    Eigen::Vector3d best = a;
    const auto edge = [&](const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
      const Eigen::Vector3d way = to - from;
      const Eigen::Vector3d r = from + std::min(1.0, std::max(0.0, way.dot(p - from) / way.squaredNorm())) * way;
      if ((p - r).squaredNorm() < (p - best).squaredNorm()) best = r;
    };
    edge(a, b), edge(b, c), edge(c, a);
    return best;
  }

  const TriangleMesh& mesh_;
  RTCDevice device_;
  RTCScene scene_;
};
#endif

}  // namespace twoport::test
