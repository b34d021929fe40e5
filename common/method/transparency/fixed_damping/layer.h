// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("FIXED_DAMPING", FixedDampingMaster, FixedDampingSlave,
              .summary = "a spring between the two positions and a damper at each side",
              .refuses_measured_force = "it displays the position error")
#endif
#ifdef TWOPORT_LAYER_OPTIONS
#include "common/method/transparency/fixed_damping/options.h"
TWOPORT_LAYER_OPTIONS(fixed_damping, FixedDampingOptions)
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/transparency/fixed_damping/fixed_damping.h"
#endif
