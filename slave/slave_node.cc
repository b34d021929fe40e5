#include "slave/slave_node.h"

namespace twoport {

TWOPORT_COMPILE(SlaveNode);

}  // namespace twoport
