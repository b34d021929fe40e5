#include "common/link/impaired_socket.h"

namespace twoport {
namespace {

constexpr Duration kInstant{1};  // the shortest time
constexpr Duration kBeforeTheRun = -std::chrono::hours{1};

constexpr int kMaxPerTick = 256;        // datagrams asked for; a flood must not hold up the tick
constexpr int kMaxOthersPerTick = 128;  // of those from unpaired addresses
constexpr std::size_t kBurst = 512;     // datagrams at once that the peer's line has room for
constexpr std::size_t kOthersRoom = 512;
constexpr std::uint64_t kOthersStream = 0x6f7468657273;  // makes their fates differ from the peer's

}  // namespace

ImpairedSocket::ImpairedSocket(DatagramSocket& socket, const ImpairedSocketOptions& o)
    : socket_{&socket},
      peer_is_given_{o.peer.has_value()},
      peer_{o.peer},
      of_peer_{o.incoming, o.seed, kBurst + packets_in_flight(o.incoming, o.peer_rate_hz)},
      of_others_{o.incoming, o.seed ^ kOthersStream, kOthersRoom},
      passes_{of_peer_.unimpaired()} {}

bool ImpairedSocket::send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept {
  return socket_->send(bytes, to, now);
}

std::optional<ReceivedDatagram> ImpairedSocket::receive(Duration now) noexcept {
  if (tick_ != now) {
    tick_ = now;
    left_ = kMaxPerTick;
    others_left_ = kMaxOthersPerTick;
  }
  if (passes_) return accepted(now);
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
  counts.lost += of_peer_.lost() + of_others_.lost();
  counts.overflowed += of_peer_.overflowed();
  return counts;
}

}  // namespace twoport
