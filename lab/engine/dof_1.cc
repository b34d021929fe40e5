#include "lab/engine/make_simulation.h"

namespace twoport::lab {

template std::unique_ptr<Simulation<1>> make_simulation<1>(const Scene&);

}  // namespace twoport::lab
