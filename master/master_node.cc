#include "master/master_node.h"

namespace twoport {

TWOPORT_COMPILE(MasterNode);

}  // namespace twoport
