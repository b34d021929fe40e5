#include <cmath>

#include "common/scene/blocks.h"

namespace twoport {
namespace {

constexpr Rule kScale{[](double v) { return v >= 1e-3 && v <= 1e3; }, "be from 0.001 to 1000"};
/// What a device or a robot can be; a larger number is a slip of units.
constexpr double kLargestPlace_m = 100.0, kLargestForce_n = 1e4, kLargestArm_m = 10.0;
constexpr Rule kToolMass{[](double v) { return v >= 0.0 && v <= 1000.0; }, "be from 0 to 1000"};

void check_largest(const auto& of, const auto& field, const Numbers& numbers, double largest) {
  for (const double v : numbers)
    if (!(std::abs(v) <= largest)) of.refuse(field, fmt::format("have coordinates from -{0:g} to {0:g}", largest));
}

/// Coordinates of a point, of a scene with fewer axes too.
Eigen::Vector3d spatial(const Numbers& numbers) {
  Eigen::Vector3d all = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < numbers.size() && i < 3; ++i) all[static_cast<int>(i)] = numbers[i];
  return all;
}

}  // namespace

DeviceMount read_device_mount(const Block<schema::DeviceMount>& of) {
  DeviceMount m;
  const Numbers place = of.list(FIELD(position_m), of.context().point());
  check_largest(of, FIELD(position_m), place, kLargestPlace_m);
  m.position_m = spatial(place);
  if (of.has(FIELD(rotation))) {
    if (of.dof() == 1)
      of.fail(fmt::format("{} is given, but dof is 1; a rotation needs dof 3 or 6", of.path_of("rotation")));
    const Numbers q = of.list(FIELD(rotation), Count{4, 4, ""});
    m.rotation = Eigen::Quaterniond{q[0], q[1], q[2], q[3]};
    if (std::abs(m.rotation.norm() - 1.0) > 1e-3) of.refuse(FIELD(rotation), "be of length 1");
    m.rotation.normalize();
  }
  m.scale = of.number(FIELD(scale), kScale);
  m.clutch_button = of.integer(FIELD(clutch_button));
  if (m.clutch_button < -1 || m.clutch_button > 31) of.refuse(FIELD(clutch_button), "be from 0 to 31, or -1 for none");
  const Numbers carried = of.list(FIELD(carried_force_n), of.context().point());
  check_largest(of, FIELD(carried_force_n), carried, kLargestForce_n);
  m.carried_force_n = spatial(carried);
  m.let_go_after_s = of.number(FIELD(let_go_after_s), kSpan);
  m.engage_s = of.number(FIELD(engage_s), kMoment);
  return m;
}

RobotMount read_robot_mount(const Block<schema::RobotMount>& of) {
  of.only_with_rotation(FIELD(tool_center_m));
  RobotMount m;
  m.tool_mass_kg = of.number(FIELD(tool_mass_kg), kToolMass);
  if (m.tool_mass_kg > 0.0 && of.dof() == 1)
    of.refuse(FIELD(tool_mass_kg), "be absent with dof 1, whose axis is not vertical");
  const Numbers center = of.list(FIELD(tool_center_m), Count{3, 3, ""});
  check_largest(of, FIELD(tool_center_m), center, kLargestArm_m);
  m.tool_center_m = spatial(center);
  const Numbers bias = of.list(FIELD(force_bias_n), of.context().twist());
  check_largest(of, FIELD(force_bias_n), bias, kLargestForce_n);
  for (std::size_t i = 0; i < bias.size(); ++i) m.bias[static_cast<int>(i)] = bias[i];
  return m;
}

}  // namespace twoport
