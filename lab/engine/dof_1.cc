#include "lab/engine/loops.h"

namespace twoport::lab {

template std::unique_ptr<Simulation<1>> make_simulation<1>(const Scene&, Taps<1>*);

}  // namespace twoport::lab
