// A lane unit: loop.h compiled for one instruction set, in a namespace that no other unit shares. Included by loop_base.cc and its like.

#if defined(__SSE2__)
#include <immintrin.h>
#endif

#include "lab/lanes/batch.h"

namespace twoport::lab::lanes {
namespace {
#include "lab/lanes/loop.h"
}  // namespace

const Unit TWOPORT_UNIT{TWOPORT_UNIT_NAME,
                        TWOPORT_LANES,
                        {run_method<1, Part::run>, run_method<3, Part::run>},
                        {run_method<1, Part::tail>, run_method<3, Part::tail>}};

}  // namespace twoport::lab::lanes
