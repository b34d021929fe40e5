#include "common/secure/secure_socket.h"
#include "tests/fuzz/input.h"
#include "tests/support/memory_network.h"

// The filter of a client and of a server on a network that the input controls: genuine datagrams are lost, repeated and
// changed, and the input adds its own from any address. Nothing is handed up that neither has said; nobody without the
// key has an association; new keys are agreed on every 100 ms; in the end, with a network that works, the two talk.
namespace twoport {
namespace {

using namespace std::chrono_literals;

const Endpoint kServerAt = MemoryNetwork::address(1, 1), kClientAt = MemoryNetwork::address(2, 2),
               kElsewhere = MemoryNetwork::address(3, 3);
constexpr std::array<std::byte, 4> kWord{std::byte{'w'}, std::byte{'o'}, std::byte{'r'}, std::byte{'d'}};

class World {
 public:
  explicit World(Input& in) : in_{in} { weather(0); }

  void run() {
    while (!in_.empty()) {
      const std::uint8_t what = in_.byte();
      if (what < 64) {
        for (int k = 0; k <= what % 8; ++k) tick();
      } else if (what < 80) {
        weather(what);
      } else {
        const bool to_server = what & 1;
        const Endpoint from = what & 2 ? kElsewhere : to_server ? kClientAt : kServerAt;
        std::array<std::byte, 512> bytes;
        const auto tail = in_.piece(in_.byte());
        // Begins like a record often enough.
        std::size_t size = 0;
        if (what & 4)
          for (const int b : {20 + in_.byte() % 4, 0xfe, 0xfd, 0, what >> 3 & 1, 0, 0, 0, 0, 0, in_.byte() % 4, 0,
                              static_cast<int>(tail.size())})
            bytes[size++] = static_cast<std::byte>(b);
        for (const std::byte b : tail) bytes[size++] = b;
        network_.send({bytes.data(), size}, from, to_server ? kServerAt : kClientAt, now_);
      }
    }
    weather(0);
    const std::uint64_t heard[] = {heard_[0], heard_[1]};
    for (int k = 0; k < 4000 && (heard_[0] <= heard[0] || heard_[1] <= heard[1]); ++k) tick(5ms);
    require(heard_[0] > heard[0] && heard_[1] > heard[1], "in peace the two talk");
  }

 private:
  void weather(std::uint8_t what) {
    MemoryNetwork::Conditions c;
    c.impairment.delay_s = 0.001;
    c.impairment.loss = what & 1 ? 0.3 : 0.0;
    c.impairment.duplicate = what & 2 ? 0.3 : 0.0;
    c.impairment.reorder = what & 4 ? 0.3 : 0.0;
    c.impairment.reorder_s = 0.02;
    c.corruption = what & 8 ? 0.2 : 0.0;
    network_.set_conditions(c);
  }
  void tick(Duration span = 1ms) {
    now_ += span;
    int i = 0;
    for (SecureSocket* socket : {&server_, &client_}) {
      while (const auto datagram = socket->receive(now_)) {
        require(std::equal(datagram->bytes.begin(), datagram->bytes.end(), kWord.begin(), kWord.end()),
                "only what was said is handed up");
        ++heard_[i];
      }
      socket->send(kWord, i == 0 ? kClientAt : kServerAt, now_);
      ++i;
    }
  }
  static Key key() {
    Key::Bytes bytes;
    bytes.fill(42);
    return Key{bytes};
  }

  Input& in_;
  Duration now_{0};
  MemoryNetwork network_;
  MemorySocket a_{network_.open(kServerAt, now_)}, b_{network_.open(kClientAt, now_)};
  SecureSocket server_{a_, {.server = true}, key()},
      client_{b_, {.server = false, .peer = kServerAt, .rekey_after = 100ms}, key()};
  std::uint64_t heard_[2] = {0, 0};
};

}  // namespace
}  // namespace twoport

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  twoport::Input in{data, size};
  twoport::World{in}.run();
  return 0;
}
