#include "common/method/classes.h"

namespace twoport {

template std::unique_ptr<MasterHalf<6>> MasterHalf<6>::make(const ControlOptions&);
template std::unique_ptr<SlaveHalf<6>> SlaveHalf<6>::make(const ControlOptions&);
template std::unique_ptr<MasterTransparency<6>> MasterTransparency<6>::make(const ControlOptions&);
template std::unique_ptr<SlaveTransparency<6>> SlaveTransparency<6>::make(const ControlOptions&);
template std::unique_ptr<MasterPassivity<6>> MasterPassivity<6>::make(const ControlOptions&);
template std::unique_ptr<SlavePassivity<6>> SlavePassivity<6>::make(const ControlOptions&);

}  // namespace twoport
