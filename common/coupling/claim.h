#pragma once

#include <cstdint>
#include <span>

#include "common/coupling/layers.h"

namespace twoport {

/// What a method claims with its options, over a link. Void are
///
///     all    observer RECTANGLE: the account misses energy
///            a limit of the force's rate at the device that can act: a force outlasts its account (layers that exchange energy show
///            none that could)
///     hand   an option of the layer (PassivityLayerName::voids_hand)
///     both   of a layer that bounds the robot's own port: a limit of the force's rate at the robot that can act; an ideal robot, which goes to
///            its set point whatever force that takes
///            `predicts`: POSITION_MEASURED_FORCE, and a damper at the robot that is of the link (damps_link)
///     `predicts`: without `predict` or where the handle's mass is not known it acts on the present velocity: both claims
struct StandingClaim {
  enum class Voided : std::uint8_t {
    nothing,
    observer,
    device_rate,
    robot_rate,
    ideal_robot,
    prediction,
    measured_force,
    link_damper,
    option
  };

  Claim claim;
  Voided voided = Voided::nothing;  ///< an option that takes a part of the claim away
};
/// What the method claims before an option takes any of it away.
[[nodiscard]] inline Claim stated_claim(const ControlOptions& o) {
  const MethodName& method = method_entry(o);
  return (method.claim ? method.claim : passivity_layer(o).claim).value_or(Claim{});
}
/// Is the account, and E(0), the master's own? The slave then need not know it.
[[nodiscard]] inline bool account_is_of_master(const ControlOptions& o) {
  const Claim claim = stated_claim(o);
  return claim.hand && !claim.both;
}
[[nodiscard]] inline StandingClaim standing_claim(const ControlOptions& o) {
  using enum StandingClaim::Voided;
  // Within the limit of force no force changes by more than twice that in a tick.
  const auto rate_acts = [](const PortLimits& limits, Seconds tick) {
    return limits.force_rate_n_per_s < PortLimits::kNone &&
           !(limits.force_rate_n_per_s * tick.si() >= 2.0 * limits.force_n);
  };
  if (o.architecture == Architecture::render || o.architecture == Architecture::uncontrolled) return {};
  Claim claim = stated_claim(o);
  if (!claim.any()) return {};
  if (o.observer == ObserverRule::rectangle) return {{}, observer};
  if (!exchanges_energy(o) && rate_acts(limits_at_device(o), o.known.master_tick)) return {{}, device_rate};
  if (claim.predicts && (!o.controller.predict || !(o.handle_mass_kg > 0.0))) return {{}, prediction};
  StandingClaim::Voided voided = nothing;
  const auto take_both = [&](StandingClaim::Voided by) {
    if (claim.both) voided = by;
    claim.both = false;
  };
  if (claim.robot_port && !exchanges_energy(o) && rate_acts(limits_at_robot(o), o.known.slave_tick))
    take_both(robot_rate);
  if (claim.robot_port && o.known.ideal_robot) take_both(ideal_robot);
  if (claim.predicts) {
    if (returns_measured_force(o)) take_both(measured_force);
    if (transparency_layer(o).damps_link) take_both(link_damper);
  }
  if (const auto voids = passivity_layer(o).voids_hand; voids != nullptr && !voids(o).empty())
    claim.hand = false, voided = option;
  return {claim.any() ? claim : Claim{}, voided};
}
[[nodiscard]] inline Claim claim_of(const ControlOptions& o) {
  return standing_claim(o).claim;
}

/// What holds in a run that switches: the hand's port, where all its methods claim that. At the robot the force before a switch fades
/// beside the account.
[[nodiscard]] inline Claim claim_of(const ControlOptions& first, std::span<const ScheduledControl> schedule) {
  Claim all = claim_of(first);
  for (const ScheduledControl& entry : schedule) {
    const Claim next = claim_of(entry.control);
    all = {.hand = all.hand && next.hand,
           .device_damping = all.device_damping || next.device_damping,
           .predicts = all.predicts || next.predicts};
  }
  return all.any() ? all : Claim{};
}

}  // namespace twoport
