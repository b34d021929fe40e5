#include "slave/run.h"

namespace twoport {

template int run_slave<1>(const Scene&, const LiveArguments&, const Registry&);

}  // namespace twoport
