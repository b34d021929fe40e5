#pragma once

#include <string_view>

#include "common/method/none/none.h"

namespace twoport {

/// The displayed force and a damper at the master:  f_m = ρ s_f f_rx + b v_m,  b = 2 N s/m.
template <int N>
class LocalDampingMaster {
 public:
  explicit LocalDampingMaster(const ControlOptions& o) : inner_{o} {}

  void start(const DeviceSample<N>& device) noexcept { inner_.start(device); }
  MasterOutput<N> step(const MasterInput<N>& in) noexcept {
    MasterOutput<N> out = inner_.step(in);
    if (in.active) out.f += Force<N>{kDamping_n_s_per_m * in.device.v.vec()};
    return out;
  }
  [[nodiscard]] Energy deficit(const Ledger& account, Energy e) const noexcept { return inner_.deficit(account, e); }
  void restart(const Ledger& account, Energy deficit) noexcept { inner_.restart(account, deficit); }
  static constexpr bool has_payload() noexcept { return false; }
  void write_payload(Words&) const noexcept {}

 private:
  static constexpr double kDamping_n_s_per_m = 2.0;
  NoControlMaster<N> inner_;
};

struct LocalDamping {
  static constexpr std::string_view kNames[] = {"LOCAL_DAMPING"};
  static constexpr std::string_view kSummary = "the displayed force and a damper at the master";
  template <int N>
  using Master = LocalDampingMaster<N>;
  template <int N>
  using Slave = NoControlSlave<N>;
};

}  // namespace twoport
