#pragma once

#include <bit>
#include <cstdint>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "common/scene/scene.h"
#include "sim/operator/path.h"
#include "sim/sim_device.h"

namespace twoport::lab::lanes {

/// What the operator's intended positions follow from.
inline std::string path_key(const Scene& scene) {
  std::string key;
  const auto add = [&](double v) { key.append(reinterpret_cast<const char*>(&v), sizeof v); };
  const auto add_all = [&](const Numbers& n) {
    add(static_cast<double>(n.size()));
    for (const double v : n) add(v);
  };
  add(scene.master_rate_hz), add(scene.duration_s);
  if (scene.device) add_all(scene.device->position_m);
  add(scene.device ? 1.0 : 0.0);
  const OperatorSpec& o = *scene.operator_model;
  for (const SegmentSpec& segment : o.path) {
    add(static_cast<double>(segment.index()));
    add(std::visit([](const auto& s) { return s.duration_s; }, segment));
    if (const auto* move = std::get_if<MoveToSpec>(&segment)) add_all(move->position_m);
    if (const auto* sine = std::get_if<SineSpec>(&segment))
      add(sine->axis), add(sine->amplitude_m), add(sine->frequency_hz);
    if (const auto* screw = std::get_if<ScrewSpec>(&segment)) {
      add_all(screw->point_m), add_all(screw->axis);
      add(screw->angle_rad), add(screw->travel_m), add(screw->frequency_hz);
    }
  }
  if (o.tremor) {
    add(o.tremor->rms_m), add(o.tremor->low_hz), add(o.tremor->high_hz);
    add(std::bit_cast<double>(scene.seed));
  }
  return key;
}

/// Intended positions at each tick of a scene, and what else the path says.
struct Intended {
  std::vector<double> x;
  std::vector<sim::SegmentTimes> segments;
  double end_s = 0.0;
};
template <int N>
std::shared_ptr<const Intended> intended_of(const sim::SimDevice<N>& device, const Scene& scene, std::int64_t ticks) {
  sim::Path<N> path = device.path();
  auto all = std::make_shared<Intended>();
  const double dt = Seconds{1.0 / scene.master_rate_hz}.si();
  all->x.reserve(static_cast<std::size_t>((ticks + 1) * N));
  for (std::int64_t k = 0; k <= ticks; ++k) {
    const auto at = path.at(k == 0 ? 0.0 : static_cast<double>(k) * dt);
    for (int i = 0; i < N; ++i) all->x.push_back(at.x.translation()[i]);
  }
  all->segments = path.segment_times();
  all->end_s = path.end_s();
  return all;
}

}  // namespace twoport::lab::lanes
