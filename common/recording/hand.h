#pragma once

#include <string>
#include <vector>

namespace twoport {

/// The hand in the recording of a master: its position over time since the first contact.
struct RecordedHand {
  int dof = 0;
  std::vector<double> t_s;   ///< increasing
  std::vector<double> x, v;  ///< for each time 1, 3 or 7 numbers (x y z, unit quaternion w x y z), and 1, 3 or 6
};

/// Of a master's handle, or of its gripper, whose position is the opening. Throws ConfigError with the path and the reason for what is
/// no recording of a master, has no gripper, or is damaged.
RecordedHand read_recorded_hand(const std::string& path, bool of_gripper = false);

}  // namespace twoport
