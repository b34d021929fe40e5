#include "sim/sim_device.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace twoport::sim {
namespace {

HandSpec impedance(const Scene& scene) {
  return scene.operator_model && scene.operator_model->hand ? *scene.operator_model->hand : HandSpec{};
}

template <int N>
typename HandlePlant<N>::State start(const Scene& scene) {
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
template <int N>
Position<N> intent(const Scene& scene) {
  const bool waits = scene.operator_model && scene.operator_model->hand && scene.operator_model->path.empty();
  return waits ? Position<N>{} : start<N>(scene).x;
}

}  // namespace

template <int N>
SimDevice<N>::SimDevice(const Scene& scene, Seconds dt)
    : dt_{dt.si()},
      path_{scene.operator_model ? scene.operator_model->path : std::vector<SegmentSpec>{}, intent<N>(scene),
            scene.operator_model && scene.operator_model->tremor ? Tremor<N>{*scene.operator_model->tremor, scene.seed}
                                                                 : Tremor<N>{}},
      imposed_{scene.operator_model && !scene.operator_model->hand},
      handle_{scene.device.value_or(DeviceSpec{}), impedance(scene), scene.simulation, dt_, start<N>(scene)} {
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
      arm_ = std::make_unique<ArmPlant>(*scene.device->arm, nothing, dt_, x(), hand);
    }
  }
  encoder_.start(x(), v());
}

template <int N>
void SimDevice<N>::advance() noexcept {
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

template <int N>
bool SimDevice<N>::kick(const Velocity<N>& dv) noexcept {
  if (imposed_ || !handle_.moves()) return false;
  if constexpr (N == 6)
    if (arm_) arm_->kick(dv);
  auto state = handle_.state();
  state.v += port_vector<N>(dv.vec());
  handle_.set_state(state);
  return true;
}

template <int N>
void SimDevice<N>::actuate(const Force<N>& f) noexcept {
  held_ = f;
  if (!late_.empty()) [[unlikely]] {
    std::swap(held_, late_[next_]);
    next_ = (next_ + 1) % late_.size();
  }
}

template <int N>
void SimDevice<N>::release() noexcept {
  held_ = Force<N>{};
  std::fill(late_.begin(), late_.end(), Force<N>{});
}

template <int N>
void SimDevice<N>::move_arm() noexcept {
  if constexpr (N == 6) {
    if (hand_) arm_->lead(path_.at(static_cast<double>(tick_) * dt_).x);
    const BodyState<6> now = arm_->advance(Force<6>{-held_.vec()});
    applied_ = arm_->applied_part() * held_;
    handle_.set_state({now.x, port_vector<6>(now.v.vec())});
    energy_ = -arm_->port_energy();
  }
}

template <int N>
void SimDevice<N>::book(const Interval<N>& interval) noexcept {
  energy_ += held_energy(ObserverRule::exact, held_, interval, Seconds{dt_});
}

TWOPORT_COMPILE(SimDevice);

}  // namespace twoport::sim
