#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include "common/base/sanitized.h"
#include "common/link/delay_line.h"
#include "common/scene/scene.h"
#include "lab/engine/both_nodes.h"
#include "lab/engine/simulation.h"

namespace twoport::lab {

/// The environment's force as old as the way back makes it: of the slave's tick from which the newest report comes that the
/// master has. While the master hears nothing it goes on, as old as that report was when it came.
template <int N>
class DelayedForce {
 public:
  /// `gaps`: the slave does not send in every tick; between two reports the force goes on, as old as the last one was when it
  /// came.
  DelayedForce(const ImpairmentOptions& way_back, double rate_hz, bool gaps)
      : past_(std::bit_ceil(packets_in_flight(way_back, rate_hz))),
        mask_{past_.size() - 1},
        lag_{1 + std::lround(way_back.delay_s * rate_hz)} {
    if (gaps) tick_of_.resize(past_.size());
  }

  /// Of the slave's next tick.
  void put(const Force<N>& f) noexcept { past_[index(ticks_++)] = f; }
  /// In a tick of the master.
  void step(const PeerState<N>& slave, bool coupled) noexcept {
    if (slave.is_new) {
      lag_ = std::min(ticks_ + 1 - tick_of(slave.newest.sequence), static_cast<std::int64_t>(mask_ + 1));
    } else if (coupled && tick_of_.empty()) {
      return;
    }
    now_ = ticks_ >= lag_ ? past_[index(ticks_ - lag_)] : Force<N>{};
  }
  [[nodiscard]] const Force<N>& now() const noexcept { return now_; }
  /// After each tick of the slave: its packets so far.
  void note_sent(std::uint64_t sent) noexcept {
    if (!tick_of_.empty()) tick_of_[index(static_cast<std::int64_t>(sent))] = ticks_;
  }

 private:
  /// Number of the tick in which a packet was sent, counted as packets are.
  [[nodiscard]] std::int64_t tick_of(std::uint64_t sequence) const noexcept {
    const auto number = static_cast<std::int64_t>(sequence);
    return tick_of_.empty() ? number : tick_of_[index(number)];
  }
  [[nodiscard]] std::size_t index(std::int64_t k) const noexcept { return static_cast<std::size_t>(k) & mask_; }

  std::vector<Force<N>> past_;
  std::size_t mask_;                   ///< size less one; the size is a power of two
  std::vector<std::int64_t> tick_of_;  ///< of each packet; empty: one in every tick
  std::int64_t ticks_ = 0, lag_;
  Force<N> now_;
};

/// Both nodes over the scene's network in memory, and what nobody in the loop knows: the force that the hand should feel, and where the
/// hand's world is in the robot's.
template <int N, class Method = AnyMethod>
class LinkedNodes : public BothNodes<N, DelayLines<N>, Method> {
 public:
  using Base = BothNodes<N, DelayLines<N>, Method>;

  explicit LinkedNodes(const Scene& scene)
      : Base{scene},
        registration{scene.control},
        delayed_force_{with_playout(scene.to_master, scene.transmission_to_master), scene.slave_rate_hz,
                       scene.transmission_to_master.deadband.has_value()} {}

  void be_quiet() noexcept {
    this->network.keep_as_it_is();
    this->switch_times.end();
  }
  [[nodiscard]] LinkUse use() const {
    LinkUse use{this->master_mail.counts(), this->slave_mail.counts(), this->network.overflowed()};
    use.device_limits = this->master.limit_counts();
    use.not_displayed = this->master.not_displayed();
    use.robot_limits = this->slave.limit_counts();
    use.switches = this->master.epoch();
    return use;
  }

  /// `environment`: its force on the robot.
  auto slave_tick(auto& robot, TickAt at, const Force<N>& environment, auto... tap) noexcept {
    delayed_force_.put(environment);
    auto out = Base::slave_tick(robot, at, tap...);
    delayed_force_.note_sent(this->slave_mail.counts().sent);
    if (out.mode != slave_mode_) [[unlikely]]
      change_mode(out.mode);
    return out;
  }
  auto master_tick(auto& device, TickAt at, auto... tap) noexcept {
    auto out = Base::master_tick(device, at, tap...);
    delayed_force_.step(this->master_mail.known(), out.mode == Mode::coupled);
    return out;
  }

  [[nodiscard]] const Force<N>& delayed_force() const noexcept { return delayed_force_.now(); }
  [[nodiscard]] Mode slave_mode() const noexcept { return slave_mode_; }
  /// Of the hand's world in the robot's.
  [[nodiscard]] const Point<kAxes<N>>& origin() const noexcept { return origin_; }

  Registration<N> registration;

 private:
  /// Of the slave. When it begins to follow, the worlds have just been registered.
  void change_mode(Mode mode) noexcept {
    slave_mode_ = mode;
    if (mode != Mode::coupled) return;
    origin_ =
        this->slave.target().translation() - registration.to_slave(this->slave_mail.known().newest.x).translation();
  }

  DelayedForce<N> delayed_force_;
  Point<kAxes<N>> origin_ = Point<kAxes<N>>::Zero();
  Mode slave_mode_ = Mode::idle;
};

}  // namespace twoport::lab
