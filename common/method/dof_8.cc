#include "common/method/classes.h"

namespace twoport {

TWOPORT_MAKE(8);

}  // namespace twoport
