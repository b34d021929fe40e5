// A line of common/method/passivity/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER(
    "CLASSIC", TimeDomainMaster, TimeDomainSlave,
    .summary = "two-port time domain passivity, correction along the velocity, as far as its largest damping reaches",
    .claim = Claim{}, .controller = Method::classic)
TWOPORT_LAYER("FORCE_PROJECTED", TimeDomainMaster, TimeDomainSlave,
              .summary = "two-port time domain passivity, correction along the force",
              .claim = Claim{.hand = true, .both = true, .predicts = true}, .controller = Method::force_projected)
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/passivity/time_domain/time_domain.h"
#endif
