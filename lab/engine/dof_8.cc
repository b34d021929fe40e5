#include "lab/engine/make_simulation.h"

namespace twoport::lab {

template std::unique_ptr<Simulation<kJointPort>> make_simulation<kJointPort>(const Scene&, Taps<kJointPort>*);

}  // namespace twoport::lab
