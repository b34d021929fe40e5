#include "common/secure/secure_socket.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <utility>

#include "common/base/thread.h"

namespace twoport {
namespace {

using namespace std::chrono_literals;

// A client makes a new handshake when it has opened nothing for this long and a round trip.
constexpr Duration kDeaf = 250ms, kLongestTrip = 3s;
constexpr Duration kOverlap = 5s;  // in which records of the keys of before are opened: longer than any is on its way
constexpr Duration kKeysLast = 30min;  // where no others can be agreed on
constexpr Duration kGone = 1s;         // of silence, after which a peer's address may be that of another key
constexpr std::size_t kMostHeld = 8;
constexpr Duration kTellEvery = 5s;
constexpr Duration kPatience = 2ms;  // of the thread, between two looks at its rings

// A flood costs the thread a bounded part, and the tick a MAC a datagram: what finds a ring full is dropped. Neither what proves no key
// nor ClientHellos, which anybody can repeat from any address, stand in the way of the flights that follow.
constexpr std::size_t kUnproved = 4, kHellos = 32, kFlights = 128, kOutgoing = 64, kAssociations = 16;
constexpr int kOutgoingPerTick = 16;

}  // namespace

SecureSocket::SecureSocket(DatagramSocket& socket, const SecureSocketOptions& options, std::span<const Key> keys)
    : socket_{&socket},
      options_{options},
      proof_{keys},
      unproved_{kUnproved},
      hellos_{kHellos},
      flights_{kFlights},
      outgoing_{kOutgoing},
      arrived_{kAssociations},
      retired_{kAssociations},
      handshake_{{.server = options.server, .peer = options.peer}, keys} {
  held_.reserve(kMostHeld);
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
  Held* const held = newest_shared(to);
  const std::span<const std::byte> record =
      held != nullptr ? held->association->sealer.seal(bytes) : std::span<const std::byte>{};
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
  if (!options_.own_thread) work();
  for (int i = 0; i < kOutgoingPerTick && outgoing_.try_pop(passing_); ++i)
    if (!socket_->send(passing_.bytes(), passing_.from, now)) ++flights_unsent_;
  take_associations(now);
  for (std::size_t i = held_.size(); i-- > 0;)
    if (now >= held_[i].ends) [[unlikely]]
      forget(i);
  if (options_.server) return;
  const Held* const held = held_.empty() ? nullptr : &held_.back();
  wanted_.store(held == nullptr || now - held->since >= options_.rekey_after ||
                    now - held->opened >= kDeaf + std::min(held->association->round_trip, kLongestTrip),
                std::memory_order_relaxed);
}

void SecureSocket::take_associations(Duration now) noexcept {
  for (Association* arrived = nullptr; arrived_.try_pop(arrived);) {
    hold(arrived, now);
    wanted_.store(false, std::memory_order_relaxed);
    taken_.store(++associations_, std::memory_order_release);
  }
}

void SecureSocket::hold(Association* arrived, Duration now) noexcept {
  bool known = false;
  for (std::size_t i = held_.size(); i-- > 0;) {
    const Held& held = held_[i];
    if (held.association->peer != arrived->peer) continue;
    if (held.association->key == arrived->key) {
      known = true;
    } else if (now - held.opened < kGone) {
      return retire(arrived);
    } else {
      forget(i);
    }
  }
  if (held_.size() == kMostHeld) {
    std::size_t least = 0;
    const auto is_paired = [&](const Held& held) { return held.association->peer == paired_; };
    for (std::size_t i = 1; i < held_.size(); ++i)
      if (std::pair{is_paired(held_[i]), held_[i].opened} < std::pair{is_paired(held_[least]), held_[least].opened})
        least = i;
    forget(least);
  }
  held_.push_back({std::unique_ptr<Association>{arrived}, now, now, now + kKeysLast});
  if (!options_.server || !known) share(held_.size() - 1, now);
}

/// The peer has it: it seals from now on, and those of before end.
void SecureSocket::share(std::size_t which, Duration now) noexcept {
  held_[which].is_shared = true;
  for (std::size_t i = 0; i < which; ++i)
    if (held_[i].association->peer == held_[which].association->peer)
      held_[i].ends = std::min(held_[i].ends, now + kOverlap);
}

void SecureSocket::forget(std::size_t which) noexcept {
  retire(held_[which].association.release());
  held_.erase(held_.begin() + static_cast<std::ptrdiff_t>(which));
}

/// The thread wipes it.
void SecureSocket::retire(Association* association) noexcept {
  if (!retired_.try_push(association))
    delete association;  // does not happen: the thread makes few, and empties the ring
}

SecureSocket::Held* SecureSocket::newest_shared(const Endpoint& peer) noexcept {
  const auto at = std::find_if(held_.rbegin(), held_.rend(),
                               [&](const Held& h) { return h.is_shared && h.association->peer == peer; });
  return at == held_.rend() ? nullptr : &*at;
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
  Ring<Datagram>& ring = !parts || !proof_.key_of(datagram.bytes) ? unproved_
                         : is_client_hello(parts->records)        ? hellos_
                                                                  : flights_;
  if (!ring.try_push(passing_)) ++rejected_.flood;
  return true;
}

bool SecureSocket::open(const ReceivedDatagram& datagram, Duration now, std::span<const std::byte>& plain) noexcept {
  bool known = false;
  Opened result = Opened::not_authentic;
  for (std::size_t i = held_.size(); i-- > 0;) {  // numbers of records say nothing across associations: each is asked
    Held& held = held_[i];
    if (held.association->peer != datagram.from) continue;
    known = true;
    const Opened opened = held.association->opener.open(datagram.bytes, plain);
    if (opened == Opened::ok) {
      held.opened = now;
      if (!held.is_shared) [[unlikely]]
        share(i, now);
      return true;
    }
    if (result == Opened::not_authentic) result = opened;
  }
  std::uint64_t& count = !known                            ? rejected_.foreign_address
                         : result == Opened::malformed     ? rejected_.malformed
                         : result == Opened::not_authentic ? rejected_.not_authentic
                         : result == Opened::replayed      ? rejected_.replayed
                                                           : rejected_.stale;
  ++count;
  return false;
}

void SecureSocket::paired(const Endpoint& peer, Duration since) noexcept {
  paired_ = peer;
  if (const Held* const held = newest_shared(peer)) paired_key_ = held->association->key;
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
  // Before its last flight leaves: the cycle has it when the peer's first record comes. What finds no room waits.
  while (waiting_ || (waiting_ = handshake_.take_association())) {
    const Endpoint peer = waiting_->peer;
    const std::size_t key = waiting_->key;
    if (!arrived_.try_push(waiting_.get())) break;
    static_cast<void>(waiting_.release());
    ++made_;
    if (options_.tell) options_.tell(HandshakeFailure::none, peer, key);
  }
  while (has_leaving_ || handshake_.take_outgoing(leaving_)) {
    has_leaving_ = !outgoing_.try_push(leaving_);
    if (has_leaving_) break;
  }
  failure_.store(handshake_.last_failure(), std::memory_order_relaxed);
  failed_.store(handshake_.counts().refused, std::memory_order_relaxed);
  if (options_.tell) tell(now);
}

void SecureSocket::tell(Duration now) {
  const std::uint64_t failed = handshake_.counts().failed;
  if (failed == told_failed_ || handshake_.last_failure() == HandshakeFailure::none ||
      (failed_at_ && now - *failed_at_ < kTellEvery))
    return;
  told_failed_ = failed, failed_at_ = now;
  options_.tell(handshake_.last_failure(), handshake_.failed_peer(), 0);
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
