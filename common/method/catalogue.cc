#include "common/method/catalogue.h"

#include <algorithm>

namespace twoport {

std::vector<std::string> method_names() {
  return names_of(kMethods);
}
bool keeps_account(const ControlOptions& first, std::span<const ScheduledControl> schedule) {
  const auto keeps = [](const ControlOptions& o) {
    if (o.architecture == Architecture::render) return o.controller.method != Method::none;
    return !passivity_layer(o).is_plain;
  };
  return keeps(first) || std::any_of(schedule.begin(), schedule.end(),
                                     [&](const ScheduledControl& entry) { return keeps(entry.control); });
}

}  // namespace twoport
