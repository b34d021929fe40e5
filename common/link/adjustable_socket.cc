#include "common/link/adjustable_socket.h"

namespace twoport {
namespace {

constexpr Duration kInstant{1};  // the shortest time
constexpr int kMaxPerTick = 256;
constexpr std::size_t kBurst = 512;
constexpr std::uint64_t kOutgoingStream = 0x6f7574;

std::size_t capacity(double delay_s, double rate_hz) {
  return kBurst + static_cast<std::size_t>(delay_s * rate_hz);
}

}  // namespace

AdjustableSocket::AdjustableSocket(DatagramSocket& socket, const Endpoint& peer, const Room& room, std::uint64_t seed)
    : socket_{&socket},
      peer_{peer},
      outgoing_{{}, seed ^ kOutgoingStream, capacity(room.longest_delay_s, room.outgoing_hz)},
      incoming_{{}, seed, capacity(room.longest_delay_s, room.incoming_hz)} {}

bool AdjustableSocket::send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept {
  if (waiting_ == 0 && outgoing_.unimpaired()) return socket_->send(bytes, to, now);
  if (bytes.size() > kMaxDatagramBytes) return false;
  moving_.assign(bytes, to);
  const std::uint64_t gone = outgoing_.lost() + outgoing_.overflowed();
  outgoing_.put(moving_, now);
  if (outgoing_.lost() + outgoing_.overflowed() == gone) ++waiting_;
  return true;
}

void AdjustableSocket::pass(Duration now) noexcept {
  while (waiting_ > 0) {
    const Datagram* due = outgoing_.take(now);
    if (due == nullptr) break;
    --waiting_;
    socket_->send(due->bytes(), due->from, now);
  }
  for (int i = 0; i < kMaxPerTick; ++i) {
    const std::optional<ReceivedDatagram> datagram = socket_->receive(now);
    if (!datagram) return;
    if (datagram->from != peer_) {
      ++rejected_.foreign_address;
      continue;
    }
    if (datagram->bytes.size() > kMaxDatagramBytes) {
      ++rejected_.too_long;
      continue;
    }
    moving_.assign(datagram->bytes, datagram->from);
    incoming_.put(moving_, datagram->arrived);
  }
}

std::optional<ReceivedDatagram> AdjustableSocket::receive(Duration now) noexcept {
  if (passed_at_ != now) {
    passed_at_ = now;
    pass(now);
  }
  const Datagram* due = incoming_.take(now);
  if (due == nullptr) return std::nullopt;
  return ReceivedDatagram{due->bytes(), due->from, now - kInstant};
}

SocketCounts AdjustableSocket::counts() const noexcept {
  SocketCounts counts = socket_->counts();
  counts.rejected += rejected_;
  counts.lost += outgoing_.lost() + incoming_.lost();
  counts.overflowed += outgoing_.overflowed() + incoming_.overflowed();
  return counts;
}

}  // namespace twoport
