#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "common/coupling/motor_mask.h"
#include "common/link/clock_offset.h"
#include "common/link/mailbox.h"
#include "common/record/row.h"
#include "common/safety/limits.h"
#include "common/scene/scene.h"
#include "sim/operator/path.h"

namespace twoport::lab {

/// What happened to the packets of a run over a link.
struct LinkUse {
  PacketCounts master, slave;    ///< as each side has counted them
  std::uint64_t overflowed = 0;  ///< found the delay line full
  std::uint32_t switches = 0;    ///< of method or architecture
  LimitCounts device_limits{}, robot_limits{};
  NotDisplayed not_displayed{};
  std::optional<ClockFigures> clock{};  ///< the master's estimate of the slave's clock, where that differs
};

/// Which sides a kick has moved: not one that the hand leads or that is ideal.
struct Kicked {
  bool master, slave;
};

template <int N>
struct Taps;

/// What a run throws that has been stopped.
struct Stopped {};

/// A scene in virtual time. The tick itself is compiled once for each size and kind of scene (lab/engine/loops.h); through this
/// interface a run is started, not a tick.
template <int N>
class Simulation {
 public:
  explicit Simulation(const Scene& scene) : end_{to_duration(scene.duration_s)} {}
  virtual ~Simulation() = default;
  Simulation& operator=(const Simulation&) = delete;

  using Visit = std::function<bool(const Row<N>&)>;
  /// Goes on until the time `end`, or until visit(row) returns false. Returns the number of ticks.
  std::uint64_t run_until(Duration end, const Visit& visit) {
    if (stop_ == nullptr) return advance(end, visit);
    return advance(end, [&](const Row<N>& row) {
      if (visited_++ % kEvery == 0 && *stop_) throw Stopped{};
      return visit(row);
    });
  }
  /// The same to the end of the scene.
  std::uint64_t run(const Visit& visit) { return run_until(end_, visit); }
  /// From the start to the end of the scene with nobody looking on.
  virtual std::uint64_t run_silently() {
    return run([](const Row<N>&) { return true; });
  }
  /// From now on this simulation, and its copies, end by throwing Stopped within kEvery ticks after `stop` has become true.
  void stop_at(const std::atomic<bool>& stop) { stop_ = &stop; }

  /// Another one in the same state: both go on identically, and neither touches the other.
  [[nodiscard]] virtual std::unique_ptr<Simulation> copy() const = 0;
  /// From now on nothing excites the loop: the hand holds where it is, tremor, sensor noise and blackouts are off. Delay,
  /// jitter and loss stay.
  virtual void be_quiet() = 0;
  /// Adds to the velocities of handle and robot [m/s], [rad/s].
  virtual Kicked kick(const Velocity<N>& master, const Velocity<N>& slave) = 0;

  [[nodiscard]] Duration end() const { return end_; }    ///< of the scene
  [[nodiscard]] virtual std::int64_t ticks() const = 0;  ///< done so far

  /// E(0) of the hand's port [J].
  [[nodiscard]] Energy initial_energy() const { return initial_energy_; }
  /// The most that a passive network can give the hand: E(0) of both sides, and what robot and environment hold at the start,
  /// in the master's joules [J].
  [[nodiscard]] Energy granted_energy() const { return granted_energy_; }
  /// Of a body that nobody drives: kinetic and elastic energy [J]. Nothing where there is a loop.
  [[nodiscard]] virtual std::optional<Energy> mechanical_energy() const { return std::nullopt; }
  /// When the operator's path ends [s].
  [[nodiscard]] double quiet_from_s() const { return path() != nullptr ? path()->end_s() : 0.0; }
  /// Times of the segments of the operator's path, in order.
  [[nodiscard]] std::vector<sim::SegmentTimes> segment_times() const {
    return path() != nullptr ? path()->segment_times() : std::vector<sim::SegmentTimes>{};
  }
  /// Nothing where the scene has no link.
  [[nodiscard]] virtual std::optional<LinkUse> link() const { return std::nullopt; }

 protected:
  Simulation(const Simulation&) = default;
  void grant(Energy initial, Energy granted) { initial_energy_ = initial, granted_energy_ = granted; }

 private:
  static constexpr std::uint64_t kEvery = 256;
  virtual std::uint64_t advance(Duration end, const Visit& visit) = 0;
  /// Of the operator; null: there is none.
  [[nodiscard]] virtual const sim::Path<sim::kPathSize<N>>* path() const { return nullptr; }

  Duration end_;
  Energy initial_energy_, granted_energy_;
  const std::atomic<bool>* stop_ = nullptr;
  std::uint64_t visited_ = 0;
};

/// The simulation that the scene needs: over a link, of a rendering, or of a robot alone. `taps`, which must outlive it, see every
/// tick of its nodes unless null.
template <int N>
std::unique_ptr<Simulation<N>> make_simulation(const Scene& scene, Taps<N>* taps = nullptr);

extern template std::unique_ptr<Simulation<1>> make_simulation<1>(const Scene&, Taps<1>*);
extern template std::unique_ptr<Simulation<3>> make_simulation<3>(const Scene&, Taps<3>*);
extern template std::unique_ptr<Simulation<6>> make_simulation<6>(const Scene&, Taps<6>*);
extern template std::unique_ptr<Simulation<kJointPort>> make_simulation<kJointPort>(const Scene&, Taps<kJointPort>*);

}  // namespace twoport::lab
