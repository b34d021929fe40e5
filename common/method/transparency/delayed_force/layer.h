// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("DELAYED_FORCE", DelayedForceMaster, DelayedForceSlave,
              .summary = "the force of the architecture as it arrives")
#else
#include "common/method/transparency/delayed_force/delayed_force.h"
#endif
