#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "common/base/built_for.h"
#include "common/base/time.h"
#include "common/link/report.h"
#include "common/link/socket.h"
#include "common/wire/codec.h"
#include "common/wire/handshake.h"

namespace twoport {

/// Datagrams that were not reports for the node.
struct LinkCounts {
  std::uint64_t handshake = 0;  ///< of a valid peer that does not know this session yet
  Rejected rejected{};
  std::uint64_t lost = 0;         ///< dropped by the impairment
  std::uint64_t overflowed = 0;   ///< dropped because the delay line was full
  std::uint64_t unaddressed = 0;  ///< reports of a slave without a master
  std::uint64_t unsent = 0;       ///< reports that could not be handed to the network
};

/// The transport for Mailbox: a Handshake over a Codec over a socket, which may be a stack of filters
/// (DatagramSocket).
///
/// All moments are durations since the loop began and must not decrease. One thread.
/// Real time: poll and send allocate nothing, lock nothing, throw nothing.
template <int N>
class LinkTransport {
 public:
  /// `socket` must outlive this.
  LinkTransport(DatagramSocket& socket, const SessionOptions& options, SessionNumbers numbers);
  /// With an existing session, for tests without a handshake.
  LinkTransport(DatagramSocket& socket, const SessionOptions& options, SessionNumbers numbers,
                const PairedSession& session);

  /// Calls f(const Report<N>&) for each report that has arrived.
  template <class F>
  void poll(Duration now, F&& f) noexcept {
    handshake_.advance(now);
    for (int left = kMaxPerPoll; const Report<N>* report = next(now, left);) {
      f(*report);
      if (incoming_.has_gripper && gripper_reports_.size() < gripper_reports_.capacity()) [[unlikely]]
        gripper_reports_.push_back(incoming_.gripper);
      if (incoming_.environment.number >= heard_.number && incoming_.environment.number > 0) [[unlikely]]
        heard_ = incoming_.environment;
    }
  }

  /// A slave without a master sends nothing.
  void send(const Report<N>& report, Duration now) noexcept;

  /// The last report once more, with mode ended: this side ends.
  void say_goodbye(Duration now) noexcept;

  /// From now on a packet also carries a report of the gripper: what send() is given leaves with send_gripper(), in the same tick.
  void carry_gripper() {
    carries_gripper_ = true;
    gripper_reports_.reserve(kMaxPerPoll);
  }
  /// Calls f(const Report<1>&) for each report of the gripper that has come with the reports of the last poll().
  template <class F>
  void poll_gripper(F&& f) noexcept {
    for (const Report<1>& report : gripper_reports_) f(report);
    gripper_reports_.clear();
  }
  /// Sends the report of the last send() together with this one; without it where a number is not finite.
  void send_gripper(const Report<1>& gripper, Duration now) noexcept;

  /// What packets say of the environment from now on, until a new session begins; number 0: nothing.
  void say_environment(const EnvironmentMessage& message) noexcept { outgoing_.environment = message; }
  /// What the other side has said last in this session; older numbers are ignored.
  [[nodiscard]] const EnvironmentMessage& heard_environment() const noexcept { return heard_; }

  /// Call before every cycle. True once for each new session, the first included: running totals start from zero, so
  /// reset the mailbox and call on_peer_restart of the node. No report is delivered before that.
  [[nodiscard]] bool take_new_session() noexcept;

  /// Reason why the two programs cannot work together, the same sentence on both sides, or empty. If not empty, end the
  /// program.
  [[nodiscard]] std::string_view reject_reason() const noexcept { return handshake_.reject_reason(); }

  /// The other side has accepted this session, and returned its number within the last 100 ms.
  [[nodiscard]] bool coupled(Duration now) const noexcept { return handshake_.coupled(now); }
  /// Number of sessions so far; reconnects are one less.
  [[nodiscard]] std::uint64_t pairings() const noexcept { return handshake_.pairings(); }
  [[nodiscard]] const Handshake& handshake() const noexcept { return handshake_; }
  [[nodiscard]] LinkCounts counts() const noexcept;

 private:
  static constexpr int kMaxPerPoll = 1024;  ///< datagrams read in one poll: the work of a tick is bounded

  const Report<N>* next(Duration now, int& left) noexcept;
  /// Until it has heard a report a master sends back the stamps of greetings: a slave's greeting is of this session too.
  void note_greeting(Duration now) noexcept;
  void transmit(Duration now) noexcept;

  DatagramSocket* socket_;
  Handshake handshake_;
  Codec<N> codec_;
  Envelope<N> incoming_, outgoing_;
  bool is_greeted_ = true;              ///< not where the session exists already
  std::int64_t greeting_sent_ns_ = -1;  ///< stamp of the newest greeting of a slave
  Duration greeting_at_{0};
  bool carries_gripper_ = false;
  std::vector<Report<1>> gripper_reports_;  ///< not collected yet
  EnvironmentMessage heard_;
  LinkCounts counts_;
  std::uint64_t answers_unsent_ = 0;  ///< greetings and refusals
};

TWOPORT_DECLARE(LinkTransport);

/// The transport for the gripper's Mailbox: its reports travel in the packets of the main coupling's LinkTransport, with the same
/// numbers and stamps. In every tick collect and post the main coupling's mail first.
template <int N>
class GripperTransport {
 public:
  /// `link` must outlive this.
  explicit GripperTransport(LinkTransport<N>& link) : link_{&link} { link.carry_gripper(); }

  template <class F>
  void poll(Duration, F&& f) noexcept {
    link_->poll_gripper(f);
  }
  void send(const Report<1>& report, Duration now) noexcept { link_->send_gripper(report, now); }
  /// The session is the main coupling's; call when that begins.
  [[nodiscard]] static bool take_new_session() noexcept { return true; }

 private:
  LinkTransport<N>* link_;
};

}  // namespace twoport
