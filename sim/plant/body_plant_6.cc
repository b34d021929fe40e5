#include "sim/plant/make_body_plant.h"

namespace twoport::sim {

template std::unique_ptr<BodyPlant<6>> make_body_plant<6>(const RobotSpec&,
                                                          const std::shared_ptr<const Environment<6>>&, double,
                                                          const BodyState<6>&, const SimulationSpec&, std::size_t);

}  // namespace twoport::sim
