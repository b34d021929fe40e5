#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "common/base/built_for.h"
#include "common/base/copied.h"
#include "common/hardware/device.h"
#include "common/passivity/observer.h"
#include "common/scene/scene.h"
#include "sim/operator/hand.h"
#include "sim/operator/path.h"
#include "sim/plant/arm.h"
#include "sim/plant/handle.h"
#include "sim/sensor.h"
#include "sim/sim_joints.h"

namespace twoport::sim {

/// A hand on a haptic device. Blocks that the scene does not name cost nothing and are ideal: no
/// hand impedance, the path is imposed; no operator, nobody holds; neither device nor operator, the handle rests.
template <int N>
class SimDevice final {
 public:
  /// `dt` is the control period; the handle starts where the device block says.
  SimDevice(const Scene& scene, Seconds dt);

  /// Advances the model by one control period, under the force held since the last actuate.
  void advance() noexcept;

  /// From now on the hand holds where it is, without a tremor.
  void hold() noexcept { path_.hold(static_cast<double>(tick_) * dt_); }
  /// Adds dv to the velocity of a handle that forces move. False where the hand leads it or it has no mass.
  bool kick(const Velocity<N>& dv) noexcept;

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
  void actuate(const Force<N>& f) noexcept;
  void release() noexcept;

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

  void move_arm() noexcept;
  /// Energy into the master port under the force that was held.
  void book(const Interval<N>& interval) noexcept;

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
TWOPORT_DECLARE(SimDevice);

}  // namespace twoport::sim
