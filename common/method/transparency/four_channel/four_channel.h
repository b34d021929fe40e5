#pragma once

#include <algorithm>
#include <tuple>

#include "common/method/coupled_by_position.h"
#include "common/method/layers.h"
#include "common/method/transparency/displayed_force.h"
#include "common/method/transparency/reaction_force_observer.h"

namespace twoport {

/// What is not given: force gains 1, bandwidth 200 rad/s.
inline double four_channel_force_gain(const ControlOptions& o) {
  return o.four_channel.force_gain.value_or(1.0);
}
inline double four_channel_bandwidth(const ControlOptions& o) {
  return o.four_channel.observer_bandwidth_rad_per_s.value_or(200.0);
}

/// What the master adds to its packets: the force of the hand on the handle.
template <int N>
struct HandForce {
  Latest<Force<N>> f;
  auto fields() { return std::tie(f); }
};

/// Master half of the four-channel architecture.
///
///     f_m = ρ (K (x_m - x_s,rx) + B (v_m - v_s,rx) + g s_f f_e,rx)        f̂_h = force of the hand, by observer
///
/// With `disturbance_observer`, acceleration control: all that acts on the handle besides f_m is cancelled and the forces act
/// through their sum. d̂: ReactionForceObserver without damping, of everything that acts against f_m.
///
///     m a = -K (x_m - x_s,rx) - B (v_m - v_s,rx) + g/2 (f̂_h - s_f f_e,rx),   f_m = ρ (-m a - d̂)
///
/// Source: Katsura, Matsumoto, Ohnishi, IEEE T-IE 54(1), 2007; as used for imitation learning, Adachi, Fujimoto, Sakaino, Tsuji, IROS 2018.
template <int N>
class FourChannelMaster final : public Copyable<FourChannelMaster<N>, MasterTransparency<N>> {
 public:
  explicit FourChannelMaster(const ControlOptions& o)
      : displayed_{coupled_by_position(o, o.coupling)},
        gain_{four_channel_force_gain(o)},
        hand_{per_axis<N>(o.handle_mass_kg, o.handle_inertia_kg_m2),
              per_axis<N>(o.known.device_damping_n_s_per_m, o.known.device_rotational_damping_n_m_s_per_rad),
              four_channel_bandwidth(o)},
        cancels_{o.four_channel.disturbance_observer},
        disturbance_{per_axis<N>(o.handle_mass_kg, o.handle_inertia_kg_m2), Force<N>::Vector::Zero(),
                     four_channel_bandwidth(o)} {}

  void start(const DeviceSample<N>& device) noexcept override {
    displayed_.start(device.x);
    hand_.start(device.v);
    disturbance_.start(device.v);
  }
  Wish<N> wish(const MasterInput<N>& in) noexcept override {
    // The handle's equation: m dv/dt = -f_applied - b v + f_h.
    const Force<N> on_hand = hand_.step(-in.device.applied, in.device.v, in.dt);
    const Force<N> disturbance = disturbance_.step(-in.device.applied, in.device.v, in.dt);
    hand_force_.f.value = in.active ? -on_hand : Force<N>{};
    if (!in.active) return {};
    const Force<N> position = displayed_.step(in.device, in.slave, in.dt);
    const Force<N> felt = gain_ * in.slave.newest.f;
    return {.idle = false,
            .f = in.ramp * (cancels_ ? position + 0.5 * (felt + gain_ * on_hand) - disturbance : position + felt)};
  }
  [[nodiscard]] bool has_payload() const noexcept override { return true; }
  void write_payload(Words& words) const noexcept override { write(hand_force_, words); }

 private:
  DisplayedForce<N> displayed_;
  double gain_;
  ReactionForceObserver<N> hand_;
  bool cancels_;
  ReactionForceObserver<N> disturbance_;
  HandForce<N> hand_force_;
};

/// Slave half: f_s = K (x_m,rx - x_s) + B (v_m,rx - v_s) + g f̂_h,rx/s_f; returns f_e, measured or by observer.
///
/// With `disturbance_observer`: m a = K (x_m,rx - x_s) + B (v_m,rx - v_s) + g/2 (f̂_h,rx/s_f - f_e), f_s = m a + d̂.
template <int N>
class FourChannelSlave final : public Copyable<FourChannelSlave<N>, SlaveTransparency<N>> {
  using Base = Copyable<FourChannelSlave<N>, SlaveTransparency<N>>;

 public:
  explicit FourChannelSlave(const ControlOptions& o)
      : Base{coupled_by_position(o, o.coupling)},
        gain_{four_channel_force_gain(o)},
        observes_{o.four_channel.reaction_force_observer},
        cancels_{o.four_channel.disturbance_observer},
        environment_{per_axis<N>(o.known.robot_mass_kg, o.known.robot_inertia_kg_m2), Vector::Zero(),
                     four_channel_bandwidth(o)} {}

  void start(const RobotSample<N>& robot, bool engaged) noexcept override {
    SlaveTransparency<N>::start(robot, engaged);
    environment_.start(robot.v);
    f_ = Force<N>{};
  }
  RobotWish<N> wish(const SlaveInput<N>& in) noexcept override {
    const auto wanted = this->want(in);
    Force<N> f = wanted.f;
    const Force<N> observed = environment_.step(f_, in.robot.v, in.dt);  // d̂, friction of the robot included
    const Force<N> felt = observes_ && !in.robot.ideal ? observed : in.robot.f_environment;
    HandForce<N> hand;
    if (in.coupled && !in.robot.ideal && read(in.master.words, hand)) {
      const Force<N> by_hand = gain_ * in.worlds.to_slave(hand.f.value);
      f += cancels_ ? 0.5 * (by_hand - gain_ * felt) + observed : by_hand;
    }
    return {.f = f, .v = wanted.v, .f_back = felt};
  }
  void acted(const Force<N>& f) noexcept override { f_ = f; }

 private:
  using Vector = typename Force<N>::Vector;
  double gain_;
  bool observes_, cancels_;
  ReactionForceObserver<N> environment_;
  Force<N> f_;
};

}  // namespace twoport
