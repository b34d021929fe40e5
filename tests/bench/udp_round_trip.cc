// Round trip of one datagram over 127.0.0.1 between two pinned threads, in interleaved blocks of one run:
//
//   raw    plain connected sockets that spin on MSG_DONTWAIT, with as many bytes as our datagram has
//   path   what the programs do: device and robot simulated, both nodes, codec, handshake, impaired socket, Mailbox
//   key    the same with --key: every datagram encrypted and authenticated
//
// with --stages also what lies between, each above the one before: the socket, the network of a scene without impairments, the
// codec, the link (handshake and Mailbox; then the path adds nodes and plants), and the path with both ends asleep until a datagram is
// there, as back to back trips: an end that waits costs no core
//
// and what one datagram costs to seal and to open.
//
// On a shared machine run it as `chrt -f 50 udp_round_trip`, or other programs' time slices end up in p99.
//
// usage: udp_round_trip [--dof 1|3|6] [--blocks N] [--trips N] [--cores A,B] [--stages yes|no]
#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>

#include <CLI/CLI.hpp>
#include <array>
#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/udp.hpp>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "common/base/built_for.h"
#include "common/base/histogram.h"
#include "common/link/impaired_socket.h"
#include "common/link/mailbox.h"
#include "common/platform/random.h"
#include "common/platform/udp.h"
#include "common/scene/load.h"
#include "common/secure/secure_socket.h"
#include "common/wire/link_transport.h"
#include "master/master_node.h"
#include "sim/sim_device.h"
#include "sim/sim_robot.h"
#include "slave/slave_node.h"
#include "tests/support/hand_written.h"

namespace twoport {
namespace {

using Clock = std::chrono::steady_clock;

struct Arguments {
  int dof = 3, blocks = 20, trips = 5000;
  std::vector<int> cores{0, 1};
  std::string stages = "no";
};

Duration clock_now() {
  return std::chrono::duration_cast<Duration>(Clock::now().time_since_epoch());
}

void pin(int core) {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<std::size_t>(core), &set);
  if (pthread_setaffinity_np(pthread_self(), sizeof set, &set) != 0)
    std::fprintf(stderr, "not pinned to core %d: the numbers will jump\n", core);
}

Endpoint here() {
  return parse_endpoint("127.0.0.1:0", "bench");
}

/// A report as long as one of a running session.
template <int N>
Envelope<N> full_envelope() {
  Envelope<N> e;
  e.session = e.peer_session = ~std::uint64_t{0};
  e.report.sequence = e.report.sent_ns = e.report.echo_ns = 1;
  e.report.energy_in_j = 1.0;
  e.report.mode = Mode::coupled;
  return e;
}

// ---- raw sockets

class Raw {
 public:
  explicit Raw(std::size_t payload) : payload_{payload} {
    near_.connect(far_.local_endpoint());
    far_.connect(near_.local_endpoint());
    near_.non_blocking(true), far_.non_blocking(true);
  }

  void near_trip() {
    near_.send(boost::asio::buffer(buffer_, payload_));
    while (!receives(near_, buffer_)) {
    }
  }
  void far_turn() {
    if (receives(far_, far_buffer_)) far_.send(boost::asio::buffer(far_buffer_, payload_));
  }

 private:
  using udp = boost::asio::ip::udp;
  using Buffer = std::array<char, kMaxDatagram>;
  static bool receives(udp::socket& socket, Buffer& to) {
    boost::system::error_code none;
    return socket.receive(boost::asio::buffer(to), 0, none) > 0;
  }

  std::size_t payload_;
  boost::asio::io_context context_;
  udp::socket near_{context_, {boost::asio::ip::address_v4::loopback(), 0}},
      far_{context_, {boost::asio::ip::address_v4::loopback(), 0}};
  Buffer buffer_{}, far_buffer_{};
};

// ---- stages between the two

/// Bytes of one report back and forth. `Near` and `Far` are one end each: send(), and receive(f), which calls f for what it finds.
template <class End>
class Stage {
 public:
  void near_trip() {
    near_.send();
    while (!near_.receive()) {
    }
  }
  void far_turn() {
    if (far_.receive()) far_.send();
  }

