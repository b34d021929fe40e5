// The methods of one piece, in the order in which they are listed.
// common/coupling/layers.h reads their entries, with TWOPORT_LAYER(name, class at the master, class at the slave, entry); without that
// macro this includes their classes.
// clang-format off
#include "common/method/one_piece/wave_variables/layer.h"
#include "common/method/one_piece/set_position_modulation/layer.h"
