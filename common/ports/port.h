#pragma once

#include <concepts>
#include <utility>

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

/// One period of an element with one port: what drives it in, what it answers out.
/// In = Velocity, Out = Force is an impedance; the reverse an admittance.
template <class E>
concept OnePort = PowerDual<typename E::In, typename E::Out> && requires(E e, const typename E::In& in, Seconds dt) {
  { e.step(in, dt) } noexcept -> std::same_as<typename E::Out>;
};

/// One period of an element with a left and a right port, each with its own causality.
template <class E>
concept TwoPort =
    PowerDual<typename E::LeftIn, typename E::LeftOut> && PowerDual<typename E::RightIn, typename E::RightOut> &&
    requires(E e, const typename E::LeftIn& left, const typename E::RightIn& right, Seconds dt) {
      { e.step(left, right, dt).left } noexcept -> std::convertible_to<typename E::LeftOut>;
      { e.step(left, right, dt).right } noexcept -> std::convertible_to<typename E::RightOut>;
    };

/// Two one-ports can be joined when each answers what the other needs. Two impedances cannot: nobody would set the
/// velocity; nor two admittances: nobody would set the force.
template <class A, class B>
concept Joinable = OnePort<A> && OnePort<B> && std::same_as<typename A::In, typename B::Out> &&
                   std::same_as<typename A::Out, typename B::In>;

/// What one element's answer is to its neighbour: at a joint the velocity is common and the force opposite.
template <int N>
Velocity<N> across(const Velocity<N>& v) noexcept {
  return v;
}
template <int N>
Force<N> across(const Force<N>& f) noexcept {
  return -f;
}

/// An impedance Z and an admittance Y joined at one port, with velocity common and force opposite.
/// The force that Z answers reaches Y one period later: the delay that a sampled loop has, made explicit.
///
///     v(k) = Y(-f(k-1)),   f(k) = Z(v(k))
template <class Z, class Y>
  requires Joinable<Z, Y> && std::same_as<typename Z::Out, Force<Z::Out::kSize>>
class Joined {
 public:
  Joined(Z z, Y y) : z_{std::move(z)}, y_{std::move(y)} {}

  struct Sample {
    typename Z::In v;
    typename Z::Out f;
  };
  Sample step(Seconds dt) noexcept {
    const typename Z::In v = y_.step(across(f_), dt);
    f_ = z_.step(v, dt);
    return {v, f_};
  }
  const Z& impedance() const { return z_; }
  const Y& admittance() const { return y_; }

 private:
  Z z_;
  Y y_;
  typename Z::Out f_{};
};

/// A two-port closed at its right by a one-port: again a one-port, seen from the left.
/// The right port's answer enters the two-port one period later.
template <class T, class E>
  requires TwoPort<T> && OnePort<E> && std::same_as<typename T::RightIn, typename E::Out> &&
           std::same_as<typename T::RightOut, typename E::In>
class Terminated {
 public:
  using In = typename T::LeftIn;
  using Out = typename T::LeftOut;
  Terminated(T two_port, E end) : two_port_{std::move(two_port)}, end_{std::move(end)} {}

  Out step(const In& in, Seconds dt) noexcept {
    const auto out = two_port_.step(in, across(answer_), dt);
    answer_ = end_.step(across(out.right), dt);
    return out.left;
  }
  const E& end() const { return end_; }

 private:
  T two_port_;
  E end_;
  typename E::Out answer_{};
};

}  // namespace twoport
