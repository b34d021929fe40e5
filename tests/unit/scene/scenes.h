#pragma once

#include <gtest/gtest.h>

#include <string>
#include <variant>
#include <vector>

#include "common/scene/load.h"

// What the tests of scene reading share.

namespace twoport::test {

using Eigen::Vector3d;
using Overrides = std::vector<std::string>;

/// The two scenes that fix the grammar, and one in 6 DoF that has every block and every list.
extern const char* const kStiffWall;
extern const char* const kHeldSpring;
extern const char* const kTurning;

/// The scene that `text` is, read as the file "scenes/x.textproto".
Scene scene_of(const std::string& text, const Overrides& overrides = {});
/// The sentence of the error that reading it makes; empty if it reads.
std::string error_of(const std::string& text, const Overrides& overrides = {});

/// What one of a scene's environment is: the shape and the material of a surface.
template <class S>
S shape_of(const EnvironmentSpec& spec) {
  return std::get<S>(std::get<Surface>(spec).shape);
}
inline Material material_of(const EnvironmentSpec& spec) {
  return std::get<Surface>(spec).material;
}

/// Does `sentence` contain each of `words`?
::testing::AssertionResult says(const std::string& sentence, const std::vector<std::string>& words);

/// A scene that must not read, and what its error says.
struct Refusal {
  const char* scene;
  Overrides overrides;
  const char* sentence;  ///< after "scenes/x.textproto: ", or the beginning of it
};
/// The error of each names file, path, value and what is allowed.
class RefusedScene : public ::testing::TestWithParam<Refusal> {};

/// "environment_0_wall_friction_is_minus_1": the name of a case.
std::string name_of(const ::testing::TestParamInfo<Refusal>& refusal);

}  // namespace twoport::test
