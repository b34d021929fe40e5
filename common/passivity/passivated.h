#pragma once

#include <utility>

#include "common/passivity/controller.h"
#include "common/passivity/observer.h"
#include "common/ports/port.h"

namespace twoport {

/// A one-port wrapped with an observer and a controller: again a one-port, of the same causality.
///
///     E(k) = E(k-1) + out'(k-1)·in(k) T,    out'(k) = passivity_controller(out(k), in(k), E(k))
///
/// Exact when `in` is the mean over the interval that has just ended: a backward difference of positions at an
/// impedance, whose answer is held until the next step.
template <OnePort E>
class Passivated {
 public:
  using In = typename E::In;
  using Out = typename E::Out;
  Passivated(E element, const ControllerOptions& options, Energy initial = Energy{})
      : element_{std::move(element)}, options_{options}, observer_{initial} {}

  Out step(const In& in, Seconds dt) noexcept {
    observer_.book(0, dot(held_, in) * dt);
    last_ = passivity_controller(element_.step(in, dt), in, Budget{observer_.energy(), Energy{}}, options_, dt);
    return held_ = last_.out;
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

}  // namespace twoport
