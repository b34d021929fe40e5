#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "common/link/impaired_socket.h"
#include "common/link/mailbox.h"
#include "common/platform/random.h"
#include "common/platform/udp.h"
#include "common/wire/link_transport.h"
#include "tests/support/no_alloc.h"

namespace twoport::session_test {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr Duration kTick = 1ms;

Endpoint loopback(std::uint16_t port = 0) {
  Endpoint e = parse_endpoint("127.0.0.1:0", "test");
  e.port = port;
  return e;
}

struct PartyOptions : SessionOptions {
  ImpairmentOptions incoming;
  std::uint64_t seed = 1;
};

PartyOptions options(Side side) {
  PartyOptions o;
  o.side = side;
  o.rate_hz = side == Side::master ? 1000.0 : 2000.0;
  o.peer_rate_hz = side == Side::master ? 2000.0 : 1000.0;
  o.scene_digest = 0xabcdef;
  o.seed = side == Side::master ? 11 : 12;
  return o;
}
const PartyOptions kMaster = options(Side::master);
const PartyOptions kSlave = options(Side::slave);

/// One program, as far as its link goes: a mailbox, and a node that says where it is and what energy it has taken in.
template <int N>
struct Party {
  explicit Party(const PartyOptions& o, const Endpoint& local = loopback(), std::optional<Endpoint> peer = {})
      : udp{peer ? UdpSocket{local, *peer} : UdpSocket{local}},
        network{udp, {.incoming = o.incoming, .seed = o.seed, .peer_rate_hz = o.peer_rate_hz, .peer = peer}},
        mail{LinkTransport<N>{network, with(o, peer), system_random}} {}

  static SessionOptions with(SessionOptions o, std::optional<Endpoint> peer) {
    o.peer = peer;
    return o;
  }
  LinkTransport<N>& link() { return mail.transport(); }
  const Endpoint& local() const { return udp.local(); }

  void tick(Duration now) {
    if (listens && link().take_new_session()) {
      mail.reset(link().handshake().session_since());
      energy = 0.0;
      ++rebased;
    }
    const PeerState<N>& known = mail.collect(now);
    if (known.is_new) ++fresh;
    seen = known;
    most_energy_seen = std::max(most_energy_seen, known.energy_in_j);
    Report<N> r;
    r.v = Velocity<N>{Velocity<N>::Vector::Constant(speed)};
    r.energy_in_j = energy;
    r.mode = Mode::coupled;
    mail.post(r, now);
  }

  UdpSocket udp;
  ImpairedSocket network;
  Mailbox<N, LinkTransport<N>> mail;
  PeerState<N> seen;
  bool listens = true;
  double speed = 0.0, energy = 0.0, most_energy_seen = 0.0;
  int rebased = 0, fresh = 0;
};

template <int N>
std::unique_ptr<Party<N>> slave(const PartyOptions& o = kSlave, std::uint16_t port = 0) {
  return std::make_unique<Party<N>>(o, loopback(port));
}
template <int N, int M>
std::unique_ptr<Party<N>> master(Party<M>& to, const PartyOptions& o = kMaster) {
  return std::make_unique<Party<N>>(o, loopback(), to.local());
}

/// Both programs' time, in step. A datagram needs real time as well: where it is waited for, wait in that.
class Session : public ::testing::Test {
 protected:
  template <class... Parties>
  void run(int ticks, Parties&... parties) {
    for (int k = 0; k < ticks; ++k) {
      now_ += kTick;
      (parties.tick(now_), ...);
    }
  }
  template <class Done, class... Parties>
  [[nodiscard]] bool until(Done done, Parties&... parties) {
    for (const auto end = Clock::now() + 10s; Clock::now() < end && !done();) run(1, parties...);
    return done();
  }
  template <int N, int M>
  [[nodiscard]] bool coupled(Party<N>& a, Party<M>& b) {
    return until(
        [&] { return a.seen.has_report && b.seen.has_report && a.link().coupled(now_) && b.link().coupled(now_); }, a,
        b);
  }

