#include "common/method/classes.h"

namespace twoport {

TWOPORT_MAKE(6);

}  // namespace twoport
