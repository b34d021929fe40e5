#include "common/scene/blocks.h"

namespace twoport {

DeviceMount read_device_mount(const Block<schema::DeviceMount>& of) {
  const int clutch_button = of->clutch_button();
  if (clutch_button < -1 || clutch_button > 31) of.refuse(FIELD(clutch_button), "be from 0 to 31, or -1 for none");
  DeviceMount m;
  m.position_m = vector<3>(of->position_m());
  m.rotation = attitude(of->rotation());
  m.scale = of->scale();
  m.clutch_button = clutch_button;
  m.carried_force_n = vector<3>(of->carried_force_n());
  m.let_go_after_s = of->let_go_after_s();
  m.engage_s = of->engage_s();
  return m;
}

RobotMount read_robot_mount(const Block<schema::RobotMount>& of) {
  if (of->tool_mass_kg() > 0.0 && of.dof() == 1)
    of.refuse(FIELD(tool_mass_kg), "be absent with dof 1, whose axis is not vertical");
  RobotMount m;
  m.tool_mass_kg = of->tool_mass_kg();
  m.tool_center_m = vector<3>(of->tool_center_m());
  for (int i = 0; i < of->force_bias_n_size(); ++i) m.bias[i] = of->force_bias_n(i);
  return m;
}

}  // namespace twoport
