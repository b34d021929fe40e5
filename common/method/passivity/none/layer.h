// A line of common/method/passivity/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("NONE", NoPassivityMaster, NoPassivitySlave, .summary = "everything is displayed", .claim = Claim{})
#else
#include "common/method/passivity/none/none.h"
#endif
