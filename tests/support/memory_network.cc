#include "tests/support/memory_network.h"

#include <algorithm>
#include <stdexcept>

namespace twoport {

MemoryNetwork::Destination::Destination(const Endpoint& where, const Conditions& conditions, std::uint64_t seed,
                                        std::size_t room)
    : address{where}, impairment{conditions.impairment, seed}, corruption{conditions.corruption}, line{room} {}

MemoryNetwork::MemoryNetwork(std::uint64_t seed, std::size_t room) : random_{seed}, room_{room} {}
MemoryNetwork::~MemoryNetwork() = default;

Endpoint MemoryNetwork::address(std::uint8_t host, std::uint16_t port) {
  Endpoint e;
  e.address = {10, 0, 0, host};
  e.port = port;
  return e;
}

MemoryNetwork::Destination* MemoryNetwork::find(const Endpoint& address) noexcept {
  for (Destination& d : destinations_)
    if (d.address == address) return &d;
  return nullptr;
}
MemoryNetwork::Destination& MemoryNetwork::at(const Endpoint& address) {
  if (Destination* known = find(address)) return *known;
  return destinations_.emplace_back(address, conditions_, random_(), room_);
}

MemorySocket MemoryNetwork::open(const Endpoint& local, Duration now) {
  Destination& here = at(local);
  if (here.bound) throw std::logic_error{"MemoryNetwork: a living socket has this address"};
  while (here.line.take(now) != nullptr) {
  }
  here.bound = true;
  return {*this, here};
}

void MemoryNetwork::set_conditions(const Endpoint& to, const Conditions& conditions, std::uint64_t seed) {
  Destination& there = at(to);
  there.impairment = Impairment{conditions.impairment, seed};
  there.corruption = conditions.corruption;
}
void MemoryNetwork::set_conditions(const Conditions& conditions) {
  conditions_ = conditions;
  for (Destination& d : destinations_) set_conditions(d.address, conditions, random_());
}

bool MemoryNetwork::send(std::span<const std::byte> bytes, const Endpoint& from, const Endpoint& to,
                         Duration now) noexcept {
  if (bytes.size() > kMaxDatagramBytes) return false;
  Destination* there = find(to);
  if (there == nullptr) return true;  // no socket there: lost, as for UDP
  const Impairment::Fate fate = there->impairment.draw(now);
  if (fate.copies == 0) ++there->lost;
  for (int c = 0; c < fate.copies; ++c) {
    travelling_.assign(bytes, from);
    if (there->corruption > 0.0 && static_cast<double>(random_() >> 11) * 0x1p-53 < there->corruption)
      corrupt(travelling_);
    if (!there->line.put(travelling_, now, now + fate.delay[c])) ++there->overflowed;
  }
  return true;
}

void MemoryNetwork::corrupt(Datagram& datagram) noexcept {
  const std::size_t size = datagram.bytes().size();
  if (size == 0) return;
  const std::uint64_t changes = random_() % 5;
  if (changes == 0) return datagram.cut(random_() % size);
  for (std::uint64_t i = 0; i < changes; ++i) datagram.bytes()[random_() % size] = static_cast<std::byte>(random_());
}

MemorySocket::~MemorySocket() {
  here_->bound = false;
}

bool MemorySocket::send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept {
  const bool sent = network_->send(bytes, here_->address, to, now);
  if (!sent) ++unsent_;
  return sent;
}

std::optional<ReceivedDatagram> MemorySocket::receive(Duration now) noexcept {
  const auto* entry = here_->line.take(now);
  if (entry == nullptr) return std::nullopt;
  return ReceivedDatagram{entry->packet.bytes(), entry->packet.from, std::min(entry->due, now - Duration{1})};
}

const Endpoint& MemorySocket::local() const noexcept {
  return here_->address;
}
SocketCounts MemorySocket::counts() const noexcept {
  return {.unsent = unsent_, .lost = here_->lost, .overflowed = here_->overflowed};
}

}  // namespace twoport