 private:
  End far_{{}}, near_{far_.local()};
};

/// UdpSocket; with `kImpaired` a scene's network without any impairment above it; with `kCoded` the report is encoded and decoded.
template <int N, bool kImpaired, bool kCoded>
class StageEnd {
 public:
  explicit StageEnd(const std::optional<Endpoint>& peer)
      : udp_{peer ? UdpSocket{here(), *peer} : UdpSocket{here()}},
        network_{udp_, {.peer = peer}},
        peer_{peer.value_or(Endpoint{})} {
    envelope_ = full_envelope<N>();
    encoded_ = codec_.encode(envelope_);
  }
  [[nodiscard]] const Endpoint& local() const { return udp_.local(); }
  void send() { socket().send(kCoded ? codec_.encode(envelope_) : encoded_, peer_, now_); }
  bool receive() {
    now_ += Duration{100};
    bool found = false;
    while (const auto datagram = socket().receive(now_)) {
      peer_ = datagram->from;
      found = !kCoded || codec_.decode(datagram->bytes, incoming_) == Decoded::ok;
    }
    return found;
  }

 private:
  DatagramSocket& socket() {
    if constexpr (kImpaired) return network_;
    return udp_;
  }
  UdpSocket udp_;
  ImpairedSocket network_;
  Endpoint peer_;
  Codec<N> codec_;
  Envelope<N> envelope_, incoming_;
  std::span<const std::byte> encoded_;
  Duration now_{0};
};

// ---- the real path

/// A hand, a robot and a wall, stepped by their nodes: what the programs run between two packets.
template <int N>
Scene scene() {
  return parse_scene(bench::wall_scene(N), "bench", std::vector<std::string>{"robot.force_sensor={}"});
}
constexpr Seconds kPeriod{5e-4};

/// A node and its simulated hardware.
template <int N, class Hardware, class Node, class Clock>
struct Stepped {
  Hardware hardware{scene<N>(), kPeriod};
  Node node{scene<N>().control};
  Report<N> step(const PeerState<N>& known, Duration now) noexcept {
    hardware.advance();
    const auto out = node.step(Tick<Clock>{Instant<Clock>{now}, kPeriod}, hardware.sense(), known);
    hardware.actuate(out.command);
    return out.report;
  }
};

template <int N>
class Path {
 public:
  /// `nodes`: else the reports are sent as they are.
  /// `sleeps`: until a datagram is there, else it looks again and again.
  explicit Path(bool key, bool nodes = true, bool sleeps = false) : nodes_{nodes}, sleeps_{sleeps} {
    if (key) {
      far_secure_ = std::make_unique<SecureSocket>(
          far_network_, SecureSocketOptions{.server = true, .own_thread = true}, Key{Key::Bytes{}});
      near_secure_ = std::make_unique<SecureSocket>(
          near_network_, SecureSocketOptions{.peer = far_udp_.local(), .own_thread = true}, Key{Key::Bytes{}});
    }
    const auto top = [](auto& secure, DatagramSocket& plain) -> DatagramSocket& { return secure ? *secure : plain; };
    far_box_ = std::make_unique<Box>(
        LinkTransport<N>{top(far_secure_, far_network_), SessionOptions{.side = Side::slave}, system_random});
    near_box_ = std::make_unique<Box>(
        LinkTransport<N>{top(near_secure_, near_network_), SessionOptions{.peer = far_udp_.local()}, system_random});
    Box& near_ = *near_box_;
    Report<N> hello;
    while (!near_.collect(tick(near_now_)).has_report) {
      if (near_.transport().take_new_session()) near_.reset(near_.transport().handshake().session_since());
      near_.post(hello, near_now_);
      far_turn();
    }
  }

