#include "common/method/classes.h"
#include "common/method/render/render.h"

namespace twoport {

TWOPORT_MAKE(1);
template class GodObject<1>;
template class Rendering<1>;

}  // namespace twoport
