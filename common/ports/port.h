#pragma once

#include <concepts>

#include "common/base/scalar.h"
#include "common/base/vector.h"

namespace twoport {

// clang-format off
// (version 14 knows no concepts)

/// Two quantities whose product is a power: a force and a velocity of the same size, in either order.
template <class A, class B>
concept PowerDual = requires(const A& a, const B& b) {
  { dot(a, b) } -> std::same_as<Power>;
};

/// One period of a one-port: input in, output out.
/// In = Velocity, Out = Force is an impedance; the reverse an admittance.
template <class E>
concept OnePort = PowerDual<typename E::In, typename E::Out> && requires(E e, const typename E::In& in, Seconds dt) {
  { e.step(in, dt) } noexcept -> std::same_as<typename E::Out>;
};

// clang-format on

}  // namespace twoport
