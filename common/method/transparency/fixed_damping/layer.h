// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("FIXED_DAMPING", FixedDampingMaster, FixedDampingSlave,
              .summary = "a spring between the two positions and a damper at each side",
              .refuses_measured_force = "it displays the position error")
#else
#include "common/method/transparency/fixed_damping/fixed_damping.h"
#endif