  Duration now_{0};
};

TEST_F(Session, PairsInBandAndDelivers) {
  auto s = slave<3>();
  auto m = master<3>(*s);
  m->speed = 0.25;
  s->speed = -1.5;
  ASSERT_TRUE(coupled(*m, *s));
  run(10, *m, *s);
  EXPECT_EQ(s->seen.newest.v[2], 0.25);
  EXPECT_EQ(m->seen.newest.v[0], -1.5);
  EXPECT_GE(m->seen.round_trip(), Duration{0});
  EXPECT_EQ(m->rebased, 1);
  EXPECT_EQ(s->rebased, 1);
  EXPECT_EQ(s->link().handshake().peer(), m->local());
  EXPECT_EQ(m->link().counts().rejected.total() + s->link().counts().rejected.total(), 0U);
  EXPECT_TRUE(m->link().reject_reason().empty());
  ASSERT_TRUE(s->link().handshake().first_paired());
  EXPECT_LE(*s->link().handshake().first_paired(), now_);
}

TEST_F(Session, PairsInEverySize) {
  const auto pairs = [&]<int N>(std::integral_constant<int, N>) {
    auto s = slave<N>();
    auto m = master<N>(*s);
    return coupled(*m, *s);
  };
  EXPECT_TRUE(pairs(std::integral_constant<int, 1>{}));
  EXPECT_TRUE(pairs(std::integral_constant<int, 6>{}));
}

TEST_F(Session, DeliversNothingUntilTheNodeIsRebased) {
  auto s = slave<1>();
  auto m = master<1>(*s);
  s->listens = false;
  s->energy = 7.0;
  run(50, *m, *s);
  EXPECT_FALSE(s->seen.has_report);
  const std::uint64_t handshake = s->link().counts().handshake;
  run(50, *m, *s);
  EXPECT_EQ(s->link().counts().handshake, handshake);  // nothing is passed over meanwhile
  EXPECT_EQ(m->most_energy_seen, 0.0);                 // and the slave has not spoken with totals of before
  s->listens = true;
  EXPECT_TRUE(coupled(*m, *s));
  EXPECT_EQ(m->most_energy_seen, 0.0);
  EXPECT_EQ(m->rebased, 1);
}

TEST_F(Session, TakesUpAMasterThatStartsAgainAndForgetsItsTotals) {
  auto s = slave<1>();
  auto m = master<1>(*s);
  ASSERT_TRUE(coupled(*m, *s));
  m->energy = 5.0;
  s->energy = 7.0;
  ASSERT_TRUE(until([&] { return s->seen.energy_in_j == 5.0 && m->seen.energy_in_j == 7.0; }, *m, *s));

  m = master<1>(*s);  // another port
  ASSERT_TRUE(until([&] { return s->rebased == 2; }, *m, *s));
  s->most_energy_seen = 0.0;
  ASSERT_TRUE(coupled(*m, *s));
  run(50, *m, *s);
  EXPECT_EQ(m->most_energy_seen, 0.0);  // never heard the 7 J of the session before
  EXPECT_EQ(s->most_energy_seen, 0.0);
  EXPECT_EQ(m->rebased, 1);
  EXPECT_EQ(s->link().pairings(), 2U);
}

TEST_F(Session, TakesUpASlaveThatStartsAgainOnItsPort) {
  auto s = slave<1>();
  const std::uint16_t port = s->local().port;
  auto m = master<1>(*s);
  ASSERT_TRUE(coupled(*m, *s));
  m->energy = 5.0;
  run(10, *m, *s);
  s.reset();
  run(20, *m);
  s = slave<1>(kSlave, port);
  ASSERT_TRUE(until([&] { return m->rebased == 2 && s->seen.has_report && m->link().coupled(now_); }, *m, *s));
  run(50, *m, *s);
  EXPECT_EQ(s->most_energy_seen, 0.0);
  EXPECT_EQ(s->rebased, 1);
  EXPECT_EQ(m->rebased, 2);
}

TEST_F(Session, DropsReportsOfASessionThatIsOverWhenTheyComeDue) {
  PartyOptions late = kSlave;
  late.incoming.delay_s = 0.5;
  auto s = slave<1>(late);
  auto m = master<1>(*s);
  ASSERT_TRUE(coupled(*m, *s));
  run(600, *m, *s);
  m->energy = 5.0;
  run(300, *m, *s);  // on their way
  ASSERT_EQ(s->most_energy_seen, 0.0);
  // The slave hears the old master for half a second more, then the new one.
  m = master<1>(*s);
  ASSERT_TRUE(until([&] { return s->rebased == 2; }, *m, *s));
  const double before = s->most_energy_seen;
  EXPECT_EQ(before, 5.0);
  s->most_energy_seen = 0.0;
  ASSERT_TRUE(coupled(*m, *s));
  run(2000, *m, *s);
  EXPECT_EQ(s->most_energy_seen, 0.0);
  EXPECT_EQ(s->rebased, 2);
}

/// A master made by hand, so that all it says can be kept.
struct HandMade {
  HandMade() {
    words.session = 42;
    words.identity = Identity{1, 2000.0, 0xabcdef, Side::master};
  }
  void talk(const Endpoint& to) {
    ++words.report.sequence;
    socket.send(codec.encode(words), to, Duration{0});
    Envelope<1> got;
    while (const auto datagram = socket.receive(Duration{0}))
      if (codec.decode(datagram->bytes, got) == Decoded::ok) words.peer_session = got.session;
  }

