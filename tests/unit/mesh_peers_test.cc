// The nearest point of a mesh against libraries, where they are installed.

#include "tests/support/mesh_peers.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "common/mesh/bounding_volume_tree.h"
#include "tests/support/meshes.h"

namespace twoport::mesh_peers_test {
namespace {

using Eigen::Vector3d;

template <class Peer>
void expect_same_distances(double tolerance) {
  for (const TriangleMesh& mesh : {test::torus_mesh(0.05, 0.02, 105, 48), test::box_mesh({0.02, 0.03, 0.01})}) {
    const BoundingVolumeTree tree{mesh};
    const Peer peer{mesh};
    std::mt19937_64 random{3};
    std::uniform_real_distribution<double> uniform{-0.08, 0.08};
    for (int i = 0; i < 3000; ++i) {
      const double x = uniform(random), y = uniform(random), z = uniform(random);
      const Vector3d p{x, y, z};
      ASSERT_NEAR(std::abs(tree.nearest(p).signed_distance(p)), peer.distance(p), tolerance) << p.transpose();
    }
  }
}

TEST(MeshPeers, CgalFindsTheSameDistance) {
#ifdef TWOPORT_CGAL
  expect_same_distances<test::CgalTree>(1e-15);
#else
  GTEST_SKIP() << "CGAL is not installed (libcgal-dev)";
#endif
}

TEST(MeshPeers, EmbreeFindsTheSameDistance) {
#ifdef TWOPORT_EMBREE
  expect_same_distances<test::EmbreeTree>(1e-8);  // its boxes are in float
#else
  GTEST_SKIP() << "Embree is not installed (libembree-dev)";
#endif
}

}  // namespace
}  // namespace twoport::mesh_peers_test
