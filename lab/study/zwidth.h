#pragma once

#include <string>
#include <utility>
#include <vector>

#include "lab/study/sweep.h"

namespace twoport::lab {

/// Z-width (Colgate and Brown, ICRA 1994): which stiffness and damping a device can display stably.
struct ZWidthOptions {
  std::string scene;             ///< one axis, RENDER, one wall or spring, no Coulomb friction
  std::vector<std::string> set;  ///< overrides, applied before those that vary
  std::string damping = "0:300:16", stiffness = "500:500000:31:log";  ///< values as --vary takes them
  std::string methods = "NONE,CLASSIC,FORCE_PROJECTED";
  int jobs = 1;
  int lanes = 0;  ///< as ManyRuns::lanes
  std::string out;
};

/// The map, and theory without a controller.
struct ZWidth {
  std::string scene;             ///< its name
  Table table;                   ///< axes: damping, stiffness, method
  std::vector<double> damping;   ///< [N s/m]
  std::vector<double> critical;  ///< stiffness at which eigenvalues leave the unit circle [N/m]
  std::vector<double> passive;   ///< Colgate: K <= 2 (b - B)/T; 0 where there is none [N/m]
  std::vector<std::string> methods;
  std::vector<std::vector<double>> displayed;     ///< [method][damping]: up to which every K of the grid is stable
  std::vector<std::pair<double, double>> border;  ///< `critical` between the dampings, for a picture
  /// Was the run stable? Numbers of the values of the axes.
  [[nodiscard]] bool stable(std::size_t damping, std::size_t stiffness, std::size_t method) const;
};

/// Runs the grid (resuming what OUT holds) and computes the theory: SampledWall with the mass, damping and stiffness of
/// device and hand together. Throws ConfigError when the theory does not cover the scene.
ZWidth z_width(const ZWidthOptions& options, const Heard& heard = {});

/// One line for each damping: theory, then each method.
std::string to_text(const ZWidth& z);

}  // namespace twoport::lab
