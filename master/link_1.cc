#include "master/run.h"

namespace twoport {

template int run_master<1>(const Scene&, const LiveArguments&, const Registry&);

}  // namespace twoport
