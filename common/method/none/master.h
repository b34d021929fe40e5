#pragma once

#include "common/method/displayed_force.h"
#include "common/method/method.h"

namespace twoport {

/// No passivity control: the hand feels the force of the architecture unchanged.
template <int N>
class NoControlMaster {
 public:
  explicit NoControlMaster(const ControlOptions& o) : displayed_{o} {}

  void start(const DeviceSample<N>& device) noexcept { displayed_.start(device.x); }

  MasterOutput<N> step(const MasterInput<N>& in) noexcept {
    MasterOutput<N> out{};
    out.energy_in = in.account.absorbed() - base_absorbed_;
    if (!in.active) return out;
    out.wanted = in.ramp * displayed_.step(in.device, in.slave, in.dt);
    out.f = out.wanted;
    return out;
  }
  /// None: energy returned without control is not charged to the next method.
  [[nodiscard]] Energy deficit(const Ledger&, Energy) const noexcept { return Energy{}; }
  void restart(const Ledger& account, Energy) noexcept { base_absorbed_ = account.absorbed(); }
  static constexpr bool has_payload() noexcept { return false; }
  void write_payload(Words&) const noexcept {}

 private:
  DisplayedForce<N> displayed_;
  Energy base_absorbed_;
};

}  // namespace twoport
