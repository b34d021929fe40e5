#pragma once

#include <numbers>
#include <optional>
#include <string>
#include <vector>

namespace twoport {

/// A servo and how it is built into its joint: q = ±(angle - zero_rad).
struct ServoMount {
  int id;
  bool reversed = false;
  double zero_rad = std::numbers::pi;
  std::optional<double> torque_per_current_n_m_per_a{};  ///< nothing: that of its model
};

/// Of a file (proto/servos.proto) for an arm of `joints` joints. Throws ConfigError with one sentence.
std::vector<ServoMount> load_servos(const std::string& path, int joints);

}  // namespace twoport
