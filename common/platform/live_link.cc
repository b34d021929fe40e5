#include "common/platform/live_link.h"

namespace twoport {

TWOPORT_COMPILE(LiveLink);

}  // namespace twoport
