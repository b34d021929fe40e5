#include "common/link/impaired_socket.h"

namespace twoport {
namespace {

constexpr Duration kInstant{1};  // the shortest time
constexpr Duration kBeforeTheRun = -std::chrono::hours{1};

constexpr int kMaxPerTick = 256;        // datagrams asked for; a flood must not hold up the tick
constexpr int kMaxOthersPerTick = 128;  // of those from unpaired addresses
constexpr std::size_t kBurst = 512;     // datagrams at once that the peer's line has room for
constexpr std::size_t kOthersRoom = 512;
// These make their fates differ from the peer's.
constexpr std::uint64_t kOthersStream = 0x6f7468657273, kOutgoingStream = 0x6f7574;

std::size_t room(double delay_s, double rate_hz) {
  return static_cast<std::size_t>(delay_s * rate_hz);
}

}  // namespace

ImpairedSocket::ImpairedSocket(DatagramSocket& socket, const ImpairedSocketOptions& o)
    : socket_{&socket},
      peer_is_given_{o.peer.has_value()},
      peer_{o.peer},
      of_peer_{o.incoming, o.seed,
               kBurst + packets_in_flight(o.incoming, o.peer_rate_hz) + room(o.longest_set_s, o.peer_rate_hz)},
      of_others_{o.incoming, o.seed ^ kOthersStream, kOthersRoom},
      outgoing_{{}, o.seed ^ kOutgoingStream, o.rate_hz > 0.0 ? kBurst + room(o.longest_set_s, o.rate_hz) : 1} {}

void ImpairedSocket::set_incoming(const Direction& d) noexcept {
  of_peer_.adjust(d.delay_s, d.jitter_s, d.loss);
  of_others_.adjust(d.delay_s, d.jitter_s, d.loss);
}

bool ImpairedSocket::send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept {
  if (outgoing_.passes()) [[likely]]
    return socket_->send(bytes, to, now);
  if (bytes.size() > kMaxDatagramBytes) return false;
  outgoing_.put(ReceivedDatagram{bytes, to, now}, now);
  return true;
}

std::optional<ReceivedDatagram> ImpairedSocket::receive(Duration now) noexcept {
  if (tick_ != now) {
    tick_ = now;
    left_ = kMaxPerTick;
    others_left_ = kMaxOthersPerTick;
    while (const Datagram* due = outgoing_.take(now)) socket_->send(due->bytes(), due->from, now);
  }
  // Nothing is impaired: datagrams pass as they are, without a copy.
  if (of_peer_.passes() && of_others_.passes()) return accepted(now);
  while (const std::optional<ReceivedDatagram> datagram = accepted(now)) {
    const Duration since_start = start_ ? datagram->arrived - *start_ : kBeforeTheRun;
    (datagram->from == peer_ ? of_peer_ : of_others_).put(*datagram, datagram->arrived, since_start);
  }
  // The others first: one of them may be the peer of now, and these its older datagrams.
  const Datagram* datagram = of_others_.take(now);
  if (datagram == nullptr) datagram = of_peer_.take(now);
  if (datagram == nullptr) return std::nullopt;
  return ReceivedDatagram{datagram->bytes(), datagram->from, now - kInstant};
}

std::optional<ReceivedDatagram> ImpairedSocket::accepted(Duration now) noexcept {
  while (left_ > 0) {
    --left_;
    const std::optional<ReceivedDatagram> datagram = socket_->receive(now);
    if (!datagram) {
      left_ = 0;
      break;
    }
    if (datagram->from != peer_ && (peer_is_given_ || others_left_-- <= 0)) {
      ++(peer_is_given_ ? rejected_.foreign_address : rejected_.flood);
      continue;
    }
    if (datagram->bytes.size() <= kMaxDatagramBytes) return datagram;
    ++rejected_.too_long;
  }
  return std::nullopt;
}

void ImpairedSocket::paired(const Endpoint& peer, Duration since) noexcept {
  // What is received at `since` has arrived just before it, and belongs to the run.
  if (!start_) start_ = since - kInstant;
  if (!peer_is_given_) peer_ = peer;
  socket_->paired(peer, since);
}

const Endpoint& ImpairedSocket::local() const noexcept {
  return socket_->local();
}

SocketCounts ImpairedSocket::counts() const noexcept {
  SocketCounts counts = socket_->counts();
  counts.rejected += rejected_;
  counts.rejected.flood += of_others_.overflowed();
  counts.lost += of_peer_.lost() + of_others_.lost() + outgoing_.lost();
  counts.overflowed += of_peer_.overflowed() + outgoing_.overflowed();
  return counts;
}

}  // namespace twoport
