#if defined(__SSE2__)
#include <immintrin.h>
#endif

#include "lab/lanes/batch.h"

#define TWOPORT_LANES 4

namespace twoport::lab::lanes::avx2 {
#include "lab/lanes/loop.h"
}  // namespace twoport::lab::lanes::avx2

namespace twoport::lab::lanes {
const Unit kAvx2{"AVX2",
                 4,
                 {avx2::run_method<1, avx2::Part::run>, avx2::run_method<3, avx2::Part::run>},
                 {avx2::run_method<1, avx2::Part::tail>, avx2::run_method<3, avx2::Part::tail>}};
}
