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

namespace twoport {

/// Draws the number of a session: live from the system's random generator, so that the next one cannot be predicted; in
/// virtual time from a seed.
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

/// Pairing of two programs and detection of restarts, in the headers of the cycle's packets: headers and times in,
/// actions and headers out. No I/O, no clock, no randomness of its own, no allocation.
///
/// Every process draws a session number when it starts. Each packet carries the sender's number and the number that the
/// sender assumes for its peer; until a peer has returned ours (and again after 100 ms of silence) packets also carry
/// our identity. A slave answers an introduction with the number of the coming session; it accepts the master
/// when the master returns this number, and the master accepts the slave that has returned its own. A replayed packet of
/// an older session therefore has no effect. A valid peer is accepted when the caller calls take_new_session();
/// only packets with both current numbers go to the node, so a report is never combined with totals of
/// another session.
///
/// A slave accepts the first master. While packets of that master arrive it ignores other addresses; a master
/// that restarts from a new port is accepted after 750 ms of silence of the old one, when the robot is almost released. A master
/// that keeps asking for a second meanwhile is told that the slave is busy.
///
/// Without a key a refusal names nothing of this side, and an introduction that does not fit ends nobody by itself, since
/// its source may be forged or its bits flipped on the way. What ends a side is the same refusal, with a number that only
/// a receiver of its packets has, five times and for 200 ms, with no packet of the peer that fits between them, and to a paired
/// side only after 750 ms of its peer's silence. The refused program then returns the number that came with the refusal,
/// and by the same rule the refusing one ends, with the difference it has found.
///
/// Where one of the two only measures the link (kMeasurementDigest) a difference ends the one that has called, and nobody else.
class Handshake {
 public:
  enum class Action : std::uint8_t {
    deliver,  ///< its report is for the node
    wait,     ///< of a valid peer that does not know this session yet
    reply,    ///< as wait; take_greeting() answers it with the next report
    pair,     ///< as wait; take_new_session() accepts its sender
    reject,   ///< drop it
    refuse,   ///< drop it, and send refusal() to its sender; also the answer to a refusal
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
  /// May packets of `from` be accepted? Check before decoding.
  [[nodiscard]] bool hears(const Endpoint& from) const noexcept { return !options_.peer || from == *options_.peer; }
  /// A packet that is not malformed.
  Action on(const Header& header, Decoded decoded, const Endpoint& from, Duration now) noexcept;

  // ---- out

  /// An answer that is due, once. Its report has the state but no energy: its session has not begun.
  std::optional<Greeting> take_greeting() noexcept;
  /// Of a packet to the peer.
  [[nodiscard]] Header header(Duration now) const noexcept;
  /// Of the refusal that on() asks for. Good until the next on().
  [[nodiscard]] Header refusal() const noexcept;

  // ---- state

  /// True once for every session of the other side, the first included.
  bool take_new_session() noexcept;
  /// Reason why the two programs cannot work together, or empty. The side that detects it informs the other side for
  /// half a second before it is returned here.
  [[nodiscard]] std::string_view reject_reason() const noexcept;
  /// The other side has accepted this session, and returned its number within the last 100 ms.
  [[nodiscard]] bool coupled(Duration now) const noexcept;
  /// When the first peer was found.
  [[nodiscard]] std::optional<Duration> first_paired() const noexcept { return first_paired_; }
  /// When the peer of the present session was found.
  [[nodiscard]] Duration paired_since() const noexcept { return paired_since_; }
  /// A time before which no report of the present session was made: a slave's offer of its number, a master's pairing, which the
  /// slave has heard of before it reports.
  [[nodiscard]] Duration session_since() const noexcept { return session_since_; }
  /// Number of sessions so far; reconnects are one less.
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
  /// A refusal, or a reason for one, that repeats itself.
  struct Objection {
    Sentence text{};
    Duration since{0};
    int times = 0;
    bool found_here = false;  ///< the peer does not fit; else the peer says that this side does not
  };
  /// A valid unpaired peer.
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
  [[nodiscard]] bool is_confirmed(const Header& header, const Endpoint& from, Duration now) noexcept;
  Action on_unpaired_peer(const Header& header, Duration now) noexcept;
  Action refuse(const Header& header, const Sentence& why, Duration now) noexcept;
  bool persists(std::string_view text, bool found_here, Duration now) noexcept;
  [[nodiscard]] Sentence busy() const noexcept;
  [[nodiscard]] bool knows_us(const Header& header) const noexcept;

  SessionOptions options_;
  int dof_;
  SessionNumbers numbers_;
  std::uint64_t session_;
  /// Our numbers for the next session: a peer that returns one is present. A slave offers the newest; a master has one
  /// for all.
  LastSessions offers_;
  std::optional<Duration> offered_at_;  ///< the newest, first told
  std::uint64_t refusing_session_;      ///< in refusals in place of one of ours
  std::uint64_t peer_session_ = 0;
  std::optional<Endpoint> peer_;
  std::optional<Invitation> greeting_;
  std::optional<Candidate> candidate_;  ///< valid, waits for take_new_session()
  LastSessions closed_;                 ///< of the other side: a late packet must not reopen them
  std::optional<Duration> heard_;       ///< the current peer
  std::optional<Duration> returned_;    ///< our session number by the current peer
  std::optional<Duration> first_paired_;
  Duration paired_since_{0}, session_since_{0};
  std::uint64_t pairings_ = 0;
  std::uint64_t unconfirmed_ = 0;  ///< last number that has come once from the peer's address

  Objection objection_;  ///< of the peer that this side would take
  Sentence difference_;  ///< found here, in an introduction whose source may be forged
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
