#pragma once

#include <compare>

namespace twoport {

/// A number with a physical kind: only values of the same kind can be added. `si()` returns the plain value.
template <class Kind>
class Scalar {
 public:
  constexpr Scalar() = default;
  constexpr explicit Scalar(double si) : si_{si} {}
  [[nodiscard]] constexpr double si() const { return si_; }

  friend constexpr auto operator<=>(Scalar, Scalar) = default;
  constexpr Scalar operator-() const { return Scalar{-si_}; }
  friend constexpr Scalar operator+(Scalar a, Scalar b) { return Scalar{a.si_ + b.si_}; }
  friend constexpr Scalar operator-(Scalar a, Scalar b) { return Scalar{a.si_ - b.si_}; }
  friend constexpr Scalar operator*(double s, Scalar a) { return Scalar{s * a.si_}; }
  friend constexpr double operator/(Scalar a, Scalar b) { return a.si_ / b.si_; }
  constexpr Scalar& operator+=(Scalar b) { return *this = *this + b; }
  constexpr Scalar& operator-=(Scalar b) { return *this = *this - b; }

 private:
  double si_{0.0};
};

using Seconds = Scalar<struct SecondsKind>;  // [s]
using Energy = Scalar<struct EnergyKind>;    // [J]
using Power = Scalar<struct PowerKind>;      // [W]

constexpr Energy operator*(Power p, Seconds t) {
  return Energy{p.si() * t.si()};
}

template <class Kind>
constexpr Scalar<Kind> positive_part(Scalar<Kind> a) {
  return a.si() > 0.0 ? a : Scalar<Kind>{};
}

namespace literals {
constexpr Energy operator""_J(long double v) {
  return Energy{static_cast<double>(v)};
}
constexpr Seconds operator""_s(long double v) {
  return Seconds{static_cast<double>(v)};
}
}  // namespace literals

}  // namespace twoport
