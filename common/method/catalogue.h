#pragma once

#include "common/method/internal_model/internal_model.h"
#include "common/method/none/none.h"
#include "common/method/tdpa/tdpa.h"

namespace twoport {

template <class... Each>
struct TypeList {};

/// All methods. For a new one: a folder beside these, its header above, its type here, and its names in
/// proto/scene.proto (Passivity.Method).
using Methods = TypeList<NoControl, TimeDomainPassivity, InternalModelControl>;

}  // namespace twoport
