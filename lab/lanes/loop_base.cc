#if defined(__SSE2__)
#include <immintrin.h>
#endif

#include "lab/lanes/batch.h"

#define TWOPORT_LANES 2

namespace twoport::lab::lanes::base {
#include "lab/lanes/loop.h"
}  // namespace twoport::lab::lanes::base

namespace twoport::lab::lanes {
const Unit kBase{"two lanes",
                 2,
                 {base::run_method<1, base::Part::run>, base::run_method<3, base::Part::run>},
                 {base::run_method<1, base::Part::tail>, base::run_method<3, base::Part::tail>}};
}
