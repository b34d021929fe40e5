#pragma once

#include <cmath>
#include <concepts>
#include <stdexcept>
#include <utility>

#include "common/base/scalar.h"
#include "common/base/vector.h"
#include "common/passivity/controller.h"
#include "common/passivity/energy_spring.h"
#include "common/passivity/observer.h"
#include "common/ports/port.h"

#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "-ffinite-math-only, a part of -ffast-math, leaves out the checks for numbers that are not finite"
#endif

namespace twoport {

inline void check_option(bool good, const char* rule) {
  if (!good) throw std::invalid_argument{rule};
}
/// An input and a period that a step can book.
template <class In>
[[nodiscard]] bool can_be_booked(const In& in, Seconds dt) noexcept {
  return all_finite(in) && std::isfinite(dt.si()) && dt.si() > 0.0;
}

/// A one-port wrapped with an observer and a controller: again a one-port, of the same causality.
///
///     E(k) = E(k-1) + out'(k-1)·in(k) T,    out'(k) = passivity_controller(out(k), in(k), E(k))
///
/// Exact when `in` is the mean over the interval that has just ended: a backward difference of positions at an impedance, whose answer is
/// held until the next step; of six axes integral(interval, dt) / dt (observer.h), as a rotation vector is not the integral of ω.
template <OnePort E, class Options = ControllerOptions>
class Passivated {
 public:
  using In = typename E::In;
  using Out = typename E::Out;
  /// std::invalid_argument: a gain or a mass < 0, a radius <= 0, a number that is none.
  Passivated(E element, const ControllerOptions& options, Energy initial = Energy{})
      : element_{std::move(element)}, options_{options}, observer_{initial} {
    check_option(options.max_gain >= 0.0, "ControllerOptions.max_gain must be >= 0");
    check_option(options.max_mobility_m_per_n_s >= 0.0, "ControllerOptions.max_mobility_m_per_n_s must be >= 0");
    check_option(options.mass_kg >= 0.0, "ControllerOptions.mass_kg must be >= 0");
    check_option(options.radius_of_gyration_m > 0.0, "ControllerOptions.radius_of_gyration_m must be > 0");
    check_option(options.max_turn_rad >= 0.0, "ControllerOptions.max_turn_rad must be >= 0");
    check_option(std::isfinite(initial.si()), "the initial energy must be finite");
  }

  /// Where `in` is not finite or dt is no finite number > 0, nothing is booked, so that energy of the interval that has just ended is missing in
  /// the account; then, and where the element's answer is not finite, the answer is zero until the next step.
  Out step(const In& in, Seconds dt) noexcept {
    if (!can_be_booked(in, dt)) return held_ = Out{};
    observer_.book(0, dot(held_, in) * dt);
    const Out wanted = element_.step(in, dt);
    if (!all_finite(wanted)) return held_ = Out{};
    last_ = passivity_controller(wanted, in, Budget{observer_.energy(), Energy{}}, options_, dt);
    return held_ = all_finite(last_.out) ? last_.out : Out{};
  }
  const E& element() const { return element_; }
  [[nodiscard]] Energy energy() const { return observer_.energy(); }
  const Corrected<Out>& last() const { return last_; }

 private:
  E element_;
  ControllerOptions options_;
  Observer<1> observer_;
  Out held_{};
  Corrected<Out> last_{};
};

struct EnergySpringOptions {
  double stiffness_n_per_m;                       ///< K_0; no less than the element's, or its force is reduced
  double rotational_stiffness_n_m_per_rad = 0.0;  ///< K_r > 0, N = 6
  double mass_kg = 0.0;                           ///< of the handle at the port; 0: not known
  double inertia_kg_m2 = 0.0;                     ///< of the handle, N = 6; 0: not known
  Energy initial;                                 ///< E(0) > 0: with none no contact would have a force
};

/// An impedance wrapped with the energy spring instead of a controller in the time domain: again an impedance. Power f'·v is positive
/// into it.
///
///     E(k)  = E(k-1) + f'(k-1)·v(k) T [J]      v(k): mean velocity of the interval that has just ended [m/s]
///     f'(k) = s f(k) [N],  0 <= s <= 1         EnergySpring: |f'| <= sqrt(2 K (E + E(0))), and what the coming interval returns <= E + E(0)
///
/// Claim, with the mass known: E(k) >= -E(0), whatever the element answers, for any hand that changes its force by no more than 20 N
/// within two ticks, a force at the first step included and a change between two ticks counted 1.5 times; else E(k) >= -E(0) - K δ²/2 with δ the largest motion of one tick (EnergySpring).
/// Of velocities that are means of their intervals, as above, all finite, and of a device that applies f': what limits it belongs into the
/// element. The direction of f is kept.
template <OnePort E>
requires std::same_as<typename E::Out, Force<E::Out::kSize>>
class Passivated<E, EnergySpringOptions> {
 public:
  using In = typename E::In;
  using Out = typename E::Out;
  /// std::invalid_argument: K_0 or E(0) not > 0, a mass or an inertia < 0, a number that is none; N = 6 without K_r, whose torques no energy
  /// would limit.
  Passivated(E element, const EnergySpringOptions& o)
      : element_{std::move(element)},
        initial_{o.initial},
        spring_{o.initial, o.stiffness_n_per_m, o.rotational_stiffness_n_m_per_rad, o.mass_kg, o.inertia_kg_m2} {
    check_option(o.stiffness_n_per_m > 0.0, "EnergySpringOptions.stiffness_n_per_m must be > 0");
    check_option(Out::kSize != 6 || o.rotational_stiffness_n_m_per_rad > 0.0,
                 "EnergySpringOptions.rotational_stiffness_n_m_per_rad must be > 0 for six axes");
    check_option(o.mass_kg >= 0.0, "EnergySpringOptions.mass_kg must be >= 0");
    check_option(o.inertia_kg_m2 >= 0.0, "EnergySpringOptions.inertia_kg_m2 must be >= 0");
    check_option(o.initial.si() > 0.0, "EnergySpringOptions.initial must be > 0");
    spring_.take_port(Velocity<Out::kSize>::Vector::Ones());  // the hand's push is not known yet
  }

  /// As of the other wrapper. The claim is for a constant dt.
  Out step(const In& in, Seconds dt) noexcept {
    if (!can_be_booked(in, dt)) return held_ = Out{};
    const Displacement<Out::kSize> moved = in * dt;
    spring_.observe(spring_.energy() + dot(held_, moved), moved, held_, dt, dt);
    const Out wanted = element_.step(in, dt);
    if (!all_finite(wanted)) return held_ = Out{};
    share_ = spring_.scale(wanted, dt);
    const Out limited = share_ * wanted;
    return held_ = all_finite(limited) ? limited : Out{};
  }
  const E& element() const { return element_; }
  /// E + E(0) [J]: not below 0 within the claim.
  [[nodiscard]] Energy energy() const { return spring_.energy() + initial_; }
  /// s of the last step.
  [[nodiscard]] double share() const { return share_; }

 private:
  E element_;
  Energy initial_;
  EnergySpring<Out::kSize> spring_;
  Out held_{};
  double share_ = 1.0;
};
template <OnePort E>
Passivated(E, EnergySpringOptions) -> Passivated<E, EnergySpringOptions>;

}  // namespace twoport
