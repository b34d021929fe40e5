// The methods of one piece, in the order in which they are listed. common/method/list.h says how it is read.
// clang-format off
#include "common/method/one_piece/wave_variables/layer.h"
#include "common/method/one_piece/set_position_modulation/layer.h"
