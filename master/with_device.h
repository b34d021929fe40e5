#pragma once

#include <algorithm>

#include "common/coupling/options.h"
#include "common/hardware/device.h"
#include "common/scene/scene.h"

namespace twoport {

/// The scene completed from the driver: the mass at the handle if the scene has none, and the smaller of the two force
/// limits.
inline Scene with_device(Scene scene, const DeviceInfo& info) {
  const bool has_mass = scene.device && scene.device->mass_kg > 0.0;
  const double scale = scene.device_mount.scale;  // m = m_d / s²: the same kinetic energy
  const bool has_inertia = scene.device && scene.device->inertia_kg_m2 > 0.0;
  const auto complete = [&](ControlOptions& control) {
    if (!has_mass && info.mass_kg > 0.0) {
      control.handle_mass_kg = info.mass_kg;
    } else if (scale != 1.0) {
      control.handle_mass_kg /= scale * scale;
    }
    if (!has_inertia && info.inertia_kg_m2 > 0.0) control.handle_inertia_kg_m2 = info.inertia_kg_m2;
    control.max_force_n = std::min(control.max_force_n, info.max_force_n);
  };
  complete(scene.control);
  for (ScheduledControl& entry : scene.schedule) complete(entry.control);
  scene.control.own_limits = info.limits;
  return scene;
}

}  // namespace twoport
