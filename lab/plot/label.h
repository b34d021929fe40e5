#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace twoport::lab {

/// Label of a number on an axis, in a legend or a title.
struct Label {
  std::string words, unit;  ///< unit: "N/m"; empty where there is none

  /// "wall stiffness [N/m]"
  [[nodiscard]] std::string text() const;
  friend bool operator==(const Label&, const Label&) = default;
};

/// Of a path into a scene, or of several linked ones:
///
///     environment[0].wall.stiffness_n_per_m    wall stiffness [N/m]
///     to_slave.delay_ms                        delay to the slave [ms]
///     to_slave.delay_ms, to_master.delay_ms    delay each way [ms]
Label label_of_paths(const std::vector<std::string>& paths);

/// Of a figure of the summary; KEY_sd and KEY_worst are over seeds:
///
///     position_error_rms_m    position error, rms [m]
///     drift_m_worst           drift, worst seed [m]
Label label_of_figure(std::string_view key);

}  // namespace twoport::lab
