#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "common/contact/environment.h"
#include "common/coupling/options.h"
#include "common/method/render/god_object.h"
#include "common/passivity/controller.h"
#include "common/passivity/observer.h"

namespace twoport {

/// A virtual environment rendered on the device: impedance causality, velocity in, force out. Equations,
/// source and limits: README.md beside this file.
///
///     f_i(k)  = parts of the environment's force at the sensed position and velocity, one for each account
///     E_i(k)  = E(0)/n + U_i(x(0)) + Σ f'_i(k-1)·Δx(k)
///     f'_i(k) = passivity_controller(f_i, v, E_i - U_i(x), U_i(x + T v) - U_i(x))         U = 0 without reference_energy
///     f'      = Σ f'_i
///
/// Forces are those of the device on the environment: power f·v into it.
template <int N>
class Rendering {
 public:
  struct Output {
    Force<N> command;  ///< f' [N], [N m]
    Force<N> wanted;   ///< before the passivity controller
    Energy dissipated, undissipated;
  };

  /// With the accounts of `o`; allocates here only.
  Rendering(const ControlOptions& o, Environment<N> environment);

  /// One control period of length `dt`: `ended` after the last one. `applied` is the force actually held since then.
  Output step(const PortMotion<N>& port, const Force<N>& applied, Seconds dt, Seconds ended) noexcept;

  /// Instead of a step without a valid reading: no force until the next one.
  void release() noexcept {
    for (Account& a : accounts_) a.acts = false;
    commanded_ = {};
    if (god_object_) god_object_->release();
  }

  /// Sum of all accounts, E(0) and what the environment held at the start included.
  [[nodiscard]] Energy observed() const noexcept { return observer_.total(); }

 private:
  using Vector = PortVector<N>;
  struct Account {
    Vector on_environment = Vector::Zero();  ///< sum of the contacts' forces, on the environment
    Force<N> held;
    Energy potential, next_potential;  ///< at x and at x + T v
    bool presses = false;              ///< on_environment may differ from zero
    bool acts = false;                 ///< `held` counts; else nothing is held
  };

  static int accounts(const ControlOptions& o, const Environment<N>& e) {
    switch (o.accounts) {
      case Accounts::total:
        return 1;
      case Accounts::normal_tangential:
      case Accounts::translation_rotation:
        return 2;
      case Accounts::per_contact:
        return std::max(2, 2 * e.contacts());
    }
    return 1;
  }

  template <class Visit>
  void for_each_contact(const Position<N>& x, const Velocity<N>& v, Visit visit) noexcept {
    if constexpr (N == 6)
      environment_.for_each_contact(x, port_vector<N>(v.vec()), clearance_, visit);
    else
      environment_.for_each_contact(x, v, visit);
  }
  /// Force and elastic energy of each account at the port. Tangential and rotational accounts store no energy.
  void evaluate(const PortMotion<N>& port) noexcept {
    for (Account& a : accounts_) {
      if (a.presses) a.on_environment = Vector::Zero(), a.presses = false;
      a.potential = {};
    }
    if (god_object_) return evaluate_god_object(port);
    Vector sum = Vector::Zero();
    for_each_contact(port.x, port.v, [&](const ContactPort<N>& c) {
      switch (options_.accounts) {
        case Accounts::total:
          accounts_[0].potential += c.potential;
          if (c.presses) sum += c.normal + c.tangential;
          break;
        case Accounts::normal_tangential:
          add(0, c);
          break;
        case Accounts::per_contact:
          add(2 * static_cast<std::size_t>(c.index), c);
          break;
        case Accounts::translation_rotation:
          accounts_[0].potential += c.potential;
          if constexpr (N == 6) {
            if (!c.presses) break;
            accounts_[0].presses = accounts_[1].presses = true;
            accounts_[0].on_environment.linear -= c.normal.linear + c.tangential.linear;
            accounts_[1].on_environment.angular -= c.normal.angular + c.tangential.angular;
          }
          break;
      }
    });
    if (options_.accounts == Accounts::total) accounts_[0].on_environment = -sum, accounts_[0].presses = true;
  }
  /// One account, of the spring between handle and proxy. What friction takes counts like stored energy: else it would cover what
  /// the spring generates.
  void evaluate_god_object(PortMotion<N> port) noexcept {
    god_object_->follow(port.x);
    accounts_[0].potential = god_object_->potential(port.x) + god_object_->friction_energy();
    accounts_[0].on_environment = -god_object_->force(port.x, port.v);
    accounts_[0].presses = true;
  }
  void add(std::size_t normal, const ContactPort<N>& c) noexcept {
    accounts_[normal].potential += c.potential;
    if (!c.presses) return;
    accounts_[normal].presses = accounts_[normal + 1].presses = true;
    accounts_[normal].on_environment -= c.normal;
    accounts_[normal + 1].on_environment -= c.tangential;
  }
  void potentials(const Position<N>& x, Energy Account::*out) noexcept {
    const bool per_contact = options_.accounts == Accounts::per_contact;
    for (Account& a : accounts_) a.*out = {};
    if (god_object_) {
      accounts_[0].*out = god_object_->energy_after(x);
      return;
    }
    const auto add = [&](int contact, Energy u) {
      accounts_[per_contact ? 2 * static_cast<std::size_t>(contact) : 0].*out += u;
    };
    if constexpr (N == 6)
      for_each_contact(x, Velocity<N>{}, [&](const ContactPort<N>& c) { add(c.index, c.potential); });
    else
      environment_.for_each_potential(x, add);
  }

