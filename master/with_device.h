#pragma once

#include <algorithm>
#include <cstdint>

#include "common/coupling/options.h"
#include "common/hardware/device.h"
#include "common/scene/scene.h"

namespace twoport {

/// Bits as ControlOptions::without_motor: the translation of a device that displays no force, the rotation of one that displays no torque,
/// or no force and says nothing of torque.
inline std::uint8_t without_motor(const Scene& scene, const DeviceInfo& info) {
  const bool no_force = info.max_force_n == 0.0;
  const bool no_torque = info.limits.torque_n_m == 0.0 || (no_force && info.limits.torque_n_m == PortLimits::kNone);
  const unsigned translation = scene.dof == 1 ? 1U : 7U;
  return static_cast<std::uint8_t>((no_force ? translation : 0U) | (scene.dof == 6 && no_torque ? 0x38U : 0U));
}

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
    if (info.max_force_n > 0.0) control.max_force_n = std::min(control.max_force_n, info.max_force_n);
    control.without_motor |= without_motor(scene, info);
  };
  complete(scene.control);
  for (ScheduledControl& entry : scene.schedule) complete(entry.control);
  // No limit of a force that has no motor: the whole wrench would be scaled by it.
  scene.control.own_limits = info.limits;
  double& torque_n_m = scene.control.own_limits.torque_n_m;
  if (torque_n_m == 0.0) torque_n_m = PortLimits::kNone;
  return scene;
}

}  // namespace twoport
