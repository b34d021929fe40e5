#include "common/platform/session.h"

#include <algorithm>
#include <array>
#include <cinttypes>
#include <cmath>
#include <cstdio>
#include <random>
#include <utility>

#include "common/base/check.h"
#include "common/link/delay_line.h"

namespace twoport {
namespace {

using namespace std::chrono_literals;

constexpr Duration kSilent = 100ms;         // after which a peer may be gone
constexpr Duration kRefusalEvery = 20ms;    // at most one so often
constexpr Duration kRefusalLinger = 500ms;  // during which the refused one is told
constexpr Duration kTakenAfter = 1s;        // asking in vain before a stranger is told that the slave is taken
constexpr Duration kGoneAfter = 1s;         // of silence: then the slave takes up an earlier master that still lives
constexpr int kMaxPerPoll = 256;            // datagrams; a flood must not hold up the tick
constexpr std::size_t kBurst = 512;         // packets at once that a line has room for

/// Session numbers, drawn from the machine once and mixed from there on (splitmix64).
class Sessions {
 public:
  std::uint64_t draw() noexcept {
    std::uint64_t z = 0;
    while (z == 0) {
      z = state_ += 0x9e3779b97f4a7c15;
      z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
      z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
      z ^= z >> 31;
    }
    return z;
  }

 private:
  static std::uint64_t random() {
    std::random_device device;
    return (std::uint64_t{device()} << 32) | device();
  }
  std::uint64_t state_ = random();
};

const char* name(Side side) {
  return side == Side::master ? "master" : "slave";
}

/// A sentence of bounded length that is built without allocating.
class Sentence {
 public:
  Sentence() = default;
  template <class... Args>
  explicit Sentence(const char* format, Args... args) {
    const int n = std::snprintf(text_.data(), text_.size(), format, args...);
    size_ = std::min(static_cast<std::size_t>(std::max(n, 0)), text_.size() - 1);
  }
  explicit Sentence(std::string_view text) : size_{std::min(text.size(), kMaxRefusal)} {
    std::copy_n(text.data(), size_, text_.data());
  }
  [[nodiscard]] std::string_view view() const { return {text_.data(), size_}; }
  [[nodiscard]] bool empty() const { return size_ == 0; }

 private:
  std::array<char, kMaxRefusal + 1> text_{};
  std::size_t size_ = 0;
};

/// Session numbers of the other side that are over: a packet of theirs still on its way must not bring them back.
class Retired {
 public:
  void add(std::uint64_t session) noexcept { sessions_[next_++ % sessions_.size()] = session; }
  [[nodiscard]] bool has(std::uint64_t session) const noexcept {
    return std::find(sessions_.begin(), sessions_.end(), session) != sessions_.end();
  }

 private:
  std::array<std::uint64_t, 8> sessions_{};
  std::size_t next_ = 0;
};

template <int N>
struct Arrival {
  Endpoint from;
  Decoded decoded = Decoded::malformed;
  bool refused = false;
  Envelope<N> envelope;
};

ImpairmentOptions without_blackouts(ImpairmentOptions options) {
  options.blackout.clear();
  return options;
}

std::optional<Endpoint> checked(std::optional<Endpoint> peer) {
  if (peer && (peer->port == 0 || peer->address == Endpoint{}.address))
    throw ConfigError("peer " + to_string(*peer) + ": address and port must both be given, as in 127.0.0.1:45001");
  return peer;
}

}  // namespace

template <int N>
struct UdpTransport<N>::Impl {
  Impl(const SessionOptions& o, UdpSocket s, std::optional<Endpoint> p)
      : options{o},
        socket{std::move(s)},
        given_peer{p},
        peer{p},
        session{sessions.draw()},
        offer{o.side == Side::master ? session : sessions.draw()},
        line{without_blackouts(o.incoming), o.impairment_seed, kBurst + packets_in_flight(o.incoming, o.peer_rate_hz)} {
    refusing.identity = identity();
    if (given_peer) socket.keep_to(*given_peer);
  }

  [[nodiscard]] Identity identity() const { return {N, options.peer_rate_hz, options.scene_digest, options.side}; }
  [[nodiscard]] static bool within(Duration span, std::optional<Duration> moment, Duration now) {
    return moment && now - *moment < span;
  }
  [[nodiscard]] bool peer_alive(Duration now) const { return within(kSilent, heard, now); }
  [[nodiscard]] bool ours(std::uint64_t number) const { return number == session || number == offer; }