  /// Energy of the interval that has just ended, with the force actually applied: every part by the same factor.
  void book(const PortMotion<N>& port, const Force<N>& applied, Seconds dt) noexcept {
    int i = 0;
    if (!started_) {
      // E(0) of the paper's eq. (1): what the environment already holds.
      for (const Account& a : accounts_) observer_.store(i++, a.potential);
    } else {
      const double asked = commanded_.squared_norm();
      const double scale =
          asked > 0.0 && !(applied.vec() == commanded_.vec()) ? std::sqrt(applied.squared_norm() / asked) : 1.0;
      const Interval<N> interval = port - before_;
      for (const Account& a : accounts_) {
        if (a.acts) observer_.book(i, scale * held_energy(options_.observer, a.held, interval, dt));
        ++i;
      }
    }
    before_ = port;
    started_ = true;
  }

  ControlOptions options_;
  ControllerOptions controller_;
  Environment<N> environment_;
  Clearance clearance_;                     ///< no state: without it the results are the same
  std::optional<GodObject<N>> god_object_;  ///< in place of the environment's forces
  std::vector<Account> accounts_;
  Observer<kAnyCapacity> observer_;
  Force<N> commanded_;
  PortMotion<N> before_;
  bool started_ = false;
};

template <int N>
Rendering<N>::Rendering(const ControlOptions& o, Environment<N> environment)
    : options_{o},
      controller_{controller_at_the_handle(o)},
      environment_{std::move(environment)},
      clearance_{environment_.clearance()},
      accounts_(static_cast<std::size_t>(accounts(o, environment_))),
      observer_{o.initial_energy, accounts(o, environment_)} {
  if (o.rendering == RenderingAlgorithm::god_object) god_object_.emplace(o.coupling, environment_);
}

template <int N>
auto Rendering<N>::step(const PortMotion<N>& port, const Force<N>& applied, Seconds dt, Seconds ended) noexcept
    -> Output {
  evaluate(port);
  book(port, applied, ended);
  if (options_.reference_energy) potentials(port.x + port.v * dt, &Account::next_potential);

  Output out{};
  int i = 0;
  for (Account& a : accounts_) {
    const Energy energy = observer_.energy(i++);
    const Budget budget = options_.reference_energy ? Budget{energy - a.potential, a.next_potential - a.potential}
                                                    : Budget{energy, Energy{}};
    const bool owes = !(budget.available >= Energy{}) || !(budget.rise <= budget.available);
    if (!a.presses && !owes) {
      a.acts = false;
      continue;
    }
    a.acts = true;
    const Force<N> wanted{a.on_environment};
    const Corrected<Force<N>> part = passivity_controller(wanted, port.v, budget, controller_, dt);
    a.held = part.out;
    out.wanted += wanted;
    out.command += part.out;
    out.dissipated += part.dissipated;
    out.undissipated += part.undissipated;
  }
  commanded_ = out.command;
  return out;
}

// Compiled once, in method/dof_N.cc.
extern template class Rendering<1>;
extern template class Rendering<3>;
extern template class Rendering<6>;

}  // namespace twoport
