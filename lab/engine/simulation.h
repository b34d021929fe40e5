#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

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
  std::optional<ClockFigures> clock{};  ///< the master's estimate of the slave's clock, where that differs
};

/// Which sides a kick has moved: not one that the hand leads or that is ideal.
struct Kicked {
  bool master, slave;
};

template <int N>
struct Taps;

/// A scene in virtual time. The tick itself is compiled once for each size and kind of scene (lab/engine); through this
/// interface a run is started, not a tick.
template <int N>
class Simulation {
 public:
  virtual ~Simulation() = default;

  using Visit = std::function<bool(const Row<N>&)>;
  /// Goes on until the time `end`, or until visit(row) returns false. Returns the number of ticks.
  virtual std::uint64_t run_until(Duration end, const Visit& visit) = 0;
  /// The same to the end of the scene.
  std::uint64_t run(const Visit& visit) { return run_until(end(), visit); }
  /// From the start to the end of the scene with nobody looking on.
  virtual std::uint64_t run_silently() {
    return run([](const Row<N>&) { return true; });
  }

  /// Another one in the same state: both go on identically, and neither touches the other.
  [[nodiscard]] virtual std::unique_ptr<Simulation> copy() const = 0;
  /// From now on nothing excites the loop: the hand holds where it is, tremor, sensor noise and blackouts are off. Delay,
  /// jitter and loss stay.
  virtual void be_quiet() = 0;
  /// Adds to the velocities of handle and robot [m/s], [rad/s].
  virtual Kicked kick(const Velocity<N>& master, const Velocity<N>& slave) = 0;

  [[nodiscard]] virtual Duration end() const = 0;        ///< of the scene
  [[nodiscard]] virtual std::int64_t ticks() const = 0;  ///< done so far

  /// E(0) of the hand's port [J].
  [[nodiscard]] virtual Energy initial_energy() const = 0;
  /// The most that a passive network can give the hand: E(0) of both sides, and what robot and environment hold at the start,
  /// in the master's joules [J].
  [[nodiscard]] virtual Energy granted_energy() const = 0;
  /// Of a body that nobody drives: kinetic and elastic energy [J]. Nothing where there is a loop.
  [[nodiscard]] virtual std::optional<Energy> mechanical_energy() const = 0;
  /// When the operator's path ends [s].
  [[nodiscard]] virtual double quiet_from_s() const = 0;
  /// Times of the segments of the operator's path, in order.
  [[nodiscard]] virtual std::vector<sim::SegmentTimes> segment_times() const = 0;
  /// Nothing where the scene has no link.
  [[nodiscard]] virtual std::optional<LinkUse> link() const = 0;
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
