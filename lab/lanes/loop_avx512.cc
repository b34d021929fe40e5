#define TWOPORT_LANES 8
#define TWOPORT_UNIT kAvx512
#define TWOPORT_UNIT_NAME "AVX-512"
#include "lab/lanes/unit.h"
