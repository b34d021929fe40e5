#include "common/secure/secure_socket.h"

#include <algorithm>
#include <chrono>
#include <exception>

#include "common/base/thread.h"

namespace twoport {
namespace {

using namespace std::chrono_literals;

// A client makes a new handshake when it has opened nothing for this long and a round trip.
constexpr Duration kDeaf = 250ms, kLongestTrip = 3s;
constexpr Duration kTellEvery = 5s;
constexpr Duration kPatience = 2ms;  // of the thread, between two looks at its rings

// A flood costs the thread a bounded part, and the tick a MAC a datagram: what finds a ring full is dropped. Neither what proves no key
// nor ClientHellos, which anybody can repeat from any address, stand in the way of the flights that follow.
constexpr std::size_t kUnproved = 4, kHellos = 32, kFlights = 128, kOutgoing = 64, kAssociations = 16;
constexpr int kOutgoingPerTick = 16;

}  // namespace

SecureSocket::SecureSocket(DatagramSocket& socket, const SecureSocketOptions& options, const Key& key)
    : socket_{&socket},
      options_{options},
      proof_{key},
      unproved_{kUnproved},
      hellos_{kHellos},
      flights_{kFlights},
      outgoing_{kOutgoing},
      arrived_{kAssociations},
      retired_{kAssociations},
      handshake_{{.server = options.server, .peer = options.peer}, key} {
  wanted_.store(!options.server, std::memory_order_relaxed);
  if (options.own_thread) thread_ = std::thread{[this] { run(); }};
}

SecureSocket::~SecureSocket() {
  done_.store(true, std::memory_order_relaxed);
  if (thread_.joinable()) thread_.join();
  for (Ring<Association*>* ring : {&arrived_, &retired_})
    for (Association* left = nullptr; ring->try_pop(left);) delete left;
}

// ---- the cycle

bool SecureSocket::send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept {
  const bool to_peer = association_ && association_->peer == to;
  const std::span<const std::byte> record = to_peer ? association_->sealer.seal(bytes) : std::span<const std::byte>{};
  if (record.empty()) {
    ++unsent_;
    return false;
  }
  return socket_->send(record, to, now);
}

std::optional<ReceivedDatagram> SecureSocket::receive(Duration now) noexcept {
  if (tick_ != now) begin_tick(now);
  while (const std::optional<ReceivedDatagram> datagram = socket_->receive(now)) {
    std::span<const std::byte> plain;
    if (!hand_over(*datagram) && open(*datagram, now, plain))
      return ReceivedDatagram{plain, datagram->from, datagram->arrived};
  }
  return std::nullopt;
}

void SecureSocket::begin_tick(Duration now) noexcept {
  tick_ = now;
  now_ns_.store(now.count(), std::memory_order_relaxed);
  if (!options_.server) wanted_.store(!association_ || now - opened_ >= deaf_after_, std::memory_order_relaxed);
  if (!options_.own_thread) work();
  for (int i = 0; i < kOutgoingPerTick && outgoing_.try_pop(passing_); ++i)
    if (!socket_->send(passing_.bytes(), passing_.from, now)) ++flights_unsent_;
  take_association(now);
}

void SecureSocket::take_association(Duration now) noexcept {
  Association* arrived = nullptr;
  while (arrived_.try_pop(arrived)) {
    if (association_) {
      Association* const old = association_.release();
      if (!retired_.try_push(old)) delete old;  // does not happen: the thread makes few, and empties the ring
    }
    association_.reset(arrived);
    opened_ = now;
    deaf_after_ = kDeaf + std::min(arrived->round_trip, kLongestTrip);
    wanted_.store(false, std::memory_order_relaxed);
    taken_.store(++associations_, std::memory_order_release);
  }
}

/// To the handshakes what is theirs. True when nothing is left to do.
bool SecureSocket::hand_over(const ReceivedDatagram& datagram) noexcept {
  if (datagram.bytes.size() > kMaxDatagramBytes) {
    ++rejected_.too_long;
    return true;
  }
  if (options_.peer && datagram.from != *options_.peer) {
    ++rejected_.foreign_address;
    return true;
  }
  if (!is_dtls(datagram.bytes)) {
    ++rejected_.not_encrypted;
    return true;
  }
  if (datagram.bytes[0] == static_cast<std::byte>(RecordType::application_data)) return false;
  passing_.assign(datagram.bytes, datagram.from);
  const std::optional<HandshakeParts> parts = read_handshake(datagram.bytes);
  Ring<Datagram>& ring = !parts || !proof_.holds(datagram.bytes) ? unproved_
                         : is_client_hello(parts->records)       ? hellos_
                                                                 : flights_;
  if (!ring.try_push(passing_)) ++rejected_.flood;
  return true;
}

bool SecureSocket::open(const ReceivedDatagram& datagram, Duration now, std::span<const std::byte>& plain) noexcept {
  if (!association_ || datagram.from != association_->peer) {
    ++rejected_.foreign_address;
    return false;
  }
  switch (association_->opener.open(datagram.bytes, plain)) {
    case Opened::ok:
      opened_ = now;
      return true;
    case Opened::malformed:
      ++rejected_.malformed;
      return false;
    case Opened::not_authentic:
      ++rejected_.not_authentic;
      return false;
    case Opened::replayed:
      ++rejected_.replayed;
      return false;
    case Opened::stale:
      ++rejected_.stale;
      return false;
  }
  return false;
}

void SecureSocket::paired(const Endpoint& peer, Duration since) noexcept {
  socket_->paired(peer, since);
}
const Endpoint& SecureSocket::local() const noexcept {
  return socket_->local();
}
SocketCounts SecureSocket::counts() const noexcept {
  SocketCounts counts = socket_->counts();
  counts.unsent += unsent_ - flights_unsent_;
  counts.rejected += rejected_;
  counts.rejected.failed_handshake += failed_.load(std::memory_order_relaxed);
  return counts;
}

// ---- the handshakes

void SecureSocket::work() {
  for (Association* old = nullptr; retired_.try_pop(old);) delete old;
  const Duration now{now_ns_.load(std::memory_order_relaxed)};
  while (flights_.try_pop(working_)) handshake_.on(working_.bytes(), working_.from, now);
  while (hellos_.try_pop(working_)) handshake_.on(working_.bytes(), working_.from, now);
  while (unproved_.try_pop(working_)) handshake_.on(working_.bytes(), working_.from, now);
  // Not while one is there that the cycle has not taken.
  const bool none_waits = !waiting_ && made_ == taken_.load(std::memory_order_acquire);
  handshake_.advance(now, none_waits && wanted_.load(std::memory_order_relaxed));
  // What finds no room waits.
  while (has_leaving_ || handshake_.take_outgoing(leaving_)) {
    has_leaving_ = !outgoing_.try_push(leaving_);
    if (has_leaving_) break;
  }
  while (waiting_ || (waiting_ = handshake_.take_association())) {
    agreed_with_ = waiting_->peer;
    if (!arrived_.try_push(waiting_.get())) break;
    static_cast<void>(waiting_.release());
    ++made_;
  }
  failure_.store(handshake_.last_failure(), std::memory_order_relaxed);
  failed_.store(handshake_.counts().refused, std::memory_order_relaxed);
  if (options_.tell) tell(now);
}

void SecureSocket::tell(Duration now) {
  if (made_ != told_agreed_) {
    told_agreed_ = made_;
    options_.tell(HandshakeFailure::none, agreed_with_);
  }
  const std::uint64_t failed = handshake_.counts().failed;
  if (failed == told_failed_ || handshake_.last_failure() == HandshakeFailure::none ||
      (failed_at_ && now - *failed_at_ < kTellEvery))
    return;
  told_failed_ = failed, failed_at_ = now;
  options_.tell(handshake_.last_failure(), handshake_.failed_peer());
}

void SecureSocket::run() {
  take_ordinary_priority();
  while (!done_.load(std::memory_order_relaxed)) {
    try {
      work();
    } catch (const std::exception&) {
      // No memory for one more attempt: its peer asks again.
    }
    std::this_thread::sleep_for(kPatience);
  }
}

}  // namespace twoport
