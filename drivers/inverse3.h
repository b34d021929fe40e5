#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

namespace twoport {

/// What the Haply Inverse Service says of an Inverse3.
struct Inverse3State {
  std::string id;
  Eigen::Vector3d x_m, v_m_per_s;
};

/// From a message of the service (Inverse SDK 3.5, "WebSocket Protocol"), of the device `id`, or the first one where `id` is empty. Nothing
/// for what is no JSON or is nested deeper than 32, for a device that is not there, has no number or one beyond 100 m or 100 m/s, or says
/// that it is not calibrated.
std::optional<Inverse3State> read_inverse3(const std::string& message, const std::string& id);

/// The command "push the hand with `push_n` until the next command" (Inverse SDK 3.5, "Control Commands"); `first`: of a connection.
std::string inverse3_command(const std::string& id, const Eigen::Vector3d& push_n, bool first);

}  // namespace twoport
