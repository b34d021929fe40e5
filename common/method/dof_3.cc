#include "common/method/classes.h"

namespace twoport {

TWOPORT_MAKE(3);

}  // namespace twoport
