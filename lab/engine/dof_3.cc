#include "lab/engine/loops.h"

namespace twoport::lab {

template std::unique_ptr<Simulation<3>> make_simulation<3>(const Scene&, Taps<3>*);

}  // namespace twoport::lab
