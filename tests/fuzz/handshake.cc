#include "common/wire/handshake.h"

#include <array>
#include <vector>

#include "tests/fuzz/input.h"
#include "tests/support/memory_network.h"

// A master, a slave and a stranger on a network that the input controls: it delivers, repeats, delays and drops the headers
// of the two, and forges others, without knowledge of their numbers. Without a key: no header that nobody of the two has
// sent ends a program, and none ends a session that works. In the end, with a network that works, the two are coupled.
namespace twoport {
namespace {

using namespace std::chrono_literals;
using Action = Handshake::Action;

constexpr int kDof = 3;

struct Sent {
  Header header;
  bool to_slave;
};

class World {
 public:
  explicit World(Input& in) : in_{in} {}

  void run() {
    while (!in_.empty()) step();
    // Peace. An old session is given up after a second; an offer is replaced every half second.
    const bool ended = !s_.reject_reason().empty() || !m_.reject_reason().empty();
    require(!ended, "nobody ends a program without its numbers");
    for (int k = 0; k < 800 && !(k > 2 && m_.coupled(now_) && s_.coupled(now_)); ++k) {
      now_ += 5ms;
      deliver({m_.header(now_), true}, kMasterAt);
      deliver({s_.header(now_), false}, kSlaveAt);
      greet();
    }
    require(m_.coupled(now_) && s_.coupled(now_), "in peace the two are coupled");
  }

 private:
  static inline const Endpoint kSlaveAt = MemoryNetwork::address(1, 1), kMasterAt = MemoryNetwork::address(2, 2),
                               kElsewhere = MemoryNetwork::address(3, 3);

  void step() {
    switch (in_.byte() % 8) {
      case 0:
        now_ += std::chrono::milliseconds{in_.byte()};
        m_.advance(now_), s_.advance(now_);
        break;
      case 1:
        say({m_.header(now_), true});
        break;
      case 2:
        if (s_.peer()) say({s_.header(now_), false});
        break;
      case 3:
        greet();
        break;
      case 4:  // again, or late
        if (!sent_.empty()) deliver(sent_[in_.byte() % sent_.size()], kMasterAt);
        break;
      case 5:  // from elsewhere
        if (!sent_.empty()) deliver(sent_[in_.byte() % sent_.size()], kElsewhere);
        break;
      default:
        forge();
    }
  }

  void say(const Sent& sent) {
    keep(sent);
    if (in_.byte() % 4 != 0) deliver(sent, kMasterAt);
  }
  void keep(const Sent& sent) {
    if (sent_.size() < 64) sent_.push_back(sent);
  }
  void greet() {
    if (const auto greeting = s_.take_greeting()) {
      keep({greeting->header, false});
      if (greeting->to == kMasterAt) deliver({greeting->header, false}, kSlaveAt);
    }
  }

  void forge() {
    Header h;
    // Small numbers are never drawn.
    h.session = 1 + in_.number(1);
    h.peer_session = in_.number(1);
    const std::uint8_t kind = in_.byte();
    Decoded decoded = Decoded::ok;
    if (kind & 1)
      h.identity =
          Identity{in_.byte() % 7, kind & 2 ? 1000.0 : 500.0, in_.byte() % 2u, kind & 4 ? Side::master : Side::slave};
    if (kind & 8) h.refusal = "master and slave do not fit";
    if (kind & 16) decoded = Decoded::other_version, h.version = kProtocolVersion + 1;
    if (decoded == Decoded::ok && h.identity && h.identity->dof != kDof) decoded = Decoded::other_dof;
    const bool to_slave = kind & 32;
    act(to_slave ? s_ : m_, h, decoded, kind & 64 ? kElsewhere : to_slave ? kMasterAt : kSlaveAt);
  }

  void deliver(const Sent& sent, const Endpoint& master_at) {
    act(sent.to_slave ? s_ : m_, sent.header, Decoded::ok, sent.to_slave ? master_at : kSlaveAt);
  }
  void act(Handshake& to, const Header& header, Decoded decoded, const Endpoint& from) {
    if (!to.listens() || !to.hears(from)) return;
    const bool coupled = to.coupled(now_);
    const std::uint64_t pairings = to.pairings();
    const Action action = to.on(header, decoded, from, now_);
    require(action != Action::end, "no packet of these ends a program");
    if (to.take_new_session())
      require(!coupled && to.pairings() == pairings + 1, "a session that works is not replaced");
    if (action == Action::refuse) {
      const Header refusal = to.refusal();
      require(refusal.session != to.header(now_).session && !refusal.identity, "a refusal tells nothing");
    }
  }

  static SessionNumbers numbers(std::uint64_t from) {
    return [next = from]() mutable { return next++; };
  }

  Input& in_;
  Duration now_{0};
  Handshake m_{{.side = Side::master, .scene_digest = 1, .peer = kSlaveAt}, kDof, numbers(1'000'000)};
  Handshake s_{{.side = Side::slave, .scene_digest = 1}, kDof, numbers(2'000'000)};
  std::vector<Sent> sent_;
};

}  // namespace
}  // namespace twoport

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  twoport::Input in{data, size};
  twoport::World{in}.run();
  return 0;
}
