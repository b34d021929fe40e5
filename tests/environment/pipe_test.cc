// The pipe of docs/guides/add-an-environment.md, in the tree that new_environment.sh makes: read from a scene, and touched.

#include <google/protobuf/text_format.h>

#include <cmath>
#include <cstdio>
#include <random>
#include <string>

#include "common/base/check.h"
#include "common/contact/environment.h"
#include "common/scene/blocks.h"

namespace {

using namespace twoport;

int failures = 0;
void expect(bool holds, const std::string& what) {
  if (holds) return;
  std::printf("not so: %s\n", what.c_str());
  ++failures;
}

EnvironmentSpec read(int dof, const std::string& text) {
  schema::Environment message;
  expect(google::protobuf::TextFormat::ParseFromString(text, &message), "the schema has it: " + text);
  const Context context{.file = "scene", .dof = dof};
  const Block of{context, message, "environment[0]"};
  of.check_fields();
  return read_environment(of);
}
std::string refusal(int dof, const std::string& text) {
  try {
    read(dof, text);
    return "";
  } catch (const ConfigError& e) {
    return e.what();
  }
}

}  // namespace

int main() {
  const std::string tube = "pipe { point_m: [0.01, 0, 0] axis: [1, 2, 2] outer_radius_m: 0.05 ";
  const EnvironmentSpec spec = read(3, tube + "inner_radius_m: 0.02 stiffness_n_per_m: 3000 }");
  expect(std::string{name(spec)} == "pipe", "its name is pipe");
  const Environment<3> environment{{spec}};

  // The force is minus the gradient of the potential. Central differences of h = 1e-6 m err by U'''h²/6, below
  // 1e-5 N here, and by rounding, U 1e-16/h.
  std::mt19937_64 random{7};
  std::uniform_real_distribution<double> uniform{-0.08, 0.08};
  int touched = 0;
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector3d x{uniform(random), uniform(random), uniform(random)};
    const Eigen::Vector3d f = environment.force(Position<3>{x}, Velocity<3>{}).vec();
    if (f.norm() == 0.0) continue;
    const auto potential = [&](const Eigen::Vector3d& at) { return environment.potential(Position<3>{at}).si(); };
    Eigen::Vector3d slope;
    for (int axis = 0; axis < 3; ++axis) {
      const Eigen::Vector3d h = 1e-6 * Eigen::Vector3d::Unit(axis);
      slope[axis] = (potential(x + h) - potential(x - h)) / 2e-6;
    }
    // In the middle of the wall the potential has an edge.
    if (f.norm() < 0.99 * 3000 * 0.015) ++touched, expect((f + slope).norm() < 1e-4, "the force has a potential");
  }
  expect(touched > 500, "the pipe is touched");
  const Eigen::Vector3d across = Eigen::Vector3d{2, -1, 0}.normalized();
  const auto at = [&](double r) { return Position<3>{Eigen::Vector3d{Eigen::Vector3d{0.01, 0, 0} + r * across}}; };
  expect(environment.force(at(0.01), {}).squared_norm() == 0.0, "its bore is empty");
  expect(std::abs(environment.force(at(0.045), {}).vec().dot(across) - 15.0) < 1e-9,
         "5 mm deep it pushes outwards with 15 N");
  expect(std::abs(environment.force(at(0.025), {}).vec().dot(across) + 15.0) < 1e-9,
         "5 mm deep from the bore it pushes inwards with 15 N");

  expect(refusal(1, "pipe { inner_radius_m: 1 }") ==
             "scene: environment[0].pipe is given, but dof is 1; a pipe needs dof 3 or 6",
         "one axis: " + refusal(1, "pipe { inner_radius_m: 1 }"));
  expect(refusal(3, tube + "inner_radius_m: 0.06 }")
             .ends_with("environment[0].pipe.inner_radius_m is 0.06; it must be < outer_radius_m (0.05)"),
         "too thin: " + refusal(3, tube + "inner_radius_m: 0.06 }"));
  return failures == 0 ? 0 : 1;
}
