// All layers and methods of one piece. A file that includes a list defines one of these macros before, for what it wants of each layer.h:
//
//     TWOPORT_LAYER(name, class at the master, class at the slave, entry)    common/coupling/layers.h, common/method/classes.h
//     TWOPORT_LAYER_OPTIONS(block of the scene, struct)                      its options, if it has any: common/coupling/options.h
//     TWOPORT_LAYER_CLASSES                                                  includes its classes
// clang-format off
#include "common/method/transparency/list.h"
#include "common/method/passivity/list.h"
#include "common/method/one_piece/list.h"
