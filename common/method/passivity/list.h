// The passivity layers, in the order in which they are listed; the first is the default. common/method/list.h says how it is read.
// clang-format off
#include "common/method/passivity/energy_spring/layer.h"
#include "common/method/passivity/energy_exchange/layer.h"
#include "common/method/passivity/none/layer.h"
#include "common/method/passivity/time_domain/layer.h"
#include "common/method/passivity/energy_tank/layer.h"
#include "common/method/passivity/energy_bounding/layer.h"
