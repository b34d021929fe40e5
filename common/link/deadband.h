#pragma once

#include <algorithm>
#include <cmath>

#include "common/base/time.h"
#include "common/link/report.h"
#include "common/link/transmission.h"

namespace twoport {

/// Decides at the sender whether a report is transmitted. With q0 the quantity in the packet sent last:
///
///     |q - q0| > max(floor, ratio |q0|)     q: v, f, f_coupling, f_environment; x with its floor only
///     E_in - E_in,0 > energy_j,  a change of mode or epoch,  the mode stopped or ended,  or silence_s since the last packet
///
/// Packets carry running totals of energy, so one that is left out delays them and loses nothing.
/// Source: Hinterseer, Hirche, Chaudhuri, Steinbach, Buss, IEEE T-SP 56(2), 2008; energy attached: Xu, Cizmeci,
/// Schuwerk, Steinbach, IEEE T-Haptics 9(4), 2016.
template <int N>
class Deadband {
 public:
  explicit Deadband(const DeadbandOptions& options) : o_{options}, silence_{to_duration(options.silence_s)} {}

  /// True: send it; it is then the last one sent.
  bool tells(const PortReport<N>& r, Duration now) noexcept {
    const bool is_new = !sent_ || now - sent_at_ >= silence_ || r.mode != last_.mode || r.mode >= Mode::stopped ||
                        r.epoch != last_.epoch || r.energy_in_j - last_.energy_in_j > o_.energy_j ||
                        (r.x - last_.x).squared_norm() > o_.position_m * o_.position_m ||
                        differs(r.v, last_.v, o_.velocity_m_per_s) || differs(r.f, last_.f, o_.force_n) ||
                        differs(r.f_coupling, last_.f_coupling, o_.force_n) ||
                        differs(r.f_environment, last_.f_environment, o_.force_n);
    if (!is_new) return false;
    last_ = r;
    sent_at_ = now;
    sent_ = true;
    return true;
  }

 private:
  template <class Quantity>
  [[nodiscard]] bool differs(const Quantity& now, const Quantity& before, double floor) const noexcept {
    const double least = std::max(floor * floor, o_.ratio * o_.ratio * before.squared_norm());
    return (now - before).squared_norm() > least;
  }

  DeadbandOptions o_;
  Duration silence_, sent_at_{0};
  PortReport<N> last_;
  bool sent_ = false;
};

}  // namespace twoport
