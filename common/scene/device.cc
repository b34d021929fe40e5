#include "common/scene/blocks.h"

namespace twoport {

static_assert(same_number(VelocityEstimate::true_velocity, schema::Device::TRUE_VELOCITY) &&
              same_number(VelocityEstimate::backward_difference, schema::Device::BACKWARD_DIFFERENCE) &&
              same_number(VelocityEstimate::filtered, schema::Device::FILTERED) &&
              same_number(VelocityEstimate::filtered, schema::Device::VelocityEstimate_MAX));

DeviceSpec read_device(const Block<schema::Device>& of) {
  of.only_with_rotation(FIELD(inertia_kg_m2), FIELD(rotational_damping_n_m_s_per_rad));
  DeviceSpec spec{
      .mass_kg = of.number(FIELD(mass_kg), kNotNegative),
      .damping_n_s_per_m = of.number(FIELD(damping_n_s_per_m), kNotNegative),
      .position_m = pose(of, FIELD(position_m)),
      .velocity_m_per_s = of.list(FIELD(velocity_m_per_s), of.context().twist()),
      .coulomb_friction_n = of.number(FIELD(coulomb_friction_n), kNotNegative),
      .position_resolution_m = of.number(FIELD(position_resolution_m), kNotNegative),
      .max_force_n = std::nullopt,
      .velocity_estimate = of.choice<VelocityEstimate>(FIELD(velocity_estimate)),
      .velocity_filter_hz = of.number(FIELD(velocity_filter_hz), kPositive),
      .inertia_kg_m2 = of.number(FIELD(inertia_kg_m2), kNotNegative),
      .rotational_damping_n_m_s_per_rad = of.number(FIELD(rotational_damping_n_m_s_per_rad), kNotNegative),
  };
  if (of.has(FIELD(max_force_n))) spec.max_force_n = of.number(FIELD(max_force_n), kPositive);
  return spec;
}

}  // namespace twoport
