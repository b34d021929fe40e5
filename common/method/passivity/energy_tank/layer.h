// A line of common/method/passivity/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("ENERGY_TANK", EnergyTankMaster, EnergyTankSlave,
              .summary = "a tank of energy at each side; the tanks exchange energy and the hand fills them",
              .claim = Claim{.both = true, .robot_port = true, .tick_at_hand = true, .tick_at_robot = true})
#endif
#ifdef TWOPORT_LAYER_OPTIONS
#include "common/method/passivity/energy_tank/options.h"
TWOPORT_LAYER_OPTIONS(energy_tank, EnergyTankOptions)
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/passivity/energy_tank/energy_tank.h"
#endif
