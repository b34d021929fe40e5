// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("DELAYED_FORCE", DelayedForceMaster, DelayedForceSlave,
              .summary = "the force of the architecture as it arrives", .is_plain = true)
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/transparency/delayed_force/delayed_force.h"
#endif
