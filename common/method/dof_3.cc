#include "common/method/classes.h"

namespace twoport {

template std::unique_ptr<MasterHalf<3>> MasterHalf<3>::make(const ControlOptions&);
template std::unique_ptr<SlaveHalf<3>> SlaveHalf<3>::make(const ControlOptions&);
template std::unique_ptr<MasterTransparency<3>> MasterTransparency<3>::make(const ControlOptions&);
template std::unique_ptr<SlaveTransparency<3>> SlaveTransparency<3>::make(const ControlOptions&);
template std::unique_ptr<MasterPassivity<3>> MasterPassivity<3>::make(const ControlOptions&);
template std::unique_ptr<SlavePassivity<3>> SlavePassivity<3>::make(const ControlOptions&);

}  // namespace twoport
