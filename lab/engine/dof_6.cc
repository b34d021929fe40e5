#include "lab/engine/loops.h"

namespace twoport::lab {

template std::unique_ptr<Simulation<6>> make_simulation<6>(const Scene&, Taps<6>*);

}  // namespace twoport::lab