  UdpSocket socket{loopback()};
  Codec<1> codec;
  Envelope<1> words;
};

TEST_F(Session, KeptWordsOfASessionThatIsOverStartNothing) {
  auto s = slave<1>();
  const Endpoint there = s->local();
  HandMade first;
  ASSERT_TRUE(until(
      [&] {
        first.talk(there);
        return s->seen.has_report;
      },
      *s));
  run(200, *s);
  auto m = master<1>(*s);
  ASSERT_TRUE(until([&] { return s->rebased == 2 && s->seen.has_report; }, *m, *s));
  // Said again word for word, first beside the session of now, then in silence for as long as one likes.
  const auto say_again = [&] { first.socket.send(first.codec.encode(first.words), there, Duration{0}); };
  for (int k = 0; k < 500; ++k) {
    say_again();
    run(1, *m, *s);
  }
  EXPECT_TRUE(s->link().coupled(now_));
  m.reset();
  for (int k = 0; k < 3000; ++k) {
    say_again();
    run(1, *s);
  }
  EXPECT_EQ(s->rebased, 2);
  m = master<1>(*s);
  ASSERT_TRUE(until([&] { return s->rebased == 3 && s->seen.has_report && m->seen.has_report; }, *m, *s));
}

TEST_F(Session, ASlavesKeptWordsDoNotBringAnOldSessionBack) {
  UdpSocket socket{loopback()};
  auto m = std::make_unique<Party<1>>(kMaster, loopback(), socket.local());
  Codec<1> codec;
  Envelope<1> heard, words;
  words.identity = Identity{1, 1000.0, 0xabcdef, Side::slave};
  words.report.sequence = 1;
  const auto say_as = [&](std::uint64_t session) {
    while (const auto datagram = socket.receive(Duration{0}))
      if (codec.decode(datagram->bytes, heard) == Decoded::ok) words.peer_session = heard.session;
    words.session = session;
    socket.send(codec.encode(words), m->local(), Duration{0});
  };
  for (std::uint64_t session : {71U, 72U}) {
    const int before = m->rebased;
    ASSERT_TRUE(until(
        [&] {
          say_as(session);
          return m->rebased > before && m->link().pairings() + 70 == session;
        },
        *m));
  }
  const std::uint64_t rejected = m->link().counts().rejected.total();
  for (int k = 0; k < 3000; ++k) {
    say_as(71);
    run(1, *m);
  }
  EXPECT_GT(m->link().counts().rejected.total(), rejected + 1000);
  EXPECT_EQ(m->rebased, 2);
}

TEST_F(Session, PairsWithinAFewRoundTrips) {
  for (double delay : {0.0, 0.020}) {
    PartyOptions late_m = kMaster, late_s = kSlave;
    late_m.incoming.delay_s = late_s.incoming.delay_s = delay;
    auto s = slave<3>(late_s);
    auto m = master<3>(*s, late_m);
    m->energy = s->energy = 9.0;  // of before: said in greetings, and not of the session
    const Duration begin = now_;
    ASSERT_TRUE(coupled(*m, *s));
    EXPECT_LE(now_ - begin, 20ms + 5 * to_duration(delay));
    run(200, *m, *s);
    EXPECT_EQ(m->link().counts().rejected.total() + s->link().counts().rejected.total(), 0U) << delay;
    EXPECT_EQ(s->most_energy_seen, 0.0) << delay;
    EXPECT_EQ(m->most_energy_seen, 0.0) << delay;
  }
}

// A slave that nobody has accepted yet answers introductions, not every tick.
TEST_F(Session, OfAMasterThatIsSlowerLosesNothingBetweenGreetings) {
  PartyOptions far_m = kMaster, far_s = kSlave;
  far_m.incoming.delay_s = far_s.incoming.delay_s = 0.020;
  auto s = slave<3>(far_s);
  auto m = master<3>(*s, far_m);
  for (int k = 0; k < 400; ++k) {
    run(1, *s);
    if (k % 2 == 0) m->tick(now_);
  }
  EXPECT_TRUE(m->link().coupled(now_) && s->link().coupled(now_));
  EXPECT_GT(m->mail.counts().received, 300U);
  EXPECT_EQ(m->mail.counts().lost, 0U);
  EXPECT_EQ(s->mail.counts().lost, 0U);
}

/// A network that is not there yet.
class Cut final : public DatagramSocket {
 public:
  explicit Cut(DatagramSocket& below) : below_{&below} {}
  bool send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept override {
    if (whole) return below_->send(bytes, to, now);
    ++unsent_;
    return false;
  }
  std::optional<ReceivedDatagram> receive(Duration now) noexcept override { return below_->receive(now); }
  [[nodiscard]] const Endpoint& local() const noexcept override { return below_->local(); }
  [[nodiscard]] SocketCounts counts() const noexcept override { return {.unsent = unsent_}; }
  bool whole = false;