  [[nodiscard]] bool blacked_out(Duration now) const noexcept;
  const Report<N>* judge(const Arrival<N>& arrival, Duration now) noexcept;
  const Report<N>* from_current(const Arrival<N>& arrival, Duration now) noexcept;
  void from_unknown(const Arrival<N>& arrival, Duration now) noexcept;
  [[nodiscard]] Sentence mismatch(const Arrival<N>& arrival) const noexcept;
  void refuse(const Arrival<N>& arrival, const Sentence& why, Duration now) noexcept;
  void stranger(const Arrival<N>& arrival, Duration now) noexcept;
  void greet(const Report<N>& report) noexcept;

  SessionOptions options;
  UdpSocket socket;
  std::optional<Endpoint> given_peer, peer;
  Sessions sessions;
  std::uint64_t session;
  std::uint64_t offer;  ///< our number for the next session: who returns it is there now. A master has one for all
  std::uint64_t peer_session = 0;
  Codec<N> codec;
  Arrival<N> arriving;
  DelayLine<Arrival<N>> line;
  Envelope<N> outgoing, refusing;

  struct Greeting {
    Endpoint to;
    std::uint64_t session;
  };
  std::optional<Greeting> greeting;     ///< a slave's answer to one that has introduced itself; with the next report
  std::optional<Arrival<N>> candidate;  ///< good, and waits for paired_anew
  Duration candidate_since{0};
  Retired retired;
  std::optional<Duration> heard;     ///< the current peer
  std::optional<Duration> returned;  ///< our session number by the current peer
  std::optional<Duration> first_paired;
  std::uint64_t pairings = 0;

  Sentence refusal, refusal_heard;
  bool refusal_due = false;
  std::optional<Duration> refusal_found, refusal_sent;
  std::uint64_t stranger_session = 0;
  Duration stranger_since{0};

