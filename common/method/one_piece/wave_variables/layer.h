// A line of common/method/one_piece/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER(
    "WAVE_VARIABLES", WaveMaster, WaveSlave,
    .summary = "wave variables: the link carries waves whose energy no delay or loss can raise; position is not exact",
    .claim = Claim{}, .refuses_measured_force = "its waves carry the coupling force")
#endif
#ifdef TWOPORT_LAYER_OPTIONS
#include "common/method/one_piece/wave_variables/options.h"
TWOPORT_LAYER_OPTIONS(wave_variables, WaveVariablesOptions)
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/one_piece/wave_variables/wave_variables.h"
#endif
