// A line of common/method/one_piece/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("SET_POSITION_MODULATION", SetPositionMaster, SetPositionSlave,
              .summary =
                  "passive set-position modulation: each side's spring follows the other's position as far as stored "
                  "energy allows",
              .claim = Claim{.both = true, .robot_port = true, .tick_at_hand = true, .tick_at_robot = true},
              .refuses_measured_force = "it displays the position error")
#endif
#ifdef TWOPORT_LAYER_OPTIONS
#include "common/method/one_piece/set_position_modulation/options.h"
TWOPORT_LAYER_OPTIONS(set_position_modulation, SetPositionModulationOptions)
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/one_piece/set_position_modulation/set_position_modulation.h"
#endif
