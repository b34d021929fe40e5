#pragma once

#include "common/method/layers.h"
#include "common/method/passivity/hand_spring.h"

namespace twoport {

/// The energy spring at the hand, for its port alone (HandSpring).
template <int N>
class EnergySpringMaster final : public Copyable<EnergySpringMaster<N>, MasterPassivity<N>> {
 public:
  explicit EnergySpringMaster(const ControlOptions& o) : hand_{o} {}

  Shown<N> limit(const Wish<N>& wish, const MasterInput<N>& in) noexcept override {
    hand_.observe(in);
    Shown<N> out;
    out.energy_in = in.account.absorbed() - base_absorbed_;
    hand_.limit(wish, wish.damped ? &wish.damper : nullptr, in, out);
    return out;
  }
  [[nodiscard]] Energy balance(const Ledger&, Energy) const noexcept override { return hand_.spring().energy(); }
  /// What the hand has put in beyond the credit is dropped with the first wish.
  void restart(const Ledger& account, Energy balance) noexcept override {
    base_absorbed_ = account.absorbed();
    hand_.spring().restart(account.net(), put_in_by_hand(balance, account));
  }
  void take_over(const typename Velocity<N>::Vector& ratio) noexcept override { hand_.take_over(ratio); }

 private:
  HandSpring<N> hand_;
  Energy base_absorbed_;
};

}  // namespace twoport
