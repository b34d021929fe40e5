#include <algorithm>

#include "common/scene/blocks.h"

namespace twoport {

static_assert(same_number(VelocityEstimate::true_velocity, schema::Device::TRUE_VELOCITY) &&
              same_number(VelocityEstimate::backward_difference, schema::Device::BACKWARD_DIFFERENCE) &&
              same_number(VelocityEstimate::filtered, schema::Device::FILTERED) &&
              same_number(VelocityEstimate::filtered, schema::Device::VelocityEstimate_MAX));

namespace {

/// Three numbers about the handle's axes, or none.
Numbers read_principal(const Block<schema::Device>& of, const auto& field, const auto& for_all) {
  if (of.has(field) && of.has(for_all))
    of.fail(fmt::format("{} and {} are both given; one of them must be absent", of.path_of(field.name),
                        of.path_of(for_all.name)));
  return numbers(field.value(of.message()));
}

}  // namespace

DeviceSpec read_device(const Block<schema::Device>& of) {
  DeviceSpec spec{
      .mass_kg = of->mass_kg(),
      .damping_n_s_per_m = of->damping_n_s_per_m(),
      .position_m = pose(of->position_m()),
      .velocity_m_per_s = numbers(of->velocity_m_per_s()),
      .coulomb_friction_n = of->coulomb_friction_n(),
      .position_resolution_m = of->position_resolution_m(),
      .max_force_n = std::nullopt,
      .velocity_estimate = static_cast<VelocityEstimate>(of->velocity_estimate()),
      .velocity_filter_hz = of->velocity_filter_hz(),
      .inertia_kg_m2 = of->inertia_kg_m2(),
      .rotational_damping_n_m_s_per_rad = of->rotational_damping_n_m_s_per_rad(),
  };
  spec.principal_inertia_kg_m2 = read_principal(of, FIELD(principal_inertia_kg_m2), FIELD(inertia_kg_m2));
  spec.principal_rotational_damping_n_m_s_per_rad =
      read_principal(of, FIELD(principal_rotational_damping_n_m_s_per_rad), FIELD(rotational_damping_n_m_s_per_rad));
  const auto smallest = [](const Numbers& three, double absent) {
    return three.empty() ? absent : *std::min_element(three.begin(), three.end());
  };
  spec.inertia_kg_m2 = smallest(spec.principal_inertia_kg_m2, spec.inertia_kg_m2);
  spec.rotational_damping_n_m_s_per_rad =
      smallest(spec.principal_rotational_damping_n_m_s_per_rad, spec.rotational_damping_n_m_s_per_rad);
  spec.force_latency_s = of->force_latency_ms() * 1e-3;
  if (of->has_max_force_n()) spec.max_force_n = of->max_force_n();
  if (of->has_arm()) {
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