  LinkCounts counts;
};

template <int N>
UdpTransport<N>::UdpTransport(const SessionOptions& options, UdpSocket socket, std::optional<Endpoint> peer)
    : impl_{std::make_unique<Impl>(options, std::move(socket), checked(peer))} {}
template <int N>
UdpTransport<N>::~UdpTransport() = default;
template <int N>
UdpTransport<N>::UdpTransport(UdpTransport&&) noexcept = default;
template <int N>
UdpTransport<N>& UdpTransport<N>::operator=(UdpTransport&&) noexcept = default;

// ---- in

template <int N>
bool UdpTransport<N>::Impl::blacked_out(Duration now) const noexcept {
  if (!first_paired) return false;
  const double t = to_seconds(now - *first_paired).si();
  return std::any_of(options.incoming.blackout.begin(), options.incoming.blackout.end(),
                     [t](const BlackoutWindow& w) { return t >= w.start_s && t < w.start_s + w.duration_s; });
}

template <int N>
void UdpTransport<N>::receive(Duration now) noexcept {
  Impl& s = *impl_;
  for (int i = 0; i < kMaxPerPoll; ++i) {
    const std::optional<ReceivedDatagram> datagram = s.socket.receive();
    if (!datagram) return;
    if (s.given_peer && datagram->from != *s.given_peer) {
      ++s.counts.rejected;
      continue;
    }
    s.arriving.from = datagram->from;
    s.arriving.decoded = s.codec.decode(datagram->bytes, s.arriving.envelope);
    if (s.arriving.decoded == Decoded::malformed) {
      ++s.counts.rejected;
      continue;
    }
    if (s.blacked_out(now)) {
      ++s.counts.lost;
      continue;
    }
    // The words of the newest refusal are kept beside the line: there is never more than one to tell.
    s.arriving.refused = !s.arriving.envelope.refusal.empty();
    if (s.arriving.refused && s.ours(s.arriving.envelope.peer_session))
      s.refusal_heard = Sentence{s.arriving.envelope.refusal};
    s.arriving.envelope.refusal = {};
    // It arrived before this tick, so that what is not delayed is read in it.
    s.line.put(s.arriving, now - Duration{1});
  }
}

template <int N>
const Report<N>* UdpTransport<N>::next(Duration now) noexcept {
  Impl& s = *impl_;
  if (s.refusal_found && now - *s.refusal_found >= kRefusalLinger) s.refusal_due = true;
  while (!s.candidate && !s.refusal_due) {
    const Arrival<N>* arrival = s.line.take(now);
    if (arrival == nullptr) return nullptr;
    if (const Report<N>* report = s.judge(*arrival, now)) return report;
  }
  return nullptr;
}

/// The report, when it is for the node.
template <int N>
const Report<N>* UdpTransport<N>::Impl::judge(const Arrival<N>& arrival, Duration now) noexcept {
  const Envelope<N>& e = arrival.envelope;
  if (arrival.refused) {
    // It must know our number: whoever has never heard us cannot refuse us.
    if (!ours(e.peer_session) || (peer && arrival.from != *peer)) {
      ++counts.rejected;
      return nullptr;
    }
    refusal = refusal_heard;
    refusal_due = true;
    return nullptr;
  }
  if (e.session == peer_session && peer && arrival.from == *peer) return from_current(arrival, now);
  from_unknown(arrival, now);
  return nullptr;
}

template <int N>
const Report<N>* UdpTransport<N>::Impl::from_current(const Arrival<N>& arrival, Duration now) noexcept {
  if (arrival.decoded != Decoded::ok) {
    ++counts.rejected;
    return nullptr;
  }
  heard = now;
  if (arrival.envelope.peer_session != session) {
    ++counts.handshake;
    return nullptr;
  }
  // A slave introduces itself until it has taken us up, and takes up only who introduces itself.
  if (options.side == Side::slave || !arrival.envelope.identity) returned = now;
  return refusal_found ? nullptr : &arrival.envelope.report;
}

template <int N>
void UdpTransport<N>::Impl::from_unknown(const Arrival<N>& arrival, Duration now) noexcept {
  const Envelope<N>& e = arrival.envelope;
  const bool introduces_itself = e.identity.has_value() || arrival.decoded == Decoded::other_version;
  if (!introduces_itself || e.session == session || e.session == peer_session) {
    ++counts.rejected;
    return;
  }
  const bool elsewhere = peer && arrival.from != *peer;
  const bool intrudes = elsewhere && peer_alive(now);
  const Sentence why = mismatch(arrival);
  if (!why.empty()) {
    ++counts.rejected;
    refuse(arrival, why, now);
    // Whom we are working with has not changed its mind.
    if (!intrudes && !refusal_found) {
      refusal = why;
      refusal_found = now;
    }
    return;
  }
  if (intrudes) return stranger(arrival, now);
  // A late packet of a session that is over. Only a master may still be living behind one, squeezed out by another.
  if (retired.has(e.session) && (options.side == Side::master || within(kGoneAfter, heard, now))) {
    ++counts.rejected;
    return;
  }
  // A packet that somebody has kept introduces itself like any other, but cannot know the number of now.
  const bool returns_offer = e.peer_session == offer;
  if (!returns_offer && options.side == Side::master) {
    ++counts.rejected;
    return;
  }
  ++counts.handshake;
  if (refusal_found) return;
  if (!returns_offer) {
    greeting = Greeting{arrival.from, e.session};
    return;
  }
  candidate = arrival;
  candidate_since = now;
}

/// Somebody else, who would do, while we are working.
template <int N>
void UdpTransport<N>::Impl::stranger(const Arrival<N>& arrival, Duration now) noexcept {
  ++counts.rejected;
  if (stranger_session != arrival.envelope.session) {
    stranger_session = arrival.envelope.session;
    stranger_since = now;
  } else if (now - stranger_since >= kTakenAfter) {
    refuse(arrival,
           Sentence{"the %s is taken: it is working with another %s", name(options.side),
                    name(arrival.envelope.identity->side)},
           now);
  }
}

/// What the two programs differ in, in words that are true on both sides.
template <int N>
Sentence UdpTransport<N>::Impl::mismatch(const Arrival<N>& arrival) const noexcept {
  const bool master = options.side == Side::master;
  const auto differ = [&](const char* format, auto mine, auto theirs) {
    return Sentence{format, master ? mine : theirs, master ? theirs : mine};
  };
  constexpr std::uint32_t kNumber = 0xffff;
  if (arrival.decoded == Decoded::other_version)
    return differ(
        "master and slave speak different protocols: version %u at the master, %u at the slave; install the "
        "same release of twoport on both",
        kProtocolVersion & kNumber, arrival.envelope.version & kNumber);
  const Identity& theirs = *arrival.envelope.identity;
  if (theirs.side == options.side)
    return Sentence{"both programs are a %s: a twoport-master needs the address of a twoport-slave", name(theirs.side)};
  if (theirs.dof != N)
    return differ("master and slave differ in dof: %d at the master, %d at the slave; start both with the same scene",
                  N, theirs.dof);
  if (theirs.rate_hz != options.rate_hz)
    return Sentence{
        "master and slave differ in the rate of the %s: it runs at %.9g Hz, the %s expects %.9g Hz; start "
        "both with the same scene",
        name(options.side), options.rate_hz, name(theirs.side), theirs.rate_hz};
  if (theirs.scene_digest != options.scene_digest)
    return differ("master and slave run different scenes: digest %016" PRIx64 " at the master, %016" PRIx64
                  " at the slave; start both with the same --scene and the same --set",
                  options.scene_digest, theirs.scene_digest);
  return {};
}

// ---- out

template <int N>
void UdpTransport<N>::Impl::refuse(const Arrival<N>& arrival, const Sentence& why, Duration now) noexcept {
  if (refusal_sent && now - *refusal_sent < kRefusalEvery) return;
  refusal_sent = now;
  refusing.session = session;
  refusing.peer_session = arrival.envelope.session;
  refusing.refusal = why.view();
  socket.send_to(codec.encode(refusing), arrival.from);
}

/// What a report of a session to come may say: the state, and no energy yet.
template <int N>
void UdpTransport<N>::Impl::greet(const Report<N>& report) noexcept {
  outgoing.session = offer;
  outgoing.peer_session = greeting->session;
  outgoing.report = report;
  outgoing.report.energy_in_j = 0.0;
  outgoing.report.echo_ns = -1;
  outgoing.identity = identity();
  socket.send_to(codec.encode(outgoing), greeting->to);
  greeting.reset();
}

template <int N>
void UdpTransport<N>::send(const Report<N>& report, Duration now) noexcept {
  Impl& s = *impl_;
  if (s.refusal_due) return;
  if (s.greeting) s.greet(report);
  if (!s.peer) {
    ++s.counts.unaddressed;
    return;
  }
  s.outgoing.session = s.session;
  s.outgoing.peer_session = s.peer_session;
  s.outgoing.report = report;
  s.outgoing.identity.reset();
  if (!coupled(now)) s.outgoing.identity = s.identity();
  s.socket.send_to(s.codec.encode(s.outgoing), *s.peer);
}

// ---- pairing

template <int N>
bool UdpTransport<N>::paired_anew() noexcept {
  Impl& s = *impl_;
  if (!s.candidate) return false;
  if (s.pairings > 0) s.retired.add(s.peer_session);
  // A master that comes back has kept its number: a new one of ours makes it, too, start its totals again.
  if (s.options.side == Side::slave) s.session = std::exchange(s.offer, s.sessions.draw());
  s.peer_session = s.candidate->envelope.session;
  s.peer = s.candidate->from;
  s.heard = s.candidate_since;
  s.returned.reset();
  if (!s.first_paired) s.first_paired = s.candidate_since;
  ++s.pairings;
  s.stranger_session = 0;
  s.candidate.reset();
  return true;
}

template <int N>
std::string_view UdpTransport<N>::refusal() const noexcept {
  return impl_->refusal_due ? impl_->refusal.view() : std::string_view{};
}
template <int N>
bool UdpTransport<N>::coupled(Duration now) const noexcept {
  return Impl::within(kSilent, impl_->returned, now);
}
template <int N>
std::optional<Duration> UdpTransport<N>::first_paired() const noexcept {
  return impl_->first_paired;
}
template <int N>
std::uint64_t UdpTransport<N>::pairings() const noexcept {
  return impl_->pairings;
}
template <int N>
std::optional<Endpoint> UdpTransport<N>::peer() const noexcept {
  return impl_->peer;
}
template <int N>
const Endpoint& UdpTransport<N>::local() const noexcept {
  return impl_->socket.local();
}
template <int N>
LinkCounts UdpTransport<N>::counts() const noexcept {
  LinkCounts counts = impl_->counts;
  counts.lost += impl_->line.lost();
  counts.overflowed = impl_->line.overflowed();
  counts.unsent = impl_->socket.unsent();
  return counts;
}

template class UdpTransport<1>;
template class UdpTransport<3>;
template class UdpTransport<6>;

}  // namespace twoport
