#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "common/base/time.h"
#include "common/coupling/options.h"
#include "common/hardware/device.h"
#include "common/passivity/controller.h"
#include "common/passivity/observer.h"
#include "common/runtime/cycle.h"
#include "sim/environment.h"

namespace twoport {

/// A virtual environment rendered directly on the device, the seed paper's case: one multi-port, impedance causality.
///
///     f_i(k)  = parts of the environment's force at the sensed position and velocity, one for each account
///     E_i(k)  = E(0)/n + Σ f'_i(k-1)·Δx(k)
///     f'_i(k) = passivate(f_i, v, E_i - U_i(x), U_i(x + T v) - U_i(x))         U = 0 without reference_energy
///     f'      = Σ f'_i
///
/// Accounts: the paper's total; normal and tangential parts (what sliding dissipates cannot pay for what the wall
/// generates); the same for each contact point; translation and rotation (for comparison: they trade in a tilted
/// contact). With more than one the direction of the sum may turn; each part keeps its own.
template <int N>
class RenderNode {
 public:
  static constexpr int kMaxAccounts = 32;

  struct Output {
    Force<N> command;  ///< force of the device on the environment: power f·v into it
    NoReport report;
    Force<N> wanted;
    Energy dissipated, owed;
  };

  RenderNode(const ControlOptions& o, sim::Environment<N> environment)
      : options_{o}, environment_{std::move(environment)}, observer_{o.initial_energy, accounts(o, environment_)} {}

  Output step(const Tick<MasterClock>& tick, const DeviceState<N>& device, const NoReport&) noexcept {
    const Seconds dt = tick.dt;
    Output out{};
    if (!all_finite(device.x, device.v, device.applied)) [[unlikely]] {  // no reading: let go
      held_.fill({});
      commanded_ = {};
      return out;
    }
    book(device, tick.ended);

    if (options_.accounts == Accounts::total) {
      wanted_[0] = -environment_.force(device.x, device.v);
    } else {
      for (int i = 0; i < observer_.accounts(); ++i) wanted_[static_cast<std::size_t>(i)] = Force<N>{};
      environment_.for_each_contact(device.x, device.v,
                                    [&](int contact, const Vector& n, const Vector& t) { split(contact, n, t); });
    }
    const bool reference = options_.reference_energy;
    if (reference) {
      potentials(device.x, potential_);
      potentials(device.x + device.v * dt, next_potential_);
    }
    for (int i = 0; i < observer_.accounts(); ++i) {
      const auto a = static_cast<std::size_t>(i);
      const Budget budget = reference ? Budget{observer_.energy(i) - potential_[a], next_potential_[a] - potential_[a]}
                                      : Budget{observer_.energy(i), Energy{}};
      const Corrected<Force<N>> part = passivate(wanted_[a], device.v, budget, options_.controller, dt);
      held_[a] = part.out;
      out.wanted += wanted_[a];
      out.command += part.out;
      out.dissipated += part.dissipated;
      out.owed += part.owed;
    }
    commanded_ = out.command;
    return out;
  }

  [[nodiscard]] Energy observed() const noexcept { return observer_.total(); }

 private:
  using Vector = typename Force<N>::Vector;
  using Energies = std::array<Energy, kMaxAccounts>;

  static int accounts(const ControlOptions& o, const sim::Environment<N>& e) {
    switch (o.accounts) {
      case Accounts::total:
        return 1;
      case Accounts::normal_tangential:
      case Accounts::translation_rotation:
        return 2;
      case Accounts::per_contact:
        return std::min(kMaxAccounts, std::max(2, 2 * e.contacts()));
    }
    return 1;
  }
  /// Energy of the interval that has just ended, with the force that was really applied: every part by the same factor.
  void book(const DeviceState<N>& device, Seconds dt) noexcept {
    const PortMotion<N> motion{device.x, device.v};
    if (!started_) {
      // E(0) of the paper's eq. (1): what the environment already holds.
      potentials(device.x, potential_);
      for (int i = 0; i < observer_.accounts(); ++i) observer_.store(i, potential_[static_cast<std::size_t>(i)]);
    } else {
      const double asked = commanded_.squared_norm();
      const double share = asked > 0.0 && !(device.applied.vec() == commanded_.vec())
                               ? std::sqrt(device.applied.squared_norm() / asked)
                               : 1.0;
      const Interval<N> interval = motion - before_;
      for (int i = 0; i < observer_.accounts(); ++i)
        observer_.book(i, share * held_energy(options_.observer, held_[static_cast<std::size_t>(i)], interval, dt));
    }
    before_ = motion;
    started_ = true;
  }

  void split(int contact, const Vector& n, const Vector& t) noexcept {
    switch (options_.accounts) {
      case Accounts::total:
        break;
      case Accounts::normal_tangential:
        wanted_[0] += Force<N>{-n};
        wanted_[1] += Force<N>{-t};
        break;
      case Accounts::per_contact: {
        const auto a = static_cast<std::size_t>((2 * contact) % kMaxAccounts);
        wanted_[a] += Force<N>{-n};
        wanted_[a + 1] += Force<N>{-t};
        break;
      }
      case Accounts::translation_rotation:
        if constexpr (N == 6) {
          Vector linear = -(n + t), angular = linear;
          linear.template tail<3>().setZero();
          angular.template head<3>().setZero();
          wanted_[0] += Force<N>{linear};
          wanted_[1] += Force<N>{angular};
        }
        break;
    }
  }

  /// Elastic energy of each account at x. Tangential and rotational accounts hold none.
  void potentials(const Position<N>& x, Energies& out) const noexcept {
    for (int i = 0; i < observer_.accounts(); ++i) out[static_cast<std::size_t>(i)] = Energy{};
    if (options_.accounts == Accounts::per_contact) {
      environment_.for_each_potential(
          x, [&](int contact, Energy u) { out[static_cast<std::size_t>((2 * contact) % kMaxAccounts)] += u; });
    } else {
      out[0] = environment_.potential(x);
    }
  }

  ControlOptions options_;
  sim::Environment<N> environment_;
  Observer<kMaxAccounts> observer_;
  std::array<Force<N>, kMaxAccounts> wanted_, held_;
  Energies potential_, next_potential_;
  Force<N> commanded_;
  PortMotion<N> before_;
  bool started_ = false;
};

}  // namespace twoport