 private:
  DatagramSocket* below_;
  std::uint64_t unsent_ = 0;
};

TEST_F(Session, CountsReportsThatCouldNotBeSentAndNoAnswers) {
  UdpSocket udp{loopback()};
  Cut cut{udp};
  Mailbox<3, LinkTransport<3>> mail{LinkTransport<3>{cut, Party<3>::with(kSlave, {}), system_random}};
  LinkTransport<3>& link = mail.transport();
  Party<3> m{kMaster, loopback(), udp.local()};
  const auto tick = [&](int ticks) {
    for (int k = 0; k < ticks; ++k) {
      run(1, m);
      if (link.take_new_session()) mail.reset(link.handshake().session_since());
      mail.collect(now_);
      mail.post(PortReport<3>{}, now_);
    }
  };
  tick(50);
  EXPECT_EQ(link.counts().unaddressed, 50U);
  EXPECT_EQ(link.counts().unsent, 0U) << "greetings are no reports";
  cut.whole = true;
  tick(50);
  ASSERT_TRUE(link.coupled(now_));
  EXPECT_EQ(link.counts().unsent, 0U);
  cut.whole = false;
  tick(7);
  EXPECT_EQ(link.counts().unsent, 7U);
}

/// Of programs that hold the key both say the same; without a key one says it, and the other at least that they differ.
template <int N, int M>
void expect_both_refuse(Party<N>& m, Party<M>& s, const std::string& words, Duration& now, bool told = true) {
  const auto end = Clock::now() + 10s;
  while (Clock::now() < end && (m.link().reject_reason().empty() || s.link().reject_reason().empty())) {
    now += kTick;
    m.tick(now);
    s.tick(now);
  }
  const auto says = [&](std::string_view reason) { return reason.find(words) != reason.npos; };
  if (told) {
    EXPECT_EQ(m.link().reject_reason(), s.link().reject_reason());
    EXPECT_TRUE(says(m.link().reject_reason())) << m.link().reject_reason();
  } else {
    EXPECT_TRUE(says(m.link().reject_reason()) || says(s.link().reject_reason())) << m.link().reject_reason();
  }
  EXPECT_TRUE(is_mismatch(m.link().reject_reason())) << m.link().reject_reason();
  EXPECT_TRUE(is_mismatch(s.link().reject_reason())) << s.link().reject_reason();
  EXPECT_FALSE(m.seen.has_report);
  EXPECT_FALSE(s.seen.has_report);
}

PartyOptions with_key(PartyOptions o, bool key) {
  o.tells_reasons = key;
  return o;
}

class Refusal : public Session, public ::testing::WithParamInterface<bool> {
 protected:
  PartyOptions of_master_ = with_key(kMaster, GetParam()), of_slave_ = with_key(kSlave, GetParam());

