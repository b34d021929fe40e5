// The transparency layers, in the order in which they are listed; the first is the default. common/method/list.h says how it is read.
// clang-format off
#include "common/method/transparency/internal_model/layer.h"
#include "common/method/transparency/delayed_force/layer.h"
#include "common/method/transparency/surface_model/layer.h"
#include "common/method/transparency/contact_spring/layer.h"
#include "common/method/transparency/four_channel/layer.h"
#include "common/method/transparency/fixed_damping/layer.h"
#include "common/method/transparency/fractal_impedance/layer.h"
#include "common/method/transparency/random/layer.h"
#include "common/method/transparency/plugin/layer.h"
