#define TWOPORT_LANES 2
#define TWOPORT_UNIT kBase
#define TWOPORT_UNIT_NAME "two lanes"
#include "lab/lanes/unit.h"
