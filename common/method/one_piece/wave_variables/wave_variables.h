#pragma once

#include <cmath>

#include "common/method/coupling_slave.h"
#include "common/method/one_piece/wave_variables/gains.h"
#include "common/method/one_piece/wave_variables/receiver.h"

namespace twoport {

/// Master half of wave variables: impedance causality.
///
///     f_m = ρ (b v_m - sqrt(2b) w_rx)         u_m = sqrt(2b) v_m - w_rx        f·v = (u² - w²)/2 per axis
///
/// The wave that is sent is shortened where its energy would exceed what has entered at the port: the sampled damper, the
/// force ramp and the force limit then cannot create energy in the line.
///
///     Σ T|u|²/2 <= 0.2 E(0) + Σ f_applied·Δx + Σ T|w|²/2
///
/// The rest of E(0) belongs to the receivers, 0.4 E(0) each.
///
/// Source: Anderson, Spong, IEEE TAC 34(5), 1989; Niemeyer, Slotine, IEEE J. Oceanic Engineering 16(1), 1991.
template <int N>
class WaveMaster final : public Copyable<WaveMaster<N>, MasterHalf<N>> {
 public:
  explicit WaveMaster(const ControlOptions& o)
      : initial_{0.2 * o.initial_energy}, receiver_{o.wave_variables.receiver, 0.4 * o.initial_energy} {
    const WaveImpedance b = wave_impedance(o);
    impedance_ = per_axis<N>(b.translation, b.rotation);
    root_ = (2.0 * impedance_).cwiseSqrt();
  }

  void start(const DeviceSample<N>&) noexcept override { receiver_.start(); }
  MasterOutput<N> step(const MasterInput<N>& in) noexcept override {
    MasterOutput<N> out{};
    Wave<N> u;
    if (in.active) {
      const Energy level = stored(in.account);
      out.undissipated = positive_part(-level);
      const Wave<N> w = receiver_.step(in.slave, in.slave_energy_in, in.dt);
      const auto& v = in.device.v.vec();
      out.wanted = Force<N>{in.ramp * (impedance_.cwiseProduct(v) - root_.cwiseProduct(w.vec()))};
      out.f = out.wanted;
      cross(out, in, initial_);
      u = Wave<N>{root_.cwiseProduct(v) - w.vec()};
      const Energy enters = level + dot(out.f, in.device.v) * in.dt + Energy{0.5 * w.squared_norm() * in.dt.si()};
      const double most = 2.0 * std::max(0.0, enters.si()) / in.dt.si();
      if (u.squared_norm() > most) {
        out.dissipated = Energy{0.5 * (u.squared_norm() - most) * in.dt.si()};
        u = std::sqrt(most / u.squared_norm()) * u;
      }
    }
    sender_.send(u, in.dt);
    out.energy_in = sender_.energy();
    return out;
  }
  [[nodiscard]] Energy balance(const Ledger& account, Energy) const noexcept override {
    return stored(account) - initial_;
  }
  /// The line starts empty.
  void restart(const Ledger& account, Energy balance) noexcept override {
    base_ = account.net() - std::min(balance, Energy{});
    sender_.restart();
    receiver_.restart();
  }
  [[nodiscard]] bool has_payload() const noexcept override { return true; }
  void write_payload(Words& words) const noexcept override { write(sender_.packet(), words); }

 private:
  /// At this end of the line: 0.2 E(0), what has entered at the port and has been received, less what has been sent.
  [[nodiscard]] Energy stored(const Ledger& account) const noexcept {
    return initial_ + (account.net() - base_) + receiver_.energy() - sender_.energy();
  }

  Energy initial_, base_;
  WaveReceiver<N> receiver_;
  WaveSender<N> sender_;
  typename Force<N>::Vector impedance_, root_;  ///< b, sqrt(2b)
};

/// Slave half: admittance causality, solved together with the virtual coupling, f = f_0 + G v_sd, G = B + K T.
///
///     v_sd = (sqrt(2b) u_rx - f_0)/(b + G)     f_s = f_0 + G v_sd     w_s = u_rx - sqrt(2/b) f_s
///     f_0  = K (x_sd - x_s) - B v_s
///
/// All in the slave's units, where b is that of the master by s_f s_x. b = G reflects nothing.
template <int N>
class WaveSlave final : public Copyable<WaveSlave<N>, CouplingSlave<N>> {
  using Base = Copyable<WaveSlave<N>, CouplingSlave<N>>;

 public:
  using Vector = typename Force<N>::Vector;

