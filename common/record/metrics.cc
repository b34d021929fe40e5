#include "common/record/metrics.h"

namespace twoport {

TWOPORT_COMPILE(Metrics);

}  // namespace twoport
