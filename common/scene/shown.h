#pragma once

#include <cstddef>
#include <string>
#include <variant>
#include <vector>

#include "common/contact/revolved.h"
#include "common/contact/simple_solids.h"
#include "common/mesh/triangle_mesh.h"
#include "common/scene/scene.h"

namespace twoport {

inline constexpr std::size_t kMostShownTriangles = 10'000;  ///< of a scene without its arm, and of an arm

struct ShownArm {
  std::vector<TriangleMesh>
      links;  ///< of the base, then of the link behind each joint, in its axes; none: nothing is known
  std::vector<std::string> left_out;  ///< what cannot be read, a sentence for each link
  bool as_robot = false;              ///< of a leader: it has the robot's file, and so the robot's links
};

/// Shapes that a picture shows, and no computation needs: from the blocks and files that a scene was read from.
struct ShownShapes {
  std::vector<TriangleMesh> meshes;  ///< of the environment's meshes, in their order, in the world's axes; decimated
  std::vector<std::variant<Torus, Capsule, Peg, Cone, TriangleMesh>> tool_parts;  ///< in the tool's axes
  std::size_t tool_alone = 0;  ///< so many first contact points of the tool belong to no part
};
/// Empty for a scene that a program has made. Throws ConfigError where a mesh file cannot be read any more.
ShownShapes shown_shapes(const Scene& scene);
/// What the files of its meshes have and the meshes have not, a sentence each; throws as shown_shapes.
std::vector<std::string> left_out_of_meshes(const Scene& scene);
/// Of the robot's arm, or of the leader's, decimated; in the same way.
ShownArm shown_arm(const Scene& scene, bool of_leader = false);

}  // namespace twoport
