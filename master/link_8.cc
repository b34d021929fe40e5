#include "master/run.h"

namespace twoport {

template int run_master<kJointPort>(const Scene&, const LiveArguments&, const Registry&);

}  // namespace twoport
