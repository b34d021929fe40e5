#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "common/link/mailbox.h"
#include "common/record/row.h"
#include "common/scene/scene.h"

namespace twoport::lab {

/// What happened to the packets of a run over a link.
struct LinkUse {
  PacketCounts master, slave;    ///< as each side has counted them
  std::uint64_t overflowed = 0;  ///< found the delay line full
};

/// A scene in virtual time. The tick itself is compiled once for each size and kind of scene (lab/engine); through this
/// interface a run is started, not a tick.
template <int N>
class Simulation {
 public:
  virtual ~Simulation() = default;

  using Visit = std::function<bool(const Row<N>&)>;
  /// Runs to the end, or until visit(row) returns false. Returns the number of ticks. Once for each simulation.
  virtual std::uint64_t run(const Visit& visit) = 0;
  /// The same, with nobody looking on.
  virtual std::uint64_t run_silently() = 0;

  /// E(0): what the scene grants, and what environment and robot hold at the start [J].
  [[nodiscard]] virtual Energy initial_energy() const = 0;
  /// When the operator's path ends [s].
  [[nodiscard]] virtual double quiet_from_s() const = 0;
  /// Nothing where the scene has no link.
  [[nodiscard]] virtual std::optional<LinkUse> link() const = 0;
};

/// The simulation that the scene needs: over a link, of a rendering, or of a robot alone.
template <int N>
std::unique_ptr<Simulation<N>> make_simulation(const Scene& scene);

extern template std::unique_ptr<Simulation<1>> make_simulation<1>(const Scene&);
extern template std::unique_ptr<Simulation<3>> make_simulation<3>(const Scene&);
extern template std::unique_ptr<Simulation<6>> make_simulation<6>(const Scene&);

}  // namespace twoport::lab
