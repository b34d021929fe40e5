#include "common/method/classes.h"
#include "common/method/render/render.h"

namespace twoport {

TWOPORT_MAKE(6);
template class GodObject<6>;
template class Rendering<6>;

}  // namespace twoport
