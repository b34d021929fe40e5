#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string_view>

#include "common/base/time.h"
#include "common/link/endpoint.h"
#include "common/wire/header.h"
#include "common/wire/mismatch.h"
#include "common/wire/sentence.h"

namespace twoport {

/// Draws the number of a session. Live, every number comes from the system's generator, so that nobody can compute the
/// next one; in virtual time, from a seed.
using SessionNumbers = std::function<std::uint64_t()>;

/// A session that exists already, in a test.
struct PairedSession {
  Endpoint peer;
  std::uint64_t session = 0, peer_session = 0;
};

/// The last few numbers of sessions of one kind.
class LastSessions {
 public:
  void add(std::uint64_t session) noexcept {
    next_ = (next_ + 1) % sessions_.size();
    sessions_[next_] = session;
  }
  [[nodiscard]] bool has(std::uint64_t session) const noexcept {
    return session != 0 && std::find(sessions_.begin(), sessions_.end(), session) != sessions_.end();
  }
  [[nodiscard]] std::uint64_t newest() const noexcept { return sessions_[next_]; }

 private:
  std::array<std::uint64_t, 16> sessions_{};
  std::size_t next_ = 0;
};

/// How two programs find each other and notice that one of them has started again. It rides on the packets of the cycle:
/// headers and times in, actions and headers out. No I/O, no clock, no randomness of its own, no allocation.
///
/// Every process draws a session number when it starts. Each packet carries its sender's, and the one it believes it
/// talks to; until a peer has returned ours (and again when it has been silent for 100 ms) packets also say who we
/// are. A slave answers an introduction with the number that it will have in the session to come; it takes the master
/// up when that returns the number, and the master the slave that has returned its own. So a packet of an older session
/// that somebody has kept starts nothing. A good peer is taken up as soon as the caller has called take_new_session();
/// only packets that carry both numbers as they now are go to the node. So a report is never read against totals of
/// another session.
///
/// A slave answers whoever is there first. While that master is heard it has no ear for another address; a master
/// that starts again from a new port is taken up when the old one has been silent for 100 ms. One that keeps asking
/// for a second meanwhile is told that the slave is taken.
class Handshake {
 public:
  enum class Action : std::uint8_t {
    deliver,  ///< its report is for the node
    wait,     ///< of a good peer that does not know this session yet
    reply,    ///< as wait; take_greeting() answers it with the next report
    pair,     ///< as wait; its sender is taken up by take_new_session()
    reject,   ///< drop it
    refuse,   ///< drop it, and send refusal() to its sender
    end,      ///< the peer refuses this side: reject_reason() says why
  };
  struct Greeting {
    Endpoint to;
    Header header;
  };

  /// `dof` of this side.
  Handshake(const SessionOptions& options, int dof, SessionNumbers numbers);
  /// In the midst of a session: paired, and the peer's first packet is still to come.
  Handshake(const SessionOptions& options, int dof, SessionNumbers numbers, const PairedSession& session);

  // ---- in

  /// Time goes on. Call before on().
  void advance(Duration now) noexcept;
  /// May a packet be handed in? Not between the packet that pairs and take_new_session(), and not after the end.
  [[nodiscard]] bool listens() const noexcept { return !candidate_ && !ended_; }
  /// May `from` be listened to at all? Ask before the packet is decoded.
  [[nodiscard]] bool hears(const Endpoint& from) const noexcept { return !options_.peer || from == *options_.peer; }
  /// A packet that is not malformed.
  Action on(const Header& header, Decoded decoded, const Endpoint& from, Duration now) noexcept;

  // ---- out

  /// An answer that is due, once. A report that goes with it says the state, and no energy: its session has not begun.
  std::optional<Greeting> take_greeting() noexcept;
  /// Of a packet to the peer.
  [[nodiscard]] Header header(Duration now) const noexcept;
  /// Of the refusal that on() asks for. Good until the next on().
  [[nodiscard]] Header refusal() const noexcept;

  // ---- state

  /// True once for every session of the other side, the first included.
  bool take_new_session() noexcept;
  /// Why the two programs cannot work together. Empty: they can, as far as is known. The side that finds out goes on for
  /// half a second to tell the other, and says so here only then.
  [[nodiscard]] std::string_view reject_reason() const noexcept;
  /// The other side has taken this session up, and returned its number within the last 100 ms.
  [[nodiscard]] bool coupled(Duration now) const noexcept;
  /// When the first peer was found.
  [[nodiscard]] std::optional<Duration> first_paired() const noexcept { return first_paired_; }
  /// When the peer of the present session was found.
  [[nodiscard]] Duration paired_since() const noexcept { return paired_since_; }
  /// Sessions of the other side so far: reconnects are one less.
  [[nodiscard]] std::uint64_t pairings() const noexcept { return pairings_; }
  [[nodiscard]] const std::optional<Endpoint>& peer() const noexcept { return peer_; }

 private:
  struct Candidate {
    Endpoint from;
    std::uint64_t session, offer;
    Duration since;
  };
  struct Invitation {
    Endpoint to;
    std::uint64_t session;
  };
  /// An unpaired peer that would do.
  struct Waiting {
    std::uint64_t session = 0;
    Duration since{0};
  };

  [[nodiscard]] std::uint64_t draw() const noexcept;
  [[nodiscard]] Identity identity() const noexcept;
  void begin(const Candidate& candidate) noexcept;
  Action on_refusal(const Header& header, const Endpoint& from, Duration now) noexcept;
  Action on_current(const Header& header, Decoded decoded, const Endpoint& from, Duration now) noexcept;
  Action on_unknown(const Header& header, Decoded decoded, const Endpoint& from, Duration now) noexcept;
  Action answer(const Header& header, const Endpoint& from, Duration now) noexcept;
  Action on_unpaired_peer(const Header& header, Duration now) noexcept;
  Action refuse(const Header& header, const Sentence& why, Duration now) noexcept;

  SessionOptions options_;
  int dof_;
  SessionNumbers numbers_;
  std::uint64_t session_;
  /// Our numbers for the next session: who returns one is there now. A slave says the newest; a master has one for all.
  LastSessions offers_;
  Duration offered_at_{0};          ///< the newest
  std::uint64_t refusing_session_;  ///< in refusals in place of one of ours
  std::uint64_t peer_session_ = 0;
  std::optional<Endpoint> peer_;
  std::optional<Invitation> greeting_;
  std::optional<Candidate> candidate_;  ///< good, and waits for take_new_session()
  LastSessions closed_;                 ///< of the other side: a late packet of theirs must not bring them back
  std::optional<Duration> heard_;       ///< the current peer
  std::optional<Duration> returned_;    ///< our session number by the current peer
  std::optional<Duration> first_paired_;
  Duration paired_since_{0};
  std::uint64_t pairings_ = 0;

  Sentence reject_reason_;
  std::optional<Duration> mismatch_found_;
  bool ended_ = false;
  Sentence refusal_;
  std::uint64_t refused_session_ = 0;
  std::optional<Duration> refused_at_;
  std::array<Waiting, 4> waiting_{};
  std::size_t next_waiting_ = 0;
};

}  // namespace twoport
