// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("LOCAL_DAMPING", LocalDampingMaster, LocalDampingSlave,
              .summary = "the delayed force and a damper at the master",
              .figures = {{.name = "local_damping_power_w", .unit = "W"},
                          {.name = "robot_speed_m_per_s", .unit = "m/s"}})
#endif
#ifdef TWOPORT_LAYER_OPTIONS
#include "common/method/transparency/local_damping/options.h"
TWOPORT_LAYER_OPTIONS(local_damping, LocalDampingOptions)
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/transparency/local_damping/local_damping.h"
#endif
