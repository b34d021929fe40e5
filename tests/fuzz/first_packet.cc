#include <vector>

#include "common/secure/dtls_handshake.h"
#include "tests/fuzz/input.h"
#include "tests/support/memory_network.h"

// The datagrams of a handshake as a server reads them: any bytes, genuine hellos that were changed, and any bytes that a
// holder of one of three keys has signed, from any address and at any time. Only a proven hello is answered, by one cookie that is shorter; at most
// sixteen attempts of a flight each begin; nobody has an association.
namespace twoport {
namespace {

std::vector<Key> three_keys() {
  std::vector<Key> keys;
  for (std::uint8_t fill = 41; fill <= 43; ++fill) {
    Key::Bytes bytes;
    bytes.fill(fill);
    keys.emplace_back(bytes);
  }
  return keys;
}

void run(Input& in) {
  const std::vector<Key> keys = three_keys();
  DtlsHandshake server{{.server = true}, keys};
  KeyProof proof{keys};
  Duration now{0};
  Datagram hello;
  {
    DtlsHandshake client{{.server = false, .peer = MemoryNetwork::address(1, 1)}, keys[1]};
    client.advance(now, true);
    client.take_outgoing(hello);
  }
  Bits128 cookie{};
  for (int datagrams = 0; !in.empty() && datagrams < 100; ++datagrams) {
    const std::uint8_t what = in.byte();
    now += std::chrono::milliseconds{in.byte() << (what >> 5)};
    const Endpoint from = MemoryNetwork::address(in.byte() % 8, in.byte() % 4);
    Datagram d;
    const auto tail = in.piece(in.number(2) % (kMaxDatagramBytes - kProofHeader));
    bool proven = what & 1;
    if (what & 2) {
      d = hello;  // and changed
      if (!tail.empty() && !proven)
        for (std::size_t i = 0; i < tail.size() && i < d.bytes().size(); ++i) d.bytes()[i] ^= tail[i];
    } else {
      d.assign(tail, from);
    }
    if (proven) {
      HandshakeParts parts{.kind = static_cast<HandshakeKind>(1 + what / 4 % 4),
                           .cookie = what & 16 ? cookie : Bits128{}};
      const std::uint8_t which = in.byte();
      parts.attempt[0] = static_cast<std::byte>(which % 8);
      const auto known = read_handshake(d.bytes());
      parts.records = known ? known->records : d.bytes();
      std::array<std::byte, kMaxDatagramBytes> bytes;
      Datagram signed_one;
      signed_one.assign({bytes.data(), proof.write(which / 8 % keys.size(), parts, bytes)}, from);
      d = signed_one;
    } else {
      proven = read_handshake(d.bytes()) && proof.key_of(d.bytes());
    }
    server.on(d.bytes(), from, now);
    Datagram out;
    for (int answers = 0; server.take_outgoing(out); ++answers) {
      const auto parts = read_handshake(out.bytes());
      require(parts.has_value(), "an answer has a header");
      if (!proven) require(parts->kind == HandshakeKind::other_key && answers == 0, "who proves nothing gets nothing");
      if (parts->kind != HandshakeKind::of_server)
        require(out.bytes().size() <= d.bytes().size(), "an answer is shorter");
      if (parts->kind == HandshakeKind::cookie) cookie = parts->cookie;
      require(answers < 16, "a flight is short");
    }
    server.advance(now, false);
    int repeated = 0;
    while (server.take_outgoing(out)) ++repeated;
    require(repeated <= 16 * 8, "sixteen attempts");
    require(server.take_association() == nullptr, "nobody has finished a handshake");
  }
}

}  // namespace
}  // namespace twoport

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  twoport::Input in{data, size};
  twoport::run(in);
  return 0;
}
