#include "common/method/catalogue.h"

#include <algorithm>

namespace twoport {

std::vector<std::string> method_names() {
  std::vector<std::string> all;
  for (const MethodName& each : kMethods) all.emplace_back(each.name);
  return all;
}
bool keeps_account(const ControlOptions& first, std::span<const ScheduledControl> schedule) {
  const auto keeps = [](const ControlOptions& o) {
    if (o.architecture == Architecture::render) return o.controller.method != Method::none;
    const MethodName* method = find_name(kMethods, o.method_name);
    return method != nullptr && method->one_piece() ? true : !o.passivity.empty() && o.passivity != "NONE";
  };
  return keeps(first) || std::any_of(schedule.begin(), schedule.end(),
                                     [&](const ScheduledControl& entry) { return keeps(entry.control); });
}

double two_port_grants(std::string_view passivity_layer) {
  const PassivityLayerName* layer = find_name(kPassivityLayers, passivity_layer);
  return layer != nullptr && layer->claim.both ? 2.0 : 0.0;
}

}  // namespace twoport
