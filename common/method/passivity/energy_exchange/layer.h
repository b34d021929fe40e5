// A line of common/method/passivity/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER(
    "ENERGY_EXCHANGE", EnergyExchangeMaster, EnergyExchangeSlave,
    .summary =
        "an energy spring at each side; the two exchange energy until both have the same, and the hand pays what is "
        "spent",
    .claim = Claim{.hand = true, .both = true, .robot_port = true, .tick_at_robot = true, .in_hand_joules = true},
    .exchanges = true, .passes_on = "ENERGY_SPRING_TWO_PORT")
TWOPORT_LAYER(
    "ENERGY_SPRING_TWO_PORT", EnergyExchangeMaster, EnergyExchangeSlave,
    .summary =
        "the same without the bound of the hand's port alone: an environment that moves is felt as long as it does",
    .claim = Claim{.both = true, .robot_port = true, .tick_at_robot = true, .in_hand_joules = true}, .exchanges = true)
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/passivity/energy_exchange/energy_exchange.h"
#endif
