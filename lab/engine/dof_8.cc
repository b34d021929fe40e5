#include "lab/engine/loops.h"

namespace twoport::lab {

template std::unique_ptr<Simulation<kJointPort>> make_simulation<kJointPort>(const Scene&, Taps<kJointPort>*);

}  // namespace twoport::lab
