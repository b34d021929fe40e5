#pragma once

#include <algorithm>
#include <cmath>
#include <tuple>

#include "common/link/mailbox.h"
#include "common/method/one_piece/wave_variables/options.h"

namespace twoport {

/// A wave [sqrt(W)] of each axis, and its integral over time [sqrt(W) s], both in the master's units. |wave|²/2 is power.
template <int N>
using Wave = Coords<struct WaveKind, N>;
template <int N>
using WaveIntegral = Coords<struct WaveIntegralKind, N>;

/// In every packet, in both directions. The energy of the wave, Σ T |u|²/2, is the report's `energy_in`.
template <int N>
struct WavePayload {
  Latest<Wave<N>> wave;
  Latest<WaveIntegral<N>> integral;
  auto fields() { return std::tie(wave, integral); }
};

/// What a side has sent: each wave is held for a tick.
template <int N>
class WaveSender {
 public:
  void send(const Wave<N>& u, Seconds dt) noexcept {
    packet_.wave.value = u;
    packet_.integral.value += WaveIntegral<N>{u.vec() * dt.si()};
    energy_ += Energy{0.5 * u.squared_norm() * dt.si()};
  }
  void restart() noexcept { packet_ = {}, energy_ = Energy{}; }
  [[nodiscard]] Energy energy() const noexcept { return energy_; }
  [[nodiscard]] const WavePayload<N>& packet() const noexcept { return packet_; }

 private:
  WavePayload<N> packet_;
  Energy energy_;
};

/// Plays the other side's wave through delay, jitter and loss.
///
///     HOLD             u = u_rx
///     ZERO             u = u_rx in a tick in which a packet has arrived, else 0
///     ENERGY_LIMITED   U* = U_rx, or U* + T u_rx in a tick without a packet
///                      u  = u_rx + c + (T/τ) ((U* - ΣT u)/T - u_rx),  τ = 20 ms,  then shortened so that
///                      Σ T|u|²/2 <= E_0 + E_rx, E_rx: the largest energy that a packet has reported as sent
///
/// U: integral of the wave. Without loss and jitter every rule plays u_rx. In a tick without a packet E_0 pays for u_rx, and is
/// repaid by the next packet. A gap that costs more than E_0 shortens the wave, and what it lacks then is not made up for:
/// of a constant wave, catching up costs twice the energy that the gap has left over. c: a correction of the caller, which
/// only spends energy that the wave leaves over. ENERGY_LIMITED creates at most E_0 whatever the network does, as E_rx is
/// monotone; HOLD may create any.
/// Source: wave integrals, Niemeyer, Slotine, Int. J. Robotics Research 23(9), 2004; energy limit, Secchi, Stramigioli,
/// Fantuzzi, and Hirche, Buss, for reconstruction after losses.
template <int N>
class WaveReceiver {
 public:
  explicit WaveReceiver(WaveReceiverRule rule, Energy initial = {}) : rule_{rule}, initial_{initial} {}

  Wave<N> step(const PeerState<N>& peer, Energy received, Seconds dt, const Wave<N>& correction = {}) noexcept {
    WavePayload<N> packet;
    if (!read(peer.words, packet)) return {};
    const Wave<N>& newest = packet.wave.value;
    if (rule_ == WaveReceiverRule::hold) return play(newest, dt);
    if (rule_ == WaveReceiverRule::zero) return play(peer.is_new ? newest : Wave<N>{}, dt);
    target_ = peer.is_new ? packet.integral.value : target_ + WaveIntegral<N>{newest.vec() * dt.si()};
    if (starts_) played_ = target_ - WaveIntegral<N>{newest.vec() * dt.si()};
    starts_ = false;
    const auto missing = target_.vec() - played_.vec() - newest.vec() * dt.si();
    Wave<N> u{newest.vec() + correction.vec() + missing / std::max(dt.si(), kMakeUp_s)};
    const double most = 2.0 * std::max(0.0, (initial_ + received - energy_).si()) / dt.si();
    if (u.squared_norm() > most) u = std::sqrt(most / u.squared_norm()) * u;
    return play(u, dt);
  }
  /// A coupling begins: what was sent before is not played.
  void start() noexcept { starts_ = true; }
  void restart() noexcept { target_ = played_ = WaveIntegral<N>{}, energy_ = Energy{}; }
  /// Played since the start.
  [[nodiscard]] Energy energy() const noexcept { return energy_; }

 private:
  static constexpr double kMakeUp_s = 0.02;

  Wave<N> play(const Wave<N>& u, Seconds dt) noexcept {
    played_ += WaveIntegral<N>{u.vec() * dt.si()};
    energy_ += Energy{0.5 * u.squared_norm() * dt.si()};
    return u;
  }

  WaveReceiverRule rule_;
  Energy initial_;  ///< E_0
  WaveIntegral<N> target_, played_;
  Energy energy_;
  bool starts_ = true;
};

}  // namespace twoport
