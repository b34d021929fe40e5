#include "common/record/held_force.h"

#include <limits>

namespace twoport {

std::optional<std::vector<Rest>> rests(const Scene& scene) {
  if (!scene.operator_model) return std::nullopt;
  const bool link = scene.control.architecture != Architecture::render;
  const double round_trip_s = link ? scene.to_slave.delay_s + scene.to_master.delay_s : 0.0;
  constexpr double kForever = std::numeric_limits<double>::infinity();
  std::vector<Rest> all;
  double from_s = 0.0, t_s = 0.0;
  const auto rest_until = [&](double to_s) {
    if (from_s < to_s) all.push_back({from_s, to_s});
  };
  for (const SegmentSpec& segment : scene.operator_model->path) {
    const double start_s = t_s;
    t_s += std::visit([](const auto& s) { return s.duration_s; }, segment);
    if (std::holds_alternative<HoldSpec>(segment)) continue;
    rest_until(start_s);
    from_s = t_s + round_trip_s;
  }
  rest_until(kForever);
  return all;
}

}  // namespace twoport
