#include "common/method/classes.h"

namespace twoport {

template std::unique_ptr<MasterHalf<1>> MasterHalf<1>::make(const ControlOptions&);
template std::unique_ptr<SlaveHalf<1>> SlaveHalf<1>::make(const ControlOptions&);
template std::unique_ptr<MasterTransparency<1>> MasterTransparency<1>::make(const ControlOptions&);
template std::unique_ptr<SlaveTransparency<1>> SlaveTransparency<1>::make(const ControlOptions&);
template std::unique_ptr<MasterPassivity<1>> MasterPassivity<1>::make(const ControlOptions&);
template std::unique_ptr<SlavePassivity<1>> SlavePassivity<1>::make(const ControlOptions&);

}  // namespace twoport