  template <int N, int M>
  void expect_refusal(const std::string& words) {
    auto s = slave<M>(of_slave_);
    auto m = master<N>(*s, of_master_);
    expect_both_refuse(*m, *s, words, now_, GetParam());
  }
};
INSTANTIATE_TEST_SUITE_P(WithAndWithoutKey, Refusal, ::testing::Bool(),
                         [](const auto& instance) { return instance.param ? "WithKey" : "WithoutKey"; });

TEST_P(Refusal, OfOtherDof) {
  expect_refusal<1, 3>("differ in dof: 1 at the master, 3 at the slave");
}

TEST_P(Refusal, OfAnotherScene) {
  of_slave_.scene_digest = 0x123;
  expect_refusal<3, 3>("different scenes: digest 0000000000abcdef at the master, 0000000000000123 at the slave");
}

TEST_P(Refusal, NamesTheFieldsThatDiffer) {
  for (PartyOptions* each : {&of_master_, &of_slave_}) each->scene_field_names = {"dof", "one.field", "another"};
  of_master_.scene_fields = "aabbcc";
  of_slave_.scene_fields = "aaBbcd";
  of_slave_.scene_digest = 0x123;
  expect_refusal<3, 3>("different scenes: they differ in one.field, another; start both");
  // Of another number of fields nothing is known.
  of_slave_.scene_fields = "aabb";
  expect_refusal<3, 3>("different scenes: digest");
}

TEST_P(Refusal, OfARateThatTheSlaveDoesNotHave) {
  of_slave_.rate_hz = 500.0;
  expect_refusal<3, 3>("rate of the slave: it runs at 500 Hz, the master expects 2000 Hz");
}

TEST_P(Refusal, OfARateThatOnlyTheMasterCanFindOut) {
  of_slave_.peer_rate_hz = 250.0;
  expect_refusal<3, 3>("rate of the master: it runs at 1000 Hz, the slave expects 250 Hz");
}

TEST_P(Refusal, OfTwoMasters) {
  of_slave_ = of_master_;
  of_slave_.rate_hz = 2000.0;
  expect_refusal<3, 3>("both programs are a master");
}

TEST_F(Session, ARefusalTellsAStrangerNothing) {
  auto s = slave<3>();
  UdpSocket stranger{loopback()};
  Codec<3> codec;
  Envelope<3> hello, answer;
  hello.session = 99;
  hello.identity = Identity{1, 123.0, 0x123, Side::master, {}};
  hello.report.sequence = 1;
  std::string told;
  const auto talk = [&] {
    // A master of one degree of freedom: what its report holds does not matter any more.
    Codec<1> small;
    Envelope<1> of_one;
    static_cast<Header&>(of_one) = hello;
    of_one.report.sequence = 1;
    stranger.send(small.encode(of_one), s->local(), Duration{0});
    while (const auto datagram = stranger.receive(Duration{0})) {
      EXPECT_EQ(codec.decode(datagram->bytes, answer), Decoded::ok);
      EXPECT_FALSE(answer.identity);
      EXPECT_NE(answer.session, s->link().handshake().header(now_).session);
      told = answer.refusal;
    }
    return !told.empty();
  };
  ASSERT_TRUE(until(talk, *s));
  EXPECT_EQ(told, mismatch_without_reason(Side::slave).view());
  EXPECT_EQ(told.find_first_of("0123456789"), told.npos) << "no rate, size, digest or version";
  // And it ends nobody: the source may be forged.
  run(2000, *s);
  EXPECT_EQ(s->link().reject_reason(), "");
  auto m = master<3>(*s);
  EXPECT_TRUE(coupled(*m, *s));
}

TEST_F(Session, BothRefuseAnotherVersion) {
  auto s = slave<3>();
  UdpSocket future{loopback()};
  Codec<3> codec;
  Envelope<3> hello, answer;
  hello.version = kProtocolVersion + 1;
  hello.session = 99;
  hello.report.sequence = 1;
  std::string told;
  const auto talk = [&] {
    future.send(codec.encode(hello), s->local(), Duration{0});
    while (const auto datagram = future.receive(Duration{0})) {
      EXPECT_EQ(codec.decode(datagram->bytes, answer), Decoded::ok);
      EXPECT_EQ(answer.peer_session, 99U);
      told = answer.refusal;
    }
    if (told.empty()) return false;
    // A program that was there to hear the refusal returns its number.
    Envelope<3> understood;
    static_cast<Header&>(understood) = hello;
    understood.identity.reset();
    understood.peer_session = answer.session;
    understood.refusal = told;
    future.send(codec.encode(understood), s->local(), Duration{0});
    return !s->link().reject_reason().empty();
  };
  ASSERT_TRUE(until(talk, *s));
  EXPECT_EQ(told, mismatch_without_reason(Side::slave).view());
  constexpr std::uint32_t kMine = kProtocolVersion & 0xffff;
  const std::string versions =
      "version " + std::to_string(kMine + 1) + " at the master, " + std::to_string(kMine) + " at the slave";
  EXPECT_NE(s->link().reject_reason().find(versions), std::string::npos) << s->link().reject_reason();

  // And the other way round: a refusal by another version is understood.
  s = slave<3>();
  auto m = std::make_unique<Party<3>>(kMaster, loopback(), future.local());
  const auto refuse = [&] {
    while (const auto datagram = future.receive(Duration{0})) {
      if (datagram->from != m->local()) continue;
      codec.decode(datagram->bytes, answer);
      Envelope<3> refusal;
      refusal.version = kProtocolVersion + 1;
      refusal.session = 99;
      refusal.peer_session = answer.session;
      refusal.refusal = "version 2 here";
      future.send(codec.encode(refusal), datagram->from, Duration{0});
    }
    return !m->link().reject_reason().empty();
  };
  ASSERT_TRUE(until(refuse, *m));
  EXPECT_EQ(m->link().reject_reason(), "version 2 here");
}

TEST_F(Session, ARefusalFromWhoDoesNotKnowUsIsNoRefusal) {
  auto s = slave<1>();
  auto m = master<1>(*s);
  ASSERT_TRUE(coupled(*m, *s));
  UdpSocket liar{loopback()};
  Codec<1> codec;
  Envelope<1> lie;
  lie.session = 5;
  lie.peer_session = 6;
  lie.refusal = "go away";
  const std::uint64_t before = s->link().counts().rejected.total();
  liar.send(codec.encode(lie), s->local(), Duration{0});
  ASSERT_TRUE(until([&] { return s->link().counts().rejected.total() > before; }, *m, *s));
  run(1000, *m, *s);
  EXPECT_TRUE(s->link().reject_reason().empty());
  EXPECT_TRUE(s->link().coupled(now_));
}

TEST_F(Session, CountsAndDropsStrayDatagrams) {
  auto s = slave<3>();
  auto m = master<3>(*s);
  ASSERT_TRUE(coupled(*m, *s));
  // What the slave takes for its master's words: the master's own, seen by another socket.
  UdpSocket spy{loopback()};
  Codec<3> codec;
  Envelope<3> forged;
  {
    auto copy = Party<3>{kMaster, loopback(), spy.local()};
    copy.tick(now_);
    std::optional<ReceivedDatagram> seen;
    for (const auto end = Clock::now() + 5s; !seen && Clock::now() < end;) seen = spy.receive(Duration{0});
    ASSERT_TRUE(seen);
    ASSERT_EQ(codec.decode(seen->bytes, forged), Decoded::ok);
  }
  std::mt19937_64 rng{17};
  const std::uint64_t before = s->link().counts().rejected.total();
  for (int k = 0; k < 100; ++k) {
    std::vector<std::byte> noise(rng() % 1400);
    for (std::byte& b : noise) b = static_cast<std::byte>(rng());
    spy.send(noise, s->local(), Duration{0});
    spy.send(noise, m->local(), Duration{0});
    forged.identity.reset();  // no greeting: it claims to be in session
    forged.report.energy_in_j = 1e6;
    spy.send(codec.encode(forged), s->local(), Duration{0});
    spy.send(codec.encode(forged), m->local(), Duration{0});
    run(1, *m, *s);
  }
  ASSERT_TRUE(until([&] { return s->link().counts().rejected.total() >= before + 200; }, *m, *s));
  EXPECT_EQ(s->link().counts().rejected.total(), before + 200);
  EXPECT_EQ(m->link().counts().rejected.total(), 0U);  // a master's socket takes nothing from others
  EXPECT_EQ(s->most_energy_seen, 0.0);
  EXPECT_EQ(m->most_energy_seen, 0.0);
  EXPECT_EQ(s->rebased, 1);
  EXPECT_TRUE(m->link().coupled(now_));
  EXPECT_TRUE(s->link().reject_reason().empty());
}

TEST_F(Session, AMastersOwnPeerMayTalkNonsense) {
  UdpSocket peer{loopback()};
  auto m = std::make_unique<Party<1>>(kMaster, loopback(), peer.local());
  const std::vector<std::byte> noise(100, std::byte{0x5a});
  ASSERT_TRUE(until(
      [&] {
        peer.send(noise, m->local(), Duration{0});
        return m->link().counts().rejected.total() > 10;
      },
      *m));
  EXPECT_TRUE(m->link().reject_reason().empty());
}

TEST_F(Session, TheRightNumbersFromTheWrongAddressAreRejected) {
  auto s = slave<1>();
  const Endpoint there = s->local();
  HandMade real;
  UdpSocket thief{loopback()};
  ASSERT_TRUE(until(
      [&] {
        real.talk(there);
        return s->seen.has_report;
      },
      *s));
  real.words.identity.reset();
  real.words.report.energy_in_j = 3.0;
  const std::uint64_t before = s->link().counts().rejected.total();
  ++real.words.report.sequence;
  thief.send(real.codec.encode(real.words), there, Duration{0});
  ASSERT_TRUE(until([&] { return s->link().counts().rejected.total() > before; }, *s));
  EXPECT_EQ(s->most_energy_seen, 0.0);
  ASSERT_TRUE(until(
      [&] {
        real.talk(there);
        return s->most_energy_seen == 3.0;
      },
      *s));
}

TEST_F(Session, PairsThroughHeavyLoss) {
  PartyOptions lossy_m = kMaster, lossy_s = kSlave;
  lossy_m.incoming.loss = lossy_s.incoming.loss = 0.9;
  auto s = slave<3>(lossy_s);
  auto m = master<3>(*s, lossy_m);
  run(3, *m, *s);
  EXPECT_FALSE(m->seen.has_report && s->seen.has_report);  // with these seeds the first ones are lost
  ASSERT_TRUE(until([&] { return m->seen.has_report && s->seen.has_report; }, *m, *s));
  run(2000, *m, *s);
  EXPECT_GT(m->link().counts().lost, 1500U);
  EXPECT_GT(m->fresh, 100);
  EXPECT_EQ(m->rebased, 1);
  EXPECT_EQ(s->rebased, 1);
}

TEST_F(Session, DelaysWhatComesInByTheSceneAndNoMore) {
  PartyOptions late_m = kMaster, late_s = kSlave;
  late_m.incoming.delay_s = 0.030;
  late_s.incoming.delay_s = 0.020;
  auto s = slave<1>(late_s);
  auto m = master<1>(*s, late_m);
  ASSERT_TRUE(coupled(*m, *s));
  run(100, *m, *s);
  const Duration trip = m->seen.round_trip();
  EXPECT_GE(trip, 50ms);
  EXPECT_LE(trip, 52ms);
}

TEST_F(Session, WithoutImpairmentNoTickIsLostInTheLine) {
  auto s = slave<1>();
  auto m = master<1>(*s);
  ASSERT_TRUE(coupled(*m, *s));
  run(100, *m, *s);
  // The master posts and the slave collects in the same tick; the answer is read one tick on.
  EXPECT_EQ(m->seen.round_trip(), kTick);
}

TEST_F(Session, BlackoutsCountFromTheFirstPairing) {
  PartyOptions dark = kSlave;
  dark.incoming.blackout = {{0.5, 0.25}};
  auto s = slave<1>(dark);
  run(600, *s);  // nobody there: the scene has not begun
  auto m = master<1>(*s);
  ASSERT_TRUE(coupled(*m, *s));
  const Duration begin = *s->link().handshake().first_paired();
  std::vector<Duration> dark_ticks;
  while (now_ - begin < 1s) {
    const int before = s->fresh;
    run(1, *m, *s);
    if (s->fresh == before) dark_ticks.push_back(now_ - begin);
  }
  ASSERT_EQ(dark_ticks.size(), 250U);
  EXPECT_EQ(dark_ticks.front(), 500ms);
  EXPECT_EQ(dark_ticks.back(), 749ms);
  EXPECT_EQ(s->link().counts().lost, 250U);
  EXPECT_EQ(s->rebased, 1);
}

TEST_F(Session, ASecondMasterIsToldThatTheSlaveIsTaken) {
  auto s = slave<1>();
  auto m = master<1>(*s);
  ASSERT_TRUE(coupled(*m, *s));
  auto second = master<1>(*s);
  run(900, *m, *s, *second);
  EXPECT_TRUE(second->link().reject_reason().empty());
  ASSERT_TRUE(until([&] { return !second->link().reject_reason().empty(); }, *m, *s, *second));
  EXPECT_EQ(second->link().reject_reason(), "the slave is busy: it has a session with another master");
  EXPECT_EQ(s->rebased, 1);
  EXPECT_TRUE(s->link().reject_reason().empty());
  EXPECT_TRUE(m->link().coupled(now_));
}

TEST_F(Session, AStrangerWithAnotherSceneDoesNotStopThePair) {
  auto s = slave<1>();
  auto m = master<1>(*s);
  ASSERT_TRUE(coupled(*m, *s));
  PartyOptions other = kMaster;
  other.scene_digest = 1;
  auto stranger = master<1>(*s, other);
  ASSERT_TRUE(until([&] { return !stranger->link().reject_reason().empty(); }, *m, *s, *stranger));
  run(1000, *m, *s);
  EXPECT_TRUE(s->link().reject_reason().empty());
  EXPECT_TRUE(s->link().coupled(now_));
  EXPECT_EQ(s->rebased, 1);
}

TEST_F(Session, AMasterThatWasSqueezedOutAndComesBackStartsItsTotalsAgain) {
  auto s = slave<1>();
  auto m = master<1>(*s);
  ASSERT_TRUE(coupled(*m, *s));
  run(200, *s);  // the master hangs, and another takes its place
  auto second = master<1>(*s);
  ASSERT_TRUE(coupled(*second, *s));
  m->energy = 5.0;
  s->energy = 7.0;
  run(100, *second, *s);
  second.reset();
  s->most_energy_seen = 0.0;
  ASSERT_TRUE(until([&] { return m->rebased == 2; }, *m, *s));
  m->most_energy_seen = 0.0;
  ASSERT_TRUE(coupled(*m, *s));
  run(100, *m, *s);
  EXPECT_EQ(s->rebased, 3);
  EXPECT_EQ(m->rebased, 2);
  EXPECT_EQ(s->most_energy_seen, 0.0);
  EXPECT_EQ(m->most_energy_seen, 0.0);
}

TEST_F(Session, DoesNotAllocate) {
  PartyOptions rough_m = kMaster, rough_s = kSlave;
  for (PartyOptions* o : {&rough_m, &rough_s}) {
    o->incoming.delay_s = 0.010;
    o->incoming.jitter_s = 0.003;
    o->incoming.loss = 0.05;
    o->incoming.duplicate = 0.05;
  }
  auto s = slave<6>(rough_s);
  auto m = master<6>(*s, rough_m);
  UdpSocket stray{loopback()};
  const std::vector<std::byte> noise(300, std::byte{0x5a});
  ASSERT_TRUE(coupled(*m, *s));
  run(100, *m, *s);
  const int fresh = m->fresh;
  const NoAlloc guard;
  for (int k = 0; k < 1000; ++k) {
    if (k % 10 == 0) stray.send(noise, s->local(), Duration{0});
    run(1, *m, *s);
  }
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_GT(m->fresh, fresh + 200);
}

TEST_F(Session, DoesNotAllocateWhenThePeerStartsAgain) {
  auto s = slave<6>();
  auto m = master<6>(*s);
  ASSERT_TRUE(coupled(*m, *s));
  m.reset();
  run(200, *s);
  m = master<6>(*s);
  const NoAlloc guard;
  bool again = until([&] { return s->rebased == 2 && m->seen.has_report; }, *m, *s);
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_TRUE(again);
}

// As two programs have it: each side in a thread of its own, in real time.
TEST(SessionThreads, TwoCyclesTalk) {
  auto s = slave<3>();
  auto m = master<3>(*s);
  std::atomic<bool> done{false};
  const auto cycle = [&](Party<3>& p) {
    const auto start = Clock::now();
    while (!done.load()) {
      p.tick(std::chrono::duration_cast<Duration>(Clock::now() - start));
      if (p.fresh > 200 && &p == m.get()) done.store(true);
      if (Clock::now() - start > 20s) done.store(true);
      std::this_thread::yield();
    }
  };
  std::thread other{[&] { cycle(*s); }};
  cycle(*m);
  other.join();
  EXPECT_GT(m->fresh, 200);
  EXPECT_GT(s->fresh, 0);
  EXPECT_EQ(m->rebased, 1);
}

}  // namespace
}  // namespace twoport::session_test
