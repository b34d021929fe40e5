#include "sim/plant/make_body_plant.h"

namespace twoport::sim {

template std::unique_ptr<BodyPlant<1>> make_body_plant<1>(const RobotSpec&,
                                                          const std::shared_ptr<const Environment<1>>&, double,
                                                          const BodyState<1>&, const SimulationSpec&, std::size_t);

}  // namespace twoport::sim
