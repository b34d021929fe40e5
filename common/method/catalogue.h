#pragma once

#include "common/method/none/none.h"
#include "common/method/tdpa/tdpa.h"

namespace twoport {

template <class... Each>
struct TypeList {};

/// Every method there is. A new one is a folder beside these, its header above, its name here, and the names of its values in
/// proto/scene.proto (Passivity.Method).
using Methods = TypeList<NoControl, TimeDomainPassivity>;

}  // namespace twoport
