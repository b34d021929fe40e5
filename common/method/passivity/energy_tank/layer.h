// A line of common/method/passivity/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("ENERGY_TANK", EnergyTankMaster, EnergyTankSlave,
              .summary = "a tank of energy at each side; the tanks exchange energy and the hand fills them",
              .claim = Claim{.both = true, .robot_port = true, .tick_at_hand = true, .tick_at_robot = true})
#else
#include "common/method/passivity/energy_tank/energy_tank.h"
#endif
