#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "common/base/copied.h"
#include "common/hardware/device.h"
#include "common/passivity/observer.h"
#include "common/scene/scene.h"
#include "sim/operator/hand.h"
#include "sim/operator/path.h"
#include "sim/plant/arm.h"
#include "sim/plant/handle.h"
#include "sim/sensor.h"

namespace twoport::sim {

/// A hand on a haptic device. Blocks that the scene does not name cost nothing and are ideal: no
/// hand impedance, the path is imposed; no operator, nobody holds; neither device nor operator, the handle rests.
template <int N>
class SimDevice final {
 public:
  /// `dt` is the control period; the handle starts where the device block says.
  SimDevice(const Scene& scene, Seconds dt)
      : dt_{dt.si()},
        path_{scene.operator_model ? scene.operator_model->path : std::vector<SegmentSpec>{}, intent(scene),
              scene.operator_model && scene.operator_model->tremor
                  ? Tremor<N>{*scene.operator_model->tremor, scene.seed}
                  : Tremor<N>{}},
        imposed_{scene.operator_model && !scene.operator_model->hand},
        handle_{scene.device.value_or(DeviceSpec{}), impedance(scene), scene.simulation, dt_, start(scene)} {
    if (imposed_) handle_.set_state({x(), port_vector<N>(path_.at(0.0).v.vec())});
    if (scene.operator_model && scene.operator_model->hand)
      hand_.emplace(*scene.operator_model->hand, dt_, path_.at(0.0).x);
    if (scene.operator_model && scene.operator_model->hand)
      push_ = port_vector<N>(vector<N>(scene.operator_model->hand->force_n));
    if (scene.device) late_.resize(static_cast<std::size_t>(std::lround(scene.device->force_latency_s / dt_)));
    if (scene.device) encoder_ = {*scene.device, dt_};
    if constexpr (N == 6) {
      if (scene.device && scene.device->arm) {
        const auto nothing = std::make_shared<const Environment<6>>(std::vector<EnvironmentSpec>{});
        std::optional<HandOnTool> hand;
        if (scene.operator_model && scene.operator_model->hand)
          hand = HandOnTool{*scene.operator_model->hand, path_.at(0.0).x, path_.at(0.0).x};
        arm_ = make_arm(*scene.device->arm, nothing, dt_, x(), hand);
      }
    }
    encoder_.start(x(), v());
  }

  /// Advances the model by one control period, under the force held since the last actuate.
  void advance() noexcept {
    applied_ = held_;
    ++tick_;
    if (arm_) [[unlikely]] {
      move_arm();
    } else if (imposed_) {
      auto s = path_.at(static_cast<double>(tick_) * dt_);
      book({s.x - x(), v(), s.v});
      handle_.set_state({s.x, port_vector<N>(s.v.vec())});
    } else if (handle_.moves()) {
      Vector u = push_ - port_vector<N>(held_.vec()), w = Vector::Zero();
      if (hand_) hand_->add_load(path_.at(static_cast<double>(tick_) * dt_).x, x(), handle_.state().v, u, w);
      book(handle_.advance(u, w));
    }
    if (!encoder_.ideal()) encoder_.sample(x(), v());
  }

  /// From now on the hand holds where it is, without a tremor.
  void hold() noexcept { path_.hold(static_cast<double>(tick_) * dt_); }
  /// Adds dv to the velocity of a handle that forces move. False where the hand leads it or it has no mass.
  bool kick(const Velocity<N>& dv) noexcept {
    if (imposed_ || !handle_.moves()) return false;
    if constexpr (N == 6)
      if (arm_) arm_->kick(dv);
    auto state = handle_.state();
    state.v += port_vector<N>(dv.vec());
    handle_.set_state(state);
    return true;
  }

  [[nodiscard]] DeviceSample<N> sense() const noexcept {
    return encoder_.ideal() ? DeviceSample<N>{x(), v(), applied_}
                            : DeviceSample<N>{encoder_.x(), encoder_.v(), applied_};
  }
  /// The same for run_cycle: the caller advances.
  template <class Clock>
  DeviceSample<N> sense(const Tick<Clock>&) const noexcept {
    return sense();
  }

  /// Holds any force: the limits are the node's to keep.
  void actuate(const Force<N>& f) noexcept {
    held_ = f;
    if (!late_.empty()) [[unlikely]] {
      std::swap(held_, late_[next_]);
      next_ = (next_ + 1) % late_.size();
    }
  }
  void release() noexcept {
    held_ = Force<N>{};
    std::fill(late_.begin(), late_.end(), Force<N>{});
  }

  /// True values: position, velocity, the force held now, and the energy into the master port since the start, E(0) not
  /// included.
  [[nodiscard]] const Position<N>& x() const { return handle_.state().x; }
  [[nodiscard]] Velocity<N> v() const { return handle_.velocity(); }
  [[nodiscard]] const Force<N>& held() const { return held_; }
  [[nodiscard]] Energy port_energy() const { return energy_; }
  [[nodiscard]] const Path<N>& path() const { return path_; }
  /// The arm that carries the handle, where there is one.
  [[nodiscard]] const ArmPlant* arm() const noexcept requires(N == 6) { return arm_.get(); }

 private:
  using Vector = PortVector<N>;

  static HandSpec impedance(const Scene& scene) {
    return scene.operator_model && scene.operator_model->hand ? *scene.operator_model->hand : HandSpec{};
  }
  static typename HandlePlant<N>::State start(const Scene& scene) {
    const DeviceSpec device = scene.device.value_or(DeviceSpec{});
    const bool recorded = scene.operator_model && scene.operator_model->path.size() == 1 &&
                          std::holds_alternative<RecordedHandSpec>(scene.operator_model->path[0]);
    if (recorded) {
      const auto hand = Path<N>{scene.operator_model->path, Position<N>{}}.at(0.0);
      return {hand.x, port_vector<N>(hand.v.vec())};
    }
    return {position<N>(device.position_m), port_vector<N>(vector<N>(device.velocity_m_per_s))};
  }
  /// Start of the intended motion: the handle's position; a hand without a path holds the origin.
  static Position<N> intent(const Scene& scene) {
    const bool waits = scene.operator_model && scene.operator_model->hand && scene.operator_model->path.empty();
    return waits ? Position<N>{} : start(scene).x;
  }

  void move_arm() noexcept {
    if constexpr (N == 6) {
      if (hand_) arm_->lead(path_.at(static_cast<double>(tick_) * dt_).x);
      const BodyState<6> now = arm_->advance(Force<6>{-held_.vec()});
      handle_.set_state({now.x, port_vector<6>(now.v.vec())});
      energy_ = -arm_->port_energy();
    }
  }

  /// Energy into the master port under the force that was held.
  void book(const Interval<N>& interval) noexcept {
    energy_ += held_energy(ObserverRule::exact, held_, interval, Seconds{dt_});
  }

  double dt_;
  Path<N> path_;
  bool imposed_;
  HandlePlant<N> handle_;
  std::optional<Hand<N>> hand_;
  Encoder<N> encoder_;
  Copied<ArmPlant> arm_;  ///< N = 6

  Force<N> applied_, held_;
  Vector push_ = Vector::Zero();  ///< constant force of the hand
  std::vector<Force<N>> late_;    ///< a ring: commands under way to the handle
  std::size_t next_ = 0;
  Energy energy_;
  std::int64_t tick_ = 0;
};

}  // namespace twoport::sim
