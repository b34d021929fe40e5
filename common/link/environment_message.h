#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "common/link/sensor_rest.h"

namespace twoport {

/// Surfaces of an environment that a packet tells of: the first ones in the scene's order.
inline constexpr std::size_t kAdjustableSurfaces = 4;
/// Joints of an arm that it tells of.
inline constexpr std::size_t kMostJoints = 8;
/// Limits of what may be asked for; a scene may have more.
inline constexpr double kSurfaceStiffnessMost = 1e6, kSurfaceFrictionMost = 2.0;  // [N/m], [1]

/// Whether the surfaces of the slave's environment can be changed while running, and if not, why.
enum class EnvironmentAnswer : std::uint8_t { none, adjustable, real, fixed, no_surface, arm, out_of_range };
inline constexpr std::size_t kEnvironmentAnswers = 7;

/// The answer as a sentence; empty where there is nothing to say.
constexpr std::string_view sentence(EnvironmentAnswer answer) {
  constexpr std::string_view kSentences[kEnvironmentAnswers] = {
      "The slave has not answered yet.",
      "",
      "The slave's robot is not simulated: its environment is what it is.",
      "The slave was started with --fixed-environment.",
      "The environment has no surface.",
      "The robot is an arm: its model takes no changes while running.",
      "The slave has refused the last values: a stiffness must be > 0 and <= 1e6 N/m, a friction from 0 to 2."};
  return kSentences[static_cast<std::size_t>(answer)];
}

/// What a packet says of the environment's surfaces and of the robot's force sensor. From the master: requests; from the slave: the state,
/// and what a page shows of the robot besides. A request is repeated in every packet, so that a lost one delays it only.
struct EnvironmentMessage {
  struct Surface {
    double stiffness_n_per_m = 0.0;
    double friction = 0.0;  ///< from the slave: negative where it cannot be changed
  };

  std::uint32_t number =
      0;  ///< 0: nothing is said; 1: asks for the state; from 2 on: changes. The slave returns the newest
  EnvironmentAnswer answer = EnvironmentAnswer::none;  ///< from the slave
  double energy_j = 0.0;                               ///< from the slave: that changes of stiffness have put in so far
  std::uint8_t count = 0;                              ///< of surfaces; a request without surfaces changes none
  std::array<Surface, kAdjustableSurfaces> surface{};
  double link_energy_j = 0.0;  ///< from the slave: net energy that has entered the link at the robot
  std::uint8_t joints = 0;     ///< from the slave: of the robot's arm
  std::array<double, kMostJoints> joint_rad{};
  bool has_object = false;           ///< from the slave: there is a box that the robot's fingers may take
  std::array<double, 3> object_m{};  ///< its centre, in the axes of the environment
  std::uint32_t zero_number =
      0;  ///< from the master: requests to zero the force sensor so far; from the slave: the newest one answered
  ZeroAnswer zero_answer = ZeroAnswer::none;  ///< from the slave
  double sensor_drift_n = 0.0;                ///< from the slave: SensorRest::drift_n

  [[nodiscard]] bool finite() const noexcept {
    const auto is_finite = [](double x) { return std::isfinite(x); };
    return std::isfinite(energy_j) && std::isfinite(link_energy_j) && std::isfinite(sensor_drift_n) &&
           std::all_of(joint_rad.begin(), joint_rad.begin() + joints, is_finite) &&
           std::all_of(object_m.begin(), object_m.end(), is_finite) &&
           std::all_of(surface.begin(), surface.begin() + count, [](const Surface& s) {
             return std::isfinite(s.stiffness_n_per_m) && std::isfinite(s.friction);
           });
  }
};

}  // namespace twoport
