#include "master/run.h"

namespace twoport {

template int run_master<3>(const Scene&, const LiveArguments&, const Registry&);

}  // namespace twoport
