#include <algorithm>

#include "common/scene/blocks.h"

namespace twoport {

static_assert(same_number(VelocityEstimate::true_velocity, schema::Device::TRUE_VELOCITY) &&
              same_number(VelocityEstimate::backward_difference, schema::Device::BACKWARD_DIFFERENCE) &&
              same_number(VelocityEstimate::filtered, schema::Device::FILTERED) &&
              same_number(VelocityEstimate::filtered, schema::Device::VelocityEstimate_MAX));

namespace {

/// Three numbers > 0 or >= 0 about the handle's axes, or none.
Numbers read_principal(const Block<schema::Device>& of, const auto& field, const auto& for_all, const Rule& rule) {
  of.only_with_rotation(field);
  if (!of.has(field)) return {};
  if (of.has(for_all))
    of.fail(fmt::format("{} and {} are both given; one of them must be absent", of.path_of(field.name),
                        of.path_of(for_all.name)));
  Numbers three = of.list(field, {3, 3, ""});
  if (!std::all_of(three.begin(), three.end(), rule.holds))
    of.refuse(field, fmt::format("hold numbers that are each {}", rule.words + 3));
  return three;
}

}  // namespace

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
  spec.principal_inertia_kg_m2 = read_principal(of, FIELD(principal_inertia_kg_m2), FIELD(inertia_kg_m2), kPositive);
  spec.principal_rotational_damping_n_m_s_per_rad = read_principal(
      of, FIELD(principal_rotational_damping_n_m_s_per_rad), FIELD(rotational_damping_n_m_s_per_rad), kNotNegative);
  const auto smallest = [](const Numbers& three, double absent) {
    return three.empty() ? absent : *std::min_element(three.begin(), three.end());
  };
  spec.inertia_kg_m2 = smallest(spec.principal_inertia_kg_m2, spec.inertia_kg_m2);
  spec.rotational_damping_n_m_s_per_rad =
      smallest(spec.principal_rotational_damping_n_m_s_per_rad, spec.rotational_damping_n_m_s_per_rad);
  spec.force_latency_s = of.number(FIELD(force_latency_ms), kDelay) * 1e-3;
  if (of.has(FIELD(max_force_n))) spec.max_force_n = of.number(FIELD(max_force_n), kPositive);
  of.only_with_rotation(FIELD(arm));
  if (of.has(FIELD(arm))) {
    refuse_beside_arm(of, FIELD(mass_kg), FIELD(inertia_kg_m2), FIELD(damping_n_s_per_m),
                      FIELD(rotational_damping_n_m_s_per_rad), FIELD(velocity_m_per_s), FIELD(coulomb_friction_n),
                      FIELD(principal_inertia_kg_m2), FIELD(principal_rotational_damping_n_m_s_per_rad));
    spec.arm = read_arm(of.block(FIELD(arm)));
    const EffectiveInertia felt = effective_inertia(*spec.arm);
    spec.mass_kg = felt.mass_kg;
    spec.inertia_kg_m2 = felt.inertia_kg_m2;
    spec.damping_n_s_per_m = felt.damping_n_s_per_m;
    spec.rotational_damping_n_m_s_per_rad = felt.rotational_damping_n_m_s_per_rad;
  }
  return spec;
}

}  // namespace twoport
