#include "common/method/classes.h"
#include "common/method/render/render.h"

namespace twoport {

TWOPORT_MAKE(3);
template class GodObject<3>;
template class Rendering<3>;

}  // namespace twoport