  void near_trip() {
    Box& near_ = *near_box_;
    const Duration now = tick(near_now_);
    Report<N> report = nodes_ ? near_node_.step(known_, now) : sent_;
    near_.post(report, near_now_);
    while (true) {
      const PeerState<N>& known = near_.collect(tick(near_now_));
      if (!known.is_new) {
        if (sleeps_) near_udp_.wait(kLongestSleep);
        continue;
      }
      known_ = known;
      return;
    }
  }
  void far_turn() {
    Box& far_ = *far_box_;
    if (far_.transport().take_new_session()) far_.reset(far_.transport().handshake().session_since());
    const PeerState<N>& known = far_.collect(tick(far_now_));
    if (!known.is_new && known.has_report) {
      if (sleeps_) far_udp_.wait(kLongestSleep);
      return;
    }
    Report<N> report = nodes_ ? far_node_.step(known, far_now_) : sent_;
    far_.post(report, far_now_);
  }

  [[nodiscard]] std::uint64_t lost() { return near_box_->counts().lost + far_box_->counts().lost; }

 private:
  /// The time that a loop would hand in: it reads no clock, and must only move on.
  static Duration tick(Duration& now) { return now += Duration{100}; }

  static constexpr Duration kLongestSleep = std::chrono::milliseconds{10};

