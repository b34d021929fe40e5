#pragma once

#include <cstddef>
#include <cstdint>

#include "common/base/time.h"
#include "common/base/vector.h"
#include "common/link/payload.h"

namespace twoport {

/// Mode of one side of a link. idle: ready, the other side has not confirmed; released: the other side is not heard. let_go: nobody holds
/// the handle; the other side is there. stopped: for as long as the programs run. ended: the program ends, no more reports will come.
enum class Mode : std::uint8_t { idle, coupled, holding, released, let_go, stopped, ended };
constexpr bool is_mode(std::uint32_t number) {
  return number <= static_cast<std::uint32_t>(Mode::ended);
}

constexpr const char* to_string(Mode mode) {
  constexpr const char* kNames[] = {"idle", "coupled", "holding", "released", "let_go", "stopped", "ended"};
  return kNames[static_cast<std::size_t>(mode)];
}

/// State of one side's port, in every packet, in both directions, with the energy that has entered the link there.
/// Energies are running totals since the session began: a lost, late, repeated or reordered report delays information
/// and can neither destroy nor create energy.
/// Times are in nanoseconds of the sender's clock; `echo_ns` is in the receiver's, which computes the round trip from it.
template <int N>
struct PortReport {
  std::uint64_t sequence = 0;
  std::int64_t sent_ns = 0;
  std::int64_t echo_ns =
      -1;  ///< stamp of the newest report received, plus the time it waited here, at most hold_after/2; -1: none yet
  Position<N> x{};
  Velocity<N> v{};
  Force<N> f{};                      ///< the returned force (slave), or the felt force (master)
  Force<N> f_coupling{};             ///< slave: the coupling force on the robot
  Force<N> f_environment{};          ///< slave: the force sensor's force, of the robot on the environment
  Displacement<N> position_error{};  ///< slave: robot against the delayed, registered master; null while not coupled
  double energy_in_j = 0.0;
  double energy_net_j = 0.0;  ///< E(0) and what has entered at the port, less energy_in_j: ENERGY_EXCHANGE
  Mode mode = Mode::idle;
  std::uint32_t epoch = 0;  ///< grows when the method is switched; energies and words are of one epoch

  [[nodiscard]] double sum() const noexcept {
    return x.sum() + (v.vec() + f.vec() + f_coupling.vec() + f_environment.vec() + position_error.vec()).sum() +
           energy_in_j + energy_net_j;
  }
  [[nodiscard]] bool finite() const noexcept { return all_finite(*this); }
};

/// A packet: a PortReport and the words of the method. Nodes pass a PortReport, which the compiler keeps in registers;
/// the words' array would force it into memory.
template <int N>
struct Report : PortReport<N> {
  Words words;

  Report() = default;
  Report(const PortReport<N>& r) noexcept : PortReport<N>{r} {}  // NOLINT(google-explicit-constructor)
  Report& operator=(const PortReport<N>& r) noexcept {
    PortReport<N>::operator=(r);
    words.clear();
    return *this;
  }

  [[nodiscard]] double sum() const noexcept { return PortReport<N>::sum() + words.sum(); }
  [[nodiscard]] bool finite() const noexcept { return all_finite(*this); }
};

}  // namespace twoport
