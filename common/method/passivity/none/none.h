#pragma once

#include "common/method/layers.h"

namespace twoport {

/// No passivity control: everything is displayed.
template <int N>
class NoPassivityMaster final : public Copyable<NoPassivityMaster<N>, MasterPassivity<N>> {
 public:
  explicit NoPassivityMaster(const ControlOptions&) {}
  Shown<N> limit(const Wish<N>& wish, const MasterInput<N>& in) noexcept override {
    return {.f = wish.total(), .energy_in = in.account.absorbed() - base_absorbed_};
  }
  /// None: energy returned without control is not charged to the next method.
  [[nodiscard]] Energy balance(const Ledger&, Energy) const noexcept override { return Energy{}; }
  void restart(const Ledger& account, Energy) noexcept override { base_absorbed_ = account.absorbed(); }

 private:
  Energy base_absorbed_;
};

/// Also of the layers that bound the hand's port alone.
template <int N>
class NoPassivitySlave final : public Copyable<NoPassivitySlave<N>, SlavePassivity<N>> {
 public:
  explicit NoPassivitySlave(const ControlOptions&) {}
};

}  // namespace twoport
