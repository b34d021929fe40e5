// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("RANDOM", RandomMaster, DelayedForceSlave,
              .summary = "forces drawn at random, to attack a passivity layer", .is_random = true)
#else
#include "common/method/transparency/delayed_force/delayed_force.h"
#include "common/method/transparency/random/random.h"
#endif
