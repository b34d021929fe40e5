#if defined(__SSE2__)
#include <immintrin.h>
#endif

#include "lab/lanes/batch.h"

#define TWOPORT_LANES 8

namespace twoport::lab::lanes::avx512 {
#include "lab/lanes/loop.h"
}  // namespace twoport::lab::lanes::avx512

namespace twoport::lab::lanes {
const Unit kAvx512{"AVX-512",
                   8,
                   {avx512::run_method<1, avx512::Part::run>, avx512::run_method<3, avx512::Part::run>},
                   {avx512::run_method<1, avx512::Part::tail>, avx512::run_method<3, avx512::Part::tail>}};
}
