#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>

#include "common/base/time.h"
#include "common/link/impairment.h"
#include "common/link/report.h"
#include "common/platform/udp.h"
#include "common/wire/codec.h"

namespace twoport {

struct SessionOptions {
  Side side = Side::master;
  double rate_hz = 1000.0;       ///< of this side
  double peer_rate_hz = 1000.0;  ///< that the scene gives the other side
  std::uint64_t scene_digest = 0;
  ImpairmentOptions incoming;         ///< what the network does to packets on their way here
  std::uint64_t impairment_seed = 1;  ///< from the scene's seed and the direction
};

/// Datagrams that were not reports for the node.
struct LinkCounts {
  std::uint64_t handshake = 0;    ///< of a good peer that does not know this session yet
  std::uint64_t rejected = 0;     ///< did not parse, of another session, of somebody else
  std::uint64_t lost = 0;         ///< taken away by the impairment
  std::uint64_t overflowed = 0;   ///< found the delay line full
  std::uint64_t unaddressed = 0;  ///< reports of a slave that knows no master yet
  std::uint64_t unsent = 0;       ///< could not be handed to the socket
};

/// The datagrams of one side of a live link, as Mailbox wants its transport: socket, codec, the impairment of the
/// incoming direction, and a handshake that rides on the packets of the cycle.
///
/// Every process draws a session number when it starts. Each packet carries its sender's, and the one it believes it
/// talks to; until a peer has returned ours (and again when it has been silent for 100 ms) packets also say who we
/// are. A slave answers an introduction with the number that it will have in the session to come; it takes the master
/// up when that returns the number, and the master the slave that has returned its own. So a packet of an older session
/// that somebody has kept starts nothing. A good peer is taken up as soon as the caller has called `paired_anew`; only
/// packets that carry both numbers as they now are go to the node. So a report is never read against totals of another
/// session.
///
/// A slave answers whoever is there first. While that master is heard it has no ear for another address; a master
/// that starts again from a new port is taken up when the old one has been silent for 100 ms. One that keeps asking
/// for a second meanwhile is told that the slave is taken.
///
/// All moments are durations since the loop began and must not decrease. One thread.
/// Real time: poll and send allocate nothing (but see Codec::decode), lock nothing, throw nothing.
template <int N>
class UdpTransport {
 public:
  /// A master is given the address of its slave; a slave learns that of its master. Throws ConfigError for an address
  /// that is nobody's.
  UdpTransport(const SessionOptions& options, UdpSocket socket, std::optional<Endpoint> peer = std::nullopt);
  ~UdpTransport();
  UdpTransport(UdpTransport&&) noexcept;
  UdpTransport& operator=(UdpTransport&&) noexcept;

  /// Calls f(const Report<N>&) for each report that has arrived and is due.
  template <class F>
  void poll(Duration now, F&& f) noexcept {
    receive(now);
    while (const Report<N>* report = next(now)) f(*report);
  }

  /// Nothing is sent while a slave knows no master.
  void send(const Report<N>& report, Duration now) noexcept;

  /// Ask before every cycle. True once for every session of the other side, the first included: running totals start
  /// again from zero, so forget what the mailbox knows and rebase the node. Nothing is delivered before that.
  [[nodiscard]] bool paired_anew() noexcept;

  /// Why the two programs cannot work together: a sentence that is the same on both sides. Empty: they can, as far as
  /// is known. The side that finds out goes on for half a second to tell the other, and says so here only then; end
  /// the program when this is not empty.
  [[nodiscard]] std::string_view refusal() const noexcept;

  /// The other side has taken this session up, and returned its number within the last 100 ms.
  [[nodiscard]] bool coupled(Duration now) const noexcept;
  /// When the first peer was found; from here on blackouts count.
  [[nodiscard]] std::optional<Duration> first_paired() const noexcept;
  /// Sessions of the other side so far: reconnects are one less.
  [[nodiscard]] std::uint64_t pairings() const noexcept;
  [[nodiscard]] std::optional<Endpoint> peer() const noexcept;
  [[nodiscard]] const Endpoint& local() const noexcept;
  [[nodiscard]] LinkCounts counts() const noexcept;

 private:
  void receive(Duration now) noexcept;
  const Report<N>* next(Duration now) noexcept;

  struct Impl;
  std::unique_ptr<Impl> impl_;
};

extern template class UdpTransport<1>;
extern template class UdpTransport<3>;
extern template class UdpTransport<6>;

}  // namespace twoport
