// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("FRACTAL_IMPEDANCE", FractalImpedanceMaster, FractalImpedanceSlave,
              .summary = "springs that give back less than they take",
              .refuses_measured_force = "it displays the position error")
#endif
#ifdef TWOPORT_LAYER_OPTIONS
#include "common/method/transparency/fractal_impedance/options.h"
TWOPORT_LAYER_OPTIONS(fractal_impedance, FractalImpedanceOptions)
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/transparency/fractal_impedance/fractal_impedance.h"
#endif
