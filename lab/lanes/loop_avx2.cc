#define TWOPORT_LANES 4
#define TWOPORT_UNIT kAvx2
#define TWOPORT_UNIT_NAME "AVX2"
#include "lab/lanes/unit.h"
