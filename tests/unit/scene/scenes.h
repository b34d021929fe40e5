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

/// The two scenes that fix the grammar, one in 6 DoF that has every block and every list, and one with a gripper.
extern const char* const kStiffWall;
extern const char* const kHeldSpring;
extern const char* const kTurning;
extern const char* const kGripper;

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

}  // namespace twoport::test
