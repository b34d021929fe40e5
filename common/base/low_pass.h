#pragma once

#include "common/base/scalar.h"

namespace twoport {

/// Weight of a new value in a first-order low pass of time constant tau, sampled with period T:
///
///     y += a (x - y),   a = min(1, T / tau)
[[nodiscard]] inline double low_pass_weight(Seconds dt, double tau_s) noexcept {
  return dt.si() < tau_s ? dt.si() / tau_s : 1.0;
}

/// One step of that low pass.
template <class Value>
void low_pass(Value& y, const Value& x, Seconds dt, double tau_s) noexcept {
  y += low_pass_weight(dt, tau_s) * (x - y);
}

}  // namespace twoport
