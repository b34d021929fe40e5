// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("RANDOM", RandomMaster, DelayedForceSlave,
              .summary = "forces drawn at random, to attack a passivity layer", .is_random = true)
#endif
#ifdef TWOPORT_LAYER_OPTIONS
#include "common/method/transparency/random/options.h"
TWOPORT_LAYER_OPTIONS(random, RandomOptions)
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/transparency/delayed_force/delayed_force.h"
#include "common/method/transparency/random/random.h"
#endif
