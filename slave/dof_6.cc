#include "slave/run.h"

namespace twoport {

template int run_slave<6>(const Scene&, const LiveArguments&, const Registry&);

}  // namespace twoport