  explicit WaveSlave(const ControlOptions& o)
      : Base{o},
        correction_per_s_{o.wave_variables.position_correction_per_s},
        receiver_{o.wave_variables.receiver, 0.4 * o.initial_energy} {
    const WaveImpedance b = wave_impedance(o);
    impedance_ = per_axis<N>(b.translation, b.rotation).cwiseQuotient(impedance_scale<N>(o));
    root_ = (2.0 * impedance_).cwiseSqrt();
  }

  void start(const RobotSample<N>& robot, bool engaged) noexcept override {
    CouplingSlave<N>::start(robot, engaged);
    receiver_.start();
  }
  SlaveOutput<N> step(const SlaveInput<N>& in) noexcept override {
    const auto wanted = this->want(in);
    auto& coupling = this->coupling_;
    Wave<N> w;
    Force<N> f;
    Velocity<N> v;
    u_ = Wave<N>{};
    if (in.active) {
      const Vector mobility = coupling.spring().mobility(in.dt);  // G⁻¹
      const Force<N> f_0 = coupling.spring().force(coupling.set_point() - in.robot.x, -in.robot.v);
      const Vector entering = (in.robot.ideal ? in.robot.f_environment : f_0).vec();
      const Vector stiff = in.robot.ideal ? impedance_ : Vector{impedance_ + mobility.cwiseInverse()};
      const Wave<N> correction = in.worlds.wave_to_master(correcting(in, stiff));
      const Energy received = in.worlds.to_master(in.master_energy_in);
      u_ = in.worlds.wave_to_slave(receiver_.step(in.master, received, in.dt, correction));
      v = Velocity<N>{(root_.cwiseProduct(u_.vec()) - entering).cwiseQuotient(stiff)};
      w = returned(Force<N>{root_.cwiseProduct(u_.vec()) - impedance_.cwiseProduct(v.vec())});
      f = in.robot.ideal ? in.robot.f_environment
                         : coupling.spring().force((coupling.set_point() + v * in.dt) - in.robot.x, v - in.robot.v);
    }
    SlaveOutput<N> out;
    if (!this->act(in, f, v, wanted.v, out)) [[unlikely]]
      return out;
    sent_before_ = sender_;
    sender_.send(w, in.dt);
    out.energy_in = sender_.energy();
    return out;
  }
  /// The wave that goes back is that of the applied force, of an ideal robot that of the velocity.
  void limited(SlaveOutput<N>& out, const RobotCommand<N>& asked, const RobotSample<N>& robot,
               Seconds dt) noexcept override {
    this->set_back(out, asked, robot, dt);
    Force<N> f = out.command.f;
    if (robot.ideal) f = Force<N>{root_.cwiseProduct(u_.vec()) - impedance_.cwiseProduct(out.command.v_d.vec())};
    sender_ = sent_before_;
    sender_.send(returned(f), dt);
    out.energy_in = sender_.energy();
  }
  SlaveOutput<N> fail_safe(const Ledger& account) noexcept override {
    SlaveOutput<N> out = CouplingSlave<N>::fail_safe(account);
    out.energy_in = sender_.energy();
    return out;
  }
  void restart(const Ledger& account, Energy balance) noexcept override {
    CouplingSlave<N>::restart(account, balance);
    sender_.restart();
    receiver_.restart();
  }
  [[nodiscard]] bool has_payload() const noexcept override { return true; }
  void write_payload(Words& words, const Registration<N>& worlds) const noexcept override {
    WavePayload<N> packet = sender_.packet();
    packet.wave.value = worlds.wave_to_master(packet.wave.value);
    packet.integral.value = worlds.wave_to_master(packet.integral.value);
    write(packet, words);
  }

 private:
  /// The wave of the velocity λ (x_m - x_sd), which brings the set point to the master's position.
  [[nodiscard]] Wave<N> correcting(const SlaveInput<N>& in, const Vector& stiff) const noexcept {
    if (correction_per_s_ == 0.0 || !in.coupled) return {};
    const Displacement<N> off = this->coupling_.target() - this->coupling_.set_point();
    return Wave<N>{stiff.cwiseProduct(correction_per_s_ * off.vec()).cwiseQuotient(root_)};
  }

  /// The wave that goes back where f acts.
  [[nodiscard]] Wave<N> returned(const Force<N>& f) const noexcept {
    return Wave<N>{u_.vec() - f.vec().cwiseProduct(2.0 * root_.cwiseInverse())};
  }

  double correction_per_s_;
  WaveReceiver<N> receiver_;            ///< in the master's world, as its packets
  WaveSender<N> sender_, sent_before_;  ///< sent_before_: before the last step
  Wave<N> u_;                           ///< received in the last step
  Vector impedance_, root_;
};

}  // namespace twoport
