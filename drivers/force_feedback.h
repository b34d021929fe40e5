#pragma once

#include <linux/input.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <optional>

#include "common/base/time.h"
#include "drivers/evdev_stick.h"
#include "drivers/newest.h"

namespace twoport {

/// Force-feedback requests of the kernel (Documentation/input/ff.rst), so that tests can stand in for a joystick.
class EffectPort {
 public:
  virtual ~EffectPort() = default;
  /// EVIOCSFF: a new effect where effect.id is -1, which gets its number then; else an update. May take milliseconds.
  virtual bool upload(ff_effect& effect) noexcept = 0;
  virtual void erase(int id) noexcept = 0;
  /// An EV_FF event: FF_GAIN, FF_AUTOCENTER, or the number of an effect with how often to play it, 0: stop.
  virtual bool write(unsigned code, int value) noexcept = 0;
};

/// Displays a force (right, forward) by one constant effect of a joystick. push(), let_go() and played() are for the control step: they set and
/// read numbers. start(), round() and end() talk to the device and belong to another thread.
///
/// The strength of the strongest effect is `full_n`; a stronger force is displayed as that, in its direction. An effect ends by itself after
/// kEffectLength unless a round renews it. After let_go(), or kEffectLength after the last push(), the force goes to zero within kRamp.
class ForceFeedback {
 public:
  static constexpr Duration kPeriod = std::chrono::milliseconds{10};
  static constexpr Duration kEffectLength = std::chrono::milliseconds{100};
  static constexpr Duration kRamp = std::chrono::milliseconds{50};
  using Vector = std::array<double, 2>;

  ForceFeedback(EffectPort& port, double full_n) : port_{port}, full_n_{full_n} {}

  /// False: the device takes no constant effect. Its own centring spring is switched off, as nobody accounts for its force.
  bool start() noexcept {
    ff_effect effect = effect_of({0.0, 0.0});
    if (!port_.upload(effect)) return false;
    id_ = effect.id;
    port_.write(FF_AUTOCENTER, 0);
    port_.write(FF_GAIN, 0xffff);
    return true;
  }

  void push(double right_n, double forward_n) noexcept { newest_.put(Vector{right_n, forward_n}); }
  void let_go() noexcept { newest_.put(std::nullopt); }
  /// What the device displays.
  [[nodiscard]] Vector played() const noexcept {
    return {played_right_n_.load(std::memory_order_relaxed), played_forward_n_.load(std::memory_order_relaxed)};
  }

  /// Uploads and plays what is wanted.
  void round(Duration now) noexcept {
    if (newest_.take(push_)) heard_at_ = now;
    const Vector wanted = push_ && now - heard_at_ < kEffectLength
                              ? limited(*push_)
                              : weaker(played(), full_n_ * (std::chrono::duration<double>(now - round_at_) / kRamp));
    round_at_ = now;
    ff_effect effect = effect_of(wanted);
    if (port_.upload(effect) && port_.write(static_cast<unsigned>(id_), 1)) {
      played_at_ = now;
      set_played(wanted);
    } else if (now - played_at_ >= kEffectLength) {
      set_played({0.0, 0.0});  // the last effect has ended
    }
  }

  /// Nothing is left to be taken to zero.
  [[nodiscard]] bool at_rest() const noexcept { return played() == Vector{}; }

  /// The force goes to zero; the effect is removed.
  void end() noexcept {
    if (id_ < 0) return;
    port_.write(static_cast<unsigned>(id_), 0);
    port_.erase(id_);
    set_played({0.0, 0.0});
    id_ = -1;
  }

 private:
  [[nodiscard]] ff_effect effect_of(const Vector& push_n) const noexcept {
    return constant_force(push_n, full_n_, id_,
                          static_cast<std::uint16_t>(kEffectLength / std::chrono::milliseconds{1}));
  }
  [[nodiscard]] Vector limited(const Vector& f) const noexcept {
    const double norm = std::hypot(f[0], f[1]);
    if (!std::isfinite(norm)) return {0.0, 0.0};
    return norm > full_n_ ? Vector{f[0] * full_n_ / norm, f[1] * full_n_ / norm} : f;
  }
  static Vector weaker(const Vector& f, double by_n) noexcept {
    const double norm = std::hypot(f[0], f[1]);
    return norm > by_n ? Vector{f[0] * (1.0 - by_n / norm), f[1] * (1.0 - by_n / norm)} : Vector{0.0, 0.0};
  }
  void set_played(const Vector& f) noexcept {
    played_right_n_.store(f[0], std::memory_order_relaxed);
    played_forward_n_.store(f[1], std::memory_order_relaxed);
  }

  EffectPort& port_;
  double full_n_;
  int id_ = -1;
  Duration round_at_{0}, played_at_{0}, heard_at_{0};
  Newest<std::optional<Vector>> newest_;
  std::optional<Vector> push_;  ///< the newest; nothing: let go
  std::atomic<double> played_right_n_{0.0}, played_forward_n_{0.0};
};

}  // namespace twoport
