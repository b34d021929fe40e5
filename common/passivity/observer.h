#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <type_traits>
#include <vector>

#include "common/base/scalar.h"
#include "common/base/vector.h"

namespace twoport {

/// Running totals of one account, each of which only grows [J]:
///
///     absorbed = Σ max(dE, 0)     returned = Σ max(-dE, 0)     net = absorbed - returned
///
/// A total can be sent, lost, repeated and reordered without creating or destroying energy; an increment cannot.
class Ledger {
 public:
  void book(Energy into) noexcept {
    if (into.si() > 0.0) absorbed_ += into;
    if (into.si() < 0.0) returned_ -= into;
  }
  [[nodiscard]] Energy absorbed() const noexcept { return absorbed_; }
  [[nodiscard]] Energy returned() const noexcept { return returned_; }
  [[nodiscard]] Energy net() const noexcept { return absorbed_ - returned_; }

 private:
  Energy absorbed_, returned_;
};

enum class ObserverRule : unsigned char {
  exact,      ///< f(k-1)·(x(k) - x(k-1)): the energy of a held force, whatever the motion between the ticks
  rectangle,  ///< f(k-1)·v(k-1)·T: the paper's eq. (2); blind to what a sampled spring creates
};

/// Where a port is and how fast it says it moves.
template <int N>
struct PortMotion {
  Position<N> x;
  Velocity<N> v;
};

/// What a port did between two ticks.
template <int N>
struct Interval {
  Displacement<N> moved;
  Velocity<N> v0, v1;  ///< at its ends
};
template <int N>
[[gnu::always_inline]] inline Interval<N> operator-(const PortMotion<N>& now, const PortMotion<N>& before) {
  return {now.x - before.x, before.v, now.v};
}

/// Energy that a force held from tick k-1 to tick k has put into the element behind the port [J].
///
///     exact       f·Δx                          N = 1, 3
///                 f·Δp + τ·(log ΔR + T²/12 ω(k-1)×ω(k))    N = 6: the rotation vector of an interval is not ∫ω dt
///     rectangle   f·v(k-1)·T
///
/// `held` is the force that was really applied, after every limit.
template <int N>
[[gnu::always_inline]] inline Energy held_energy(ObserverRule rule, const Force<N>& held, const Interval<N>& interval,
                                                 Seconds dt) noexcept {
  if (rule == ObserverRule::rectangle) return dot(held, interval.v0) * dt;
  Energy e = dot(held, interval.moved);
  if constexpr (N == 6) {
    const Eigen::Vector3d w0 = interval.v0.vec().template tail<3>(), w1 = interval.v1.vec().template tail<3>();
    e += Energy{dt.si() * dt.si() / 12.0 * held.vec().template tail<3>().dot(w0.cross(w1))};
  }
  return e;
}

/// Multi-port passivity observer: any number of ports and axes, booked into one or several accounts.
///
///     E_a(n) = E(0) + Σ_{k<=n} Σ_{ports and axes of a} f(k-1)·Δx(k)       paper eq. (1), (2), (4)
///
/// One account is the paper's total; more keep ports, normal and tangential parts, or translation and rotation apart.
/// The network is passive while every account is >= 0. E(0) is shared equally.
/// How many accounts there are is chosen when it is built: up to `Capacity`, or with kAnyCapacity any number.
inline constexpr int kAnyCapacity = 0;
template <int Capacity = 1>
class Observer {
 public:
  explicit Observer(Energy initial = Energy{}, int accounts = Capacity) : count_{accounts} {
    if constexpr (Capacity == kAnyCapacity) {
      accounts_.resize(static_cast<std::size_t>(accounts));
      initial_.resize(static_cast<std::size_t>(accounts));
    }
    for (int a = 0; a < count_; ++a) store(a, Energy{initial.si() / accounts});
  }

  /// Adds to E(0) of one account what its element holds at the start.
  void store(int account, Energy held) noexcept { initial_[static_cast<std::size_t>(account)] += held; }

  [[nodiscard]] int accounts() const noexcept { return count_; }
  void book(int account, Energy into) noexcept { accounts_[static_cast<std::size_t>(account)].book(into); }
  [[nodiscard]] Energy energy(int account = 0) const noexcept {
    return initial_[static_cast<std::size_t>(account)] + accounts_[static_cast<std::size_t>(account)].net();
  }
  [[nodiscard]] Energy total() const noexcept {
    Energy sum;
    for (int a = 0; a < count_; ++a) sum += energy(a);
    return sum;
  }
  [[nodiscard]] const Ledger& ledger(int account = 0) const noexcept {
    return accounts_[static_cast<std::size_t>(account)];
  }

 private:
  template <class T>
  using Store = std::conditional_t<Capacity == kAnyCapacity, std::vector<T>, std::array<T, Capacity>>;

  Store<Ledger> accounts_{};
  Store<Energy> initial_{};
  int count_;
};

}  // namespace twoport
