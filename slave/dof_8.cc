#include "slave/run.h"

namespace twoport {

template int run_slave<kJointPort>(const Scene&, const LiveArguments&, const Registry&);

}  // namespace twoport
