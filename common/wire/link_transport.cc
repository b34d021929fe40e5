#include "common/wire/link_transport.h"

#include <algorithm>
#include <utility>

#include "common/base/built_for.h"

namespace twoport {
namespace {

/// Of a greeting's stamp, as of a report's.
constexpr Duration kLongestWait = std::chrono::milliseconds{50};

/// Does a datagram begin like a record of DTLS?
bool is_encrypted(std::span<const std::byte> bytes) noexcept {
  return bytes.size() > 1 && bytes[0] >= std::byte{20} && bytes[0] <= std::byte{23} && bytes[1] == std::byte{0xfe};
}

/// Is it of a slave that has heard nothing in this session? It answers introductions, not every tick: gaps between its greetings are no
/// losses.
template <int N>
bool may_be_greeting(const Envelope<N>& from) noexcept {
  return from.identity && from.identity->side == Side::slave && from.report.echo_ns < 0;
}

}  // namespace

template <int N>
LinkTransport<N>::LinkTransport(DatagramSocket& socket, const SessionOptions& options, SessionNumbers numbers)
    : socket_{&socket}, handshake_{options, N, std::move(numbers)} {}

template <int N>
LinkTransport<N>::LinkTransport(DatagramSocket& socket, const SessionOptions& options, SessionNumbers numbers,
                                const PairedSession& session)
    : socket_{&socket}, handshake_{options, N, std::move(numbers), session}, is_greeted_{false} {
  socket.paired(session.peer, handshake_.paired_since());
}

template <int N>
const Report<N>* LinkTransport<N>::next(Duration now, int& left) noexcept {
  using Action = Handshake::Action;
  while (handshake_.listens() && left-- > 0) {
    const std::optional<ReceivedDatagram> datagram = socket_->receive(now);
    if (!datagram) return nullptr;
    if (!handshake_.hears(datagram->from)) {
      ++counts_.rejected.foreign_address;
      continue;
    }
    const Decoded decoded = codec_.decode(datagram->bytes, incoming_);
    if (decoded == Decoded::malformed) {
      ++(is_encrypted(datagram->bytes) ? counts_.rejected.encrypted : counts_.rejected.malformed);
      continue;
    }
    switch (handshake_.on(incoming_, decoded, datagram->from, now)) {
      case Action::deliver:
        if (!is_greeted_ || !may_be_greeting(incoming_)) return &incoming_.report;
        note_greeting(now);
        ++counts_.handshake;
        break;
      case Action::pair:
        note_greeting(now);
        [[fallthrough]];
      case Action::wait:
      case Action::reply:
        ++counts_.handshake;
        break;
      case Action::refuse:
        static_cast<Header&>(outgoing_) = handshake_.refusal();
        if (!socket_->send(codec_.encode(outgoing_), datagram->from, now)) ++answers_unsent_;
        ++counts_.rejected.refused;
        break;
      case Action::reject:
        ++counts_.rejected.other_session;
        break;
      case Action::end:
        break;
    }
  }
  return nullptr;
}

template <int N>
void LinkTransport<N>::note_greeting(Duration now) noexcept {
  if (!may_be_greeting(incoming_)) return;
  greeting_sent_ns_ = incoming_.report.sent_ns;
  greeting_at_ = now;
}

template <int N>
void LinkTransport<N>::send(const Report<N>& report, Duration now) noexcept {
  outgoing_.report = report;
  if (report.echo_ns < 0 && greeting_sent_ns_ >= 0) [[unlikely]]
    outgoing_.report.echo_ns = greeting_sent_ns_ + std::min(now - greeting_at_, kLongestWait).count();
  if (!carries_gripper_) [[likely]]
    transmit(now);
}

template <int N>
void LinkTransport<N>::say_goodbye(Duration now) noexcept {
  ++outgoing_.report.sequence;
  outgoing_.report.sent_ns = now.count();
  outgoing_.report.mode = outgoing_.gripper.mode = Mode::ended;
  transmit(now);
}

template <int N>
void LinkTransport<N>::send_gripper(const Report<1>& gripper, Duration now) noexcept {
  outgoing_.has_gripper = gripper.finite();
  outgoing_.gripper = gripper;
  transmit(now);
}

template <int N>
void LinkTransport<N>::transmit(Duration now) noexcept {
  if (!handshake_.reject_reason().empty()) return;
  if (const std::optional<Handshake::Greeting> greeting = handshake_.take_greeting()) {
    Report<N>& report = outgoing_.report;
    const double energy_in_j = std::exchange(report.energy_in_j, 0.0);
    const double gripper_energy_in_j = std::exchange(outgoing_.gripper.energy_in_j, 0.0);
    const std::int64_t echo_ns = std::exchange(report.echo_ns, -1);
    // A greeting is of no session yet; the environment's numbers count within one.
    const EnvironmentMessage environment = std::exchange(outgoing_.environment, {});
    static_cast<Header&>(outgoing_) = greeting->header;
    if (!socket_->send(codec_.encode(outgoing_), greeting->to, now)) ++answers_unsent_;
    report.energy_in_j = energy_in_j, report.echo_ns = echo_ns;
    outgoing_.gripper.energy_in_j = gripper_energy_in_j;
    outgoing_.environment = environment;
  }
  if (!handshake_.peer()) {
    ++counts_.unaddressed;
    return;
  }
  static_cast<Header&>(outgoing_) = handshake_.header(now);
  socket_->send(codec_.encode(outgoing_), *handshake_.peer(), now);
}

template <int N>
bool LinkTransport<N>::take_new_session() noexcept {
  if (!handshake_.take_new_session()) return false;
  socket_->paired(*handshake_.peer(), handshake_.paired_since());
  heard_ = outgoing_.environment = {};
  return true;
}

template <int N>
LinkCounts LinkTransport<N>::counts() const noexcept {
  const SocketCounts below = socket_->counts();
  LinkCounts counts = counts_;
  counts.rejected += below.rejected;
  counts.lost += below.lost;
  counts.overflowed += below.overflowed;
  counts.unsent += below.unsent - answers_unsent_;
  return counts;
}

TWOPORT_COMPILE(LinkTransport);

}  // namespace twoport
