// A line of common/method/passivity/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER(
    "ENERGY_BOUNDING", EnergyBoundingMaster, NoPassivitySlave,
    .summary = "the device's own damping covers every next motion",
    .claim = Claim{.hand = true, .device_damping = true},
    .refusal = [](const ControlOptions& o) -> std::string_view {
      if (o.energy_bounding.damping_n_s_per_m || o.known.device_damping_n_s_per_m > 0.0) return "";
      return "be another one where device.damping_n_s_per_m is 0, or "
             "control.passivity.energy_bounding.damping_n_s_per_m must "
             "be given: it needs damping of the device";
    },
    .voids_hand = [](const ControlOptions& o) -> std::string_view {
      const EnergyBoundingOptions& b = o.energy_bounding;
      const bool more =
          b.damping_n_s_per_m.value_or(0.0) > o.known.device_damping_n_s_per_m ||
          b.rotational_damping_n_m_s_per_rad.value_or(0.0) > o.known.device_rotational_damping_n_m_s_per_rad;
      return more ? "control.passivity.energy_bounding states more damping than the device has" : "";
    })
#endif
#ifdef TWOPORT_LAYER_OPTIONS
#include "common/method/passivity/energy_bounding/options.h"
TWOPORT_LAYER_OPTIONS(energy_bounding, EnergyBoundingOptions)
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/passivity/energy_bounding/energy_bounding.h"
#include "common/method/passivity/none/none.h"
#endif
