// A line of common/method/passivity/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("NONE", NoPassivityMaster, NoPassivitySlave, .summary = "everything is displayed", .is_plain = true,
              .claim = Claim{})
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/passivity/none/none.h"
#endif
