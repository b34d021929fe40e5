#include "common/method/classes.h"

namespace twoport {

TWOPORT_MAKE(1);

}  // namespace twoport
