#pragma once

#include <memory>
#include <string>

#include "common/hardware/robot.h"
#include "common/mesh/triangle_mesh.h"

namespace twoport {

/// What a picture shows of a world: what stands still in axes of the world, and the tool in its own [m].
struct WorldPicture {
  TriangleMesh still, tool;
};

/// A robot in a world of its own that goes on by Tick::ended alone, so that it runs in virtual time too: from the same state under the same
/// commands the same to the bit.
template <int N>
class VirtualRobot : public Robot<N> {
 public:
  /// Another one in the same state; neither touches the other.
  [[nodiscard]] virtual std::unique_ptr<VirtualRobot> copy() const = 0;
  /// Adds to the velocity of the tool [m/s], [rad/s].
  virtual void kick(const Velocity<N>& dv) noexcept = 0;
  [[nodiscard]] virtual WorldPicture picture() const = 0;
  /// Differs between worlds.
  [[nodiscard]] virtual std::string fingerprint() const = 0;
};

}  // namespace twoport
