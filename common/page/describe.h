#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/scene/scene.h"
#include "common/scene/shown.h"

namespace twoport {

/// What the page is told once, when it connects.
struct PageIntroduction {
  std::string device;         ///< name of the haptic device
  bool has_pointer = false;   ///< is it the page's own (--device page)?
  bool restarts = false;      ///< may the page have both programs started again?
  double grip_n_per_m = 0.0;  ///< initial stiffness of the hand, of the page's device
  std::vector<std::string>
      methods;  ///< that may be chosen while running: that of epoch e is number e modulo their number; empty: none may
  std::optional<ShownShapes> world = std::nullopt;  ///< in place of the scene's environment and tool
};

/// Scene, samples' layout and limits of the commands as JSON.
std::string describe_for_page(const Scene& scene, const PageIntroduction& introduction);

/// The page: one HTML file, held in the program.
std::string_view page_html();

}  // namespace twoport
