#pragma once

#include <algorithm>

#include "common/base/scalar.h"

namespace twoport {

/// The account of one side of a link, which exchanges energy with the other side's until both have the same. ': of the other side, as
/// last heard, in this side's units.
///
///     V  = E(0) + energy put in at the port - S      told to the other side with S, the running total of what was sent
///     A  = V + S'                                    level: what may be given at the port
///     A' = V' + S                                    level of the other side once everything has arrived
///     S += min((A - A')/2, A), at least 0
///
/// While A >= 0 on both sides, what both ports have given together is at most the sum of both E(0): S' never exceeds what the other
/// side has taken from its V.
class ExchangeAccount {
 public:
  explicit ExchangeAccount(Energy initial) : initial_{initial}, net_{initial} {}

  void put_in(Energy e) noexcept { net_ += e; }
  /// What the other side tells: S' and V'.
  void hear(Energy sent, Energy net) noexcept {
    received_ = sent, net_of_other_ = net;
    heard_ = heard_ || net != Energy{} || sent != Energy{};
  }
  void share() noexcept {
    if (!heard_) return;
    const Energy x = std::min(0.5 * (level() - level_of_other()), level());
    sent_ += positive_part(x);
    net_ -= positive_part(x);
  }
  void restart(Energy balance) noexcept {
    net_ = initial_ + balance;
    sent_ = received_ = net_of_other_ = Energy{};
    heard_ = false;
  }
  /// A deficit is nobody's debt.
  void forgive() noexcept { net_ += positive_part(-level()); }

  [[nodiscard]] Energy initial() const noexcept { return initial_; }
  [[nodiscard]] Energy sent() const noexcept { return sent_; }
  [[nodiscard]] Energy net() const noexcept { return net_; }
  [[nodiscard]] Energy level() const noexcept { return net_ + received_; }
  [[nodiscard]] bool heard() const noexcept { return heard_; }
  [[nodiscard]] Energy level_of_other() const noexcept { return net_of_other_ + sent_; }
  /// A - E(0), if the other side has sent `sent`.
  [[nodiscard]] Energy balance(Energy sent) const noexcept { return net_ + sent - initial_; }

 private:
  Energy initial_, net_, sent_, received_, net_of_other_;
  bool heard_ = false;  ///< anything since the start
};

}  // namespace twoport
