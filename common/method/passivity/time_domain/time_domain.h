#pragma once

#include "common/method/passivity/time_domain/master.h"
#include "common/method/passivity/time_domain/slave.h"
#include "common/method/transparency/delayed_force/delayed_force.h"

namespace twoport {

/// CLASSIC and FORCE_PROJECTED, chosen when the program is compiled.
using TimeDomainPassivity = StaticPair<DelayedForceMaster, DelayedForceSlave, TimeDomainMaster, TimeDomainSlave>;

}  // namespace twoport
