#pragma once

#include <linux/input.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "common/base/time.h"
#include "drivers/force_feedback.h"
#include "drivers/newest.h"

namespace twoport {

/// Displays the size f of a force by the two motors of a gamepad, in shares of full speed,
///
///     strong = min(f / f_full, 1),   weak = min(max(f - f_slow, 0) / f_full, 1),   f_slow: f low-passed with 100 ms
///
/// so that the weak one tells where a contact begins. push() and let_go() are for the control step; start(), round() and end() talk to the
/// device and belong to another thread.
///
/// The motors stop with let_go(), and kEffectLength after the last push() or round().
class Rumble {
 public:
  static constexpr Duration kEffectLength = ForceFeedback::kEffectLength;

  Rumble(EffectPort& port, double full_n) : port_{port}, full_n_{full_n} {}

  /// False: the device takes no rumble effect.
  bool start() noexcept {
    if (!port_.upload(effect_)) return false;
    port_.write(FF_GAIN, 0xffff);
    return true;
  }
  /// The size of the force [N]; one that is not finite is none.
  void push(double n) noexcept { newest_.put(n); }
  void let_go() noexcept { newest_.put(0.0); }

  /// Uploads and plays what is wanted where that has changed, or would end soon.
  void round(Duration now) noexcept {
    if (newest_.take(force_n_)) heard_at_ = now;
    const double f = now - heard_at_ < kEffectLength && std::isfinite(force_n_) ? force_n_ : 0.0;
    slow_n_ += (f - slow_n_) * std::min(1.0, std::chrono::duration<double>(now - round_at_) / kOnset);
    round_at_ = now;
    ff_rumble_effect wanted{};
    wanted.strong_magnitude = level(f);
    wanted.weak_magnitude = level(f - slow_n_);
    ff_rumble_effect& played = effect_.u.rumble;
    const bool same =
                   wanted.strong_magnitude == played.strong_magnitude && wanted.weak_magnitude == played.weak_magnitude,
               silent = wanted.strong_magnitude == 0 && wanted.weak_magnitude == 0;
    if (same && (silent || now - played_at_ < kEffectLength / 2)) return;
    const ff_rumble_effect before = played;
    played = wanted;
    if (port_.upload(effect_) && port_.write(static_cast<unsigned>(effect_.id), 1))
      played_at_ = now;
    else
      played = before;
  }
  /// end() leaves nothing to be taken to zero.
  [[nodiscard]] static constexpr bool at_rest() noexcept { return true; }
  /// The motors stop; the effect is removed.
  void end() noexcept {
    if (effect_.id < 0) return;
    port_.write(static_cast<unsigned>(effect_.id), 0);
    port_.erase(effect_.id);
    effect_.id = -1;
  }

 private:
  static constexpr std::chrono::duration<double> kOnset{0.1};

  [[nodiscard]] std::uint16_t level(double n) const noexcept {
    return static_cast<std::uint16_t>(std::lround(0xffff * std::clamp(n / full_n_, 0.0, 1.0)));
  }
  static ff_effect no_effect() noexcept {
    ff_effect effect{};
    effect.type = FF_RUMBLE;
    effect.id = -1;
    effect.replay.length = static_cast<std::uint16_t>(kEffectLength / std::chrono::milliseconds{1});
    return effect;
  }

  EffectPort& port_;
  double full_n_;
  ff_effect effect_ = no_effect();  ///< as the device has it
  Newest<double> newest_;
  double force_n_ = 0.0, slow_n_ = 0.0;
  Duration heard_at_{0}, round_at_{0}, played_at_{0};
};

}  // namespace twoport
