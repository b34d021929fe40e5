// A line of common/method/passivity/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("ENERGY_SPRING", EnergySpringMaster, NoPassivitySlave,
              .summary = "at most the force of a spring that holds the energy of the hand's port",
              .claim = Claim{.hand = true}, .passes_on = "ENERGY_SPRING_TWO_PORT")
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/passivity/energy_spring/energy_spring_layer.h"
#include "common/method/passivity/none/none.h"
#endif