  bool nodes_, sleeps_;
  Report<N> sent_ = full_envelope<N>().report;
  Duration near_now_{0}, far_now_{0};
  UdpSocket far_udp_{here()}, near_udp_{here(), far_udp_.local()};
  ImpairedSocket far_network_{far_udp_, {}}, near_network_{near_udp_, {.peer = far_udp_.local()}};
  std::unique_ptr<SecureSocket> far_secure_, near_secure_;
  using Box = Mailbox<N, LinkTransport<N>>;
  std::unique_ptr<Box> far_box_, near_box_;
  Stepped<N, sim::SimRobot<N>, SlaveNode<N>, SlaveClock> far_node_;
  Stepped<N, sim::SimDevice<N>, MasterNode<N>, MasterClock> near_node_;
  PeerState<N> known_;
};

// ---- measuring

/// `trips` round trips, the far end in a thread of its own on its own core. Returns the time of processors used over the time passed.
template <class Way>
double block(Way& way, const Arguments& arguments, Histogram& histogram) {
  constexpr int kWarmUp = 200;
  std::atomic<bool> ready{false}, done{false};
  std::thread far{[&] {
    pin(arguments.cores[1]);
    ready.store(true);
    while (!done.load(std::memory_order_relaxed)) way.far_turn();
  }};
  while (!ready.load()) std::this_thread::yield();
  for (int k = 0; k < kWarmUp; ++k) way.near_trip();
  const auto used = [] {
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
  };
  const double used_before = used();
  const auto began = Clock::now();
  for (int k = 0; k < arguments.trips; ++k) {
    const Duration begin = clock_now();
    way.near_trip();
    histogram.add(clock_now() - begin);
  }
  const double cores = (used() - used_before) / std::chrono::duration<double>(Clock::now() - began).count();
  done.store(true);
  far.join();
  return cores;
}

double us(Duration d) {
  return static_cast<double>(d.count()) / 1e3;
}

void print(const char* name, const Histogram& h, const Histogram& raw) {
  std::printf("%-8s %7.2f %8.2f %8.2f %10.2f us %8.2f %6.2f\n", name, us(h.percentile(0.5)), us(h.percentile(0.99)),
              us(h.percentile(0.999)), us(h.max()), us(h.percentile(0.5)) / us(raw.percentile(0.5)),
              us(h.percentile(0.99)) / us(raw.percentile(0.99)));
}

/// Mean time of sealing and of opening a datagram of `size` bytes [ns].
std::array<double, 2> seal_and_open_ns(std::size_t size) {
  constexpr std::size_t kRecords = 2000;
  constexpr int kRounds = 50;
  const std::vector<std::byte> plain(size);
  std::vector<std::vector<std::byte>> records(kRecords);
  std::array<double, 2> spent{};
  const auto ns = [](Clock::duration d) { return std::chrono::duration<double, std::nano>(d).count(); };
  Sealer sealer{RecordKeys{}};
  Opener opener{RecordKeys{}};
  for (int round = 0; round < kRounds; ++round) {
    for (auto& record : records) {
      const auto begin = Clock::now();
      const auto sealed = sealer.seal(plain);
      spent[0] += ns(Clock::now() - begin);
      record.assign(sealed.begin(), sealed.end());
    }
    for (const auto& record : records) {
      std::span<const std::byte> opened;
      const auto begin = Clock::now();
      opener.open(record, opened);
      spent[1] += ns(Clock::now() - begin);
    }
  }
  for (double& each : spent) each /= kRounds * static_cast<double>(kRecords);
  return spent;
}

template <int N>
void measure(const Arguments& arguments) {
  const std::size_t payload = Codec<N>{}.encode(full_envelope<N>()).size();
  Raw raw{payload};
  Stage<StageEnd<N, false, false>> socket;
  Stage<StageEnd<N, true, false>> network;
  Stage<StageEnd<N, true, true>> codec;
  Path<N> link{false, false}, path{false}, key{true}, sleep{false, true, true};
  // From here on: the handshakes' threads, which are there now, have every core.
  pin(arguments.cores[0]);
  const bool stages = arguments.stages == "yes";
  std::array<const char*, 8> names{"raw", "socket", "network", "codec", "link", "path", "key", "sleep"};
  const auto trips = std::make_unique<std::array<Histogram, 8>>();
  double busy = 0.0, asleep = 0.0;
  auto& t = *trips;
  for (int b = 0; b < arguments.blocks; ++b) {
    block(raw, arguments, t[0]);
    if (stages) {
      block(socket, arguments, t[1]);
      block(network, arguments, t[2]);
      block(codec, arguments, t[3]);
      block(link, arguments, t[4]);
    }
    busy += block(path, arguments, t[5]);
    block(key, arguments, t[6]);
    if (stages) asleep += block(sleep, arguments, t[7]);
  }
  std::printf("dof %d, payload %zu B, %d blocks of %d round trips each, cores %d and %d\n", N, payload,
              arguments.blocks, arguments.trips, arguments.cores[0], arguments.cores[1]);
  std::printf("            p50      p99    p99.9        max        p50 and p99 against raw\n");
  for (std::size_t i = 0; i < t.size(); ++i)
    if (t[i].count() > 0) print(names[i], t[i], t[0]);
  std::printf("reports lost: %llu, with a key %llu\n", static_cast<unsigned long long>(path.lost()),
              static_cast<unsigned long long>(key.lost()));
  std::printf("cores in use by both ends: %.2f", busy / arguments.blocks);
  if (stages) std::printf(", asleep %.2f", asleep / arguments.blocks);
  std::printf("\n");
  const auto [seal, open] = seal_and_open_ns(payload);
  std::printf("one datagram: seal %.0f ns, open %.0f ns, one reading of the clock in each\n", seal, open);
}

}  // namespace
}  // namespace twoport

int main(int argc, char** argv) {
  twoport::Arguments a;
  CLI::App app{"udp_round_trip: one datagram over 127.0.0.1 and back"};
  app.add_option("--dof", a.dof)->check(CLI::IsMember({1, 3, 6}));
  app.add_option("--blocks", a.blocks);
  app.add_option("--trips", a.trips);
  app.add_option("--cores", a.cores)->delimiter(',')->expected(2);
  app.add_option("--stages", a.stages)->check(CLI::IsMember({"yes", "no"}));
  CLI11_PARSE(app, argc, argv);
  twoport::for_dof(a.dof, [&]<int N>() { twoport::measure<N>(a); });
}
