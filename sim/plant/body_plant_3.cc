#include "sim/plant/make_body_plant.h"

namespace twoport::sim {

template std::unique_ptr<BodyPlant<3>> make_body_plant<3>(const RobotSpec&,
                                                          const std::shared_ptr<const Environment<3>>&, double,
                                                          const BodyState<3>&, const SimulationSpec&, std::size_t);

}  // namespace twoport::sim
