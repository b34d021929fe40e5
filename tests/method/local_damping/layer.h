// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("LOCAL_DAMPING", LocalDampingMaster, DelayedForceSlave,
              .summary = "the delayed force and a damper at the master",
              .figures = {{.name = "local_damping_power_w", .unit = "W"}})
#else
#include "common/method/transparency/local_damping/local_damping.h"
#endif
