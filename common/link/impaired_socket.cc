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
      of_others_{o.incoming, o.seed ^ kOthersStream, kOthersRoom} {}

bool ImpairedSocket::send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept {
  return socket_->send(bytes, to, now);
}

std::optional<ReceivedDatagram> ImpairedSocket::receive(Duration now) noexcept {
  if (filled_at_ != now) {
    filled_at_ = now;
    fill(now);
  }
  // The others first: one of them may be the peer of now, and these its older datagrams.
  const Datagram* datagram = of_others_.take(now);
  if (datagram == nullptr) datagram = of_peer_.take(now);
  if (datagram == nullptr) return std::nullopt;
  return ReceivedDatagram{datagram->bytes(), datagram->from, now - kInstant};
}

void ImpairedSocket::fill(Duration now) noexcept {
  int others = 0;
  for (int i = 0; i < kMaxPerTick; ++i) {
    const std::optional<ReceivedDatagram> datagram = socket_->receive(now);
    if (!datagram) return;
    const bool of_peer = datagram->from == peer_;
    if (!of_peer && (peer_is_given_ || ++others > kMaxOthersPerTick)) {
      ++(peer_is_given_ ? rejected_.foreign_address : rejected_.flood);
      continue;
    }
    if (datagram->bytes.size() > kMaxDatagramBytes) {
      ++rejected_.too_long;
      continue;
    }
    arriving_.assign(datagram->bytes, datagram->from);
    const Duration since_start = start_ ? datagram->arrived - *start_ : kBeforeTheRun;
    (of_peer ? of_peer_ : of_others_).put(arriving_, datagram->arrived, since_start);
  }
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
