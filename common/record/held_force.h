#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "common/record/row.h"
#include "common/scene/scene.h"

namespace twoport {

/// An interval of the run [s].
struct Rest {
  double from_s, to_s;
};

/// When the operator's intended motion is at rest: `hold` segments and everything after the path's end. Each rest begins one
/// round trip of the scene's constant delays later, because until then both sides still show the motion before it. A tremor is
/// ignored. Nothing where the scene has no operator.
std::optional<std::vector<Rest>> rests(const Scene& scene);

/// Force felt while the hand presses and rests:
///
///     ratio = |mean f| / |mean r|      f: felt force, r: the environment's force as it should be felt (Row::reference)
///
/// Means over the last `kWindow` during which robot and environment touch and the intended motion rests, both without
/// interruption. The window therefore ends at the last tick before the motion goes on, before contact is lost, or at the end of
/// the run. Windows with |mean r| <= 0.2 N do not count.
///
/// Where the intended motion is not known (a person at a real device), the run in contact is divided into windows, and the last
/// one counts in which hand and robot have each moved by less than 2 mm/s on average. If the hand lets go slowly this window
/// contains the beginning of the retreat.
template <int N>
class HeldForce {
 public:
  static constexpr double kWindow = 0.1;      ///< [s]
  static constexpr double kLeast = 0.2;       ///< of the mean reference [N]
  static constexpr double kRestSpeed = 2e-3;  ///< where the intended motion is not known [m/s]
  using Vector = Eigen::Matrix<double, kAxes<N>, 1>;

  HeldForce(double rate_hz, std::optional<std::vector<Rest>> rests)
      : window_(static_cast<std::size_t>(std::max(1L, std::lround(kWindow * rate_hz)))),
        known_{rests.has_value()},
        rests_{std::move(rests).value_or(std::vector<Rest>{})} {}

  /// A tick in which robot and environment touch.
  void add(const Row<N>& row, const Vector& felt, const Vector& reference) noexcept {
    if (known_ && !at_rest(row.t_s)) {
      interrupt();
      return;
    }
    if (ticks_ == 0) [[unlikely]]
      from_ = {row.master_x.translation(), row.slave_x.translation()};
    window_[next_] = {felt, reference};
    if (++next_ == window_.size()) next_ = 0;
    ++ticks_;
    if (!known_ && ticks_ == window_.size()) [[unlikely]]
      end_window({row.master_x.translation(), row.slave_x.translation()});
  }
  /// Contact is lost or the motion goes on.
  void interrupt() noexcept {
    if (ticks_ == 0) return;
    if (known_) ratio_ = ratio();
    ticks_ = 0;
  }
  /// As after windows whose last one had this ratio.
  void set(std::optional<double> ratio) { ratio_ = ratio; }
  /// So far. Nothing: there has been no such window.
  [[nodiscard]] std::optional<double> ratio() const noexcept {
    if (!known_ || ticks_ < window_.size()) return ratio_;
    const std::optional<double> mean = ratio_of_means();
    return mean ? mean : ratio_;
  }

 private:
  struct Forces {
    Vector felt, reference;
  };
  struct Positions {
    Vector master, slave;
  };
  [[nodiscard]] bool at_rest(double t_s) noexcept {
    while (current_ < rests_.size() && t_s >= rests_[current_].to_s) ++current_;
    return current_ < rests_.size() && t_s >= rests_[current_].from_s;
  }
  void end_window(Positions to) noexcept {
    const double largest = kRestSpeed * kWindow;
    if ((to.master - from_.master).norm() < largest && (to.slave - from_.slave).norm() < largest)
      if (const std::optional<double> mean = ratio_of_means()) ratio_ = mean;
    ticks_ = 0;
  }
  [[nodiscard]] std::optional<double> ratio_of_means() const noexcept {
    Vector felt = Vector::Zero(), reference = Vector::Zero();
    for (const Forces& each : window_) {
      felt += each.felt;
      reference += each.reference;
    }
    const double held = reference.norm();
    if (!(held > kLeast * static_cast<double>(window_.size()))) return std::nullopt;
    return felt.norm() / held;
  }

  std::vector<Forces> window_;  ///< the newest, in a circle
  std::size_t next_ = 0, ticks_ = 0, current_ = 0;
  bool known_;
  std::vector<Rest> rests_;
  Positions from_{Vector::Zero(), Vector::Zero()};
  std::optional<double> ratio_;
};

}  // namespace twoport
