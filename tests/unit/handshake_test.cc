#include "common/wire/handshake.h"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>
#include <random>
#include <string>
#include <utility>

#include "tests/support/memory_network.h"
#include "tests/support/no_alloc.h"

namespace twoport::handshake_test {
namespace {

using namespace std::chrono_literals;
using Action = Handshake::Action;

constexpr int kDof = 3;
constexpr std::uint64_t kScene = 0xabcdef;

const Endpoint kSlaveAt = MemoryNetwork::address(1, 45000);
const Endpoint kMasterAt = MemoryNetwork::address(2, 50000);
const Endpoint kElsewhere = MemoryNetwork::address(3, 50000);

/// from, from + 1, from + 2 and so on.
SessionNumbers counting(std::uint64_t from) {
  return [next = from]() mutable { return next++; };
}
Handshake master(std::uint64_t numbers_from = 1000, std::uint64_t scene = kScene) {
  return {{.side = Side::master, .scene_digest = scene, .peer = kSlaveAt}, kDof, counting(numbers_from)};
}
Handshake slave(std::uint64_t numbers_from = 2000, bool key = false) {
  return {{.side = Side::slave, .scene_digest = kScene, .tells_reasons = key}, kDof, counting(numbers_from)};
}

/// A slave and a master at kMasterAt that have just taken each other up.
struct Pair {
  Handshake s, m = master();
  Duration now{0};

  explicit Pair(bool key = false) : s{slave(2000, key)} {
    EXPECT_EQ(s.on(m.header(now), Decoded::ok, kMasterAt, now), Action::reply);
    const auto greeting = s.take_greeting();
    EXPECT_EQ(m.on(greeting->header, Decoded::ok, kSlaveAt, now), Action::pair);
    EXPECT_TRUE(m.take_new_session());
    EXPECT_EQ(s.on(m.header(now), Decoded::ok, kMasterAt, now), Action::pair);
    EXPECT_TRUE(s.take_new_session());
    talk(3);
    EXPECT_TRUE(s.coupled(now) && m.coupled(now));
  }
  /// Packets both ways, each millisecond.
  void talk(int ms) {
    for (int k = 0; k < ms; ++k) {
      now += 1ms;
      EXPECT_EQ(s.on(m.header(now), Decoded::ok, kMasterAt, now), Action::deliver);
      EXPECT_EQ(m.on(s.header(now), Decoded::ok, kSlaveAt, now), Action::deliver);
    }
  }
};

/// What `to` does with a refusal that is said again every 20 ms for 200 ms, the last time at `end`.
Action insisted(Handshake& to, const Header& refusal, const Endpoint& from, Duration end) {
  for (Duration at = end - 200ms; at < end; at += 20ms)
    EXPECT_EQ(to.on(refusal, Decoded::ok, from, at), Action::reject) << at.count();
  return to.on(refusal, Decoded::ok, from, end);
}

TEST(Handshake, PairsWhenEachHasReturnedTheNumberOfTheOther) {
  Handshake s = slave(), m = master();
  EXPECT_FALSE(s.peer());
  EXPECT_EQ(m.peer(), kSlaveAt);
  const Header introduction = m.header(0ms);
  EXPECT_TRUE(introduction.identity);
  EXPECT_EQ(introduction.peer_session, 0U);

  ASSERT_EQ(s.on(introduction, Decoded::ok, kMasterAt, 1ms), Action::reply);
  const auto greeting = s.take_greeting();
  ASSERT_TRUE(greeting);
  EXPECT_FALSE(s.take_greeting());
  EXPECT_EQ(greeting->to, kMasterAt);
  EXPECT_EQ(greeting->header.peer_session, introduction.session);
  EXPECT_FALSE(s.take_new_session());

  ASSERT_EQ(m.on(greeting->header, Decoded::ok, kSlaveAt, 2ms), Action::pair);
  EXPECT_FALSE(m.listens());
  EXPECT_TRUE(m.take_new_session());
  EXPECT_FALSE(m.take_new_session());
  EXPECT_TRUE(m.listens());
  EXPECT_FALSE(m.coupled(2ms));

  const Header returned = m.header(3ms);
  EXPECT_EQ(returned.peer_session, greeting->header.session);
  ASSERT_EQ(s.on(returned, Decoded::ok, kMasterAt, 3ms), Action::pair);
  EXPECT_TRUE(s.take_new_session());
  EXPECT_EQ(s.peer(), kMasterAt);
  EXPECT_EQ(s.header(4ms).session, greeting->header.session);
  EXPECT_EQ(s.paired_since(), 3ms);

  EXPECT_EQ(s.on(returned, Decoded::ok, kMasterAt, 4ms), Action::deliver);
  EXPECT_TRUE(s.coupled(4ms));
  EXPECT_FALSE(s.header(5ms).identity);
  EXPECT_EQ(m.on(s.header(5ms), Decoded::ok, kSlaveAt, 5ms), Action::deliver);
  EXPECT_TRUE(m.coupled(5ms));
  EXPECT_FALSE(m.coupled(105ms));
  EXPECT_TRUE(m.header(105ms).identity);
}

TEST(Handshake, AMeasurementIsTurnedAwayAndEndsNobodyElse) {
  for (const bool key : {false, true}) {
    Handshake s = slave(2000, key), doctor = master(3000, kMeasurementDigest);
    Duration now{0};
    std::string said;
    for (; now < 3s && doctor.reject_reason().empty(); now += 1ms) {
      s.advance(now), doctor.advance(now);
      if (s.on(doctor.header(now), Decoded::ok, kMasterAt, now) != Action::refuse) continue;
      const Header refusal = s.refusal();
      said = refusal.refusal;
      // Whatever it answers is handed back.
      if (doctor.on(refusal, Decoded::ok, kSlaveAt, now) == Action::refuse)
        s.on(doctor.refusal(), Decoded::ok, kMasterAt, now);
    }
    EXPECT_EQ(said, "the slave has a scene, and answers no measurement");
    EXPECT_EQ(doctor.reject_reason(), said);
    now += 2s;
    s.advance(now);
    EXPECT_EQ(s.reject_reason(), "");
    // A master comes, and is taken.
    Handshake m = master();
    ASSERT_EQ(s.on(m.header(now), Decoded::ok, kMasterAt, now), Action::reply);
    EXPECT_EQ(m.on(s.take_greeting()->header, Decoded::ok, kSlaveAt, now), Action::pair);
  }
}

TEST(Handshake, AMasterIsToldThatADoctorAnswers) {
  Handshake doctor{{.side = Side::slave, .scene_digest = kMeasurementDigest}, kDof, counting(2000)}, m = master();
  Duration now{0};
  for (; now < 3s && m.reject_reason().empty(); now += 1ms)
    if (doctor.on(m.header(now), Decoded::ok, kMasterAt, now) == Action::refuse)
      m.on(doctor.refusal(), Decoded::ok, kSlaveAt, now);
  EXPECT_EQ(m.reject_reason(), "twoport-lab doctor runs at the slave's address, and has no scene; end it first");
  doctor.advance(now + 2s);
  EXPECT_EQ(doctor.reject_reason(), "");
}

TEST(Handshake, DrawsEveryNumberFromWhatItIsGiven) {
  int drawn = 0;
  const auto numbers = [&drawn] { return static_cast<std::uint64_t>(drawn++); };  // 0 first, which is no number
  Handshake s{{.side = Side::slave, .scene_digest = kScene}, kDof, numbers};
  const int before = drawn;
  Handshake m = master();
  s.on(m.header(0ms), Decoded::ok, kMasterAt, 0ms);
  const auto greeting = s.take_greeting();
  EXPECT_LT(greeting->header.session, static_cast<std::uint64_t>(before));
  EXPECT_NE(greeting->header.session, 0U);
  m.on(greeting->header, Decoded::ok, kSlaveAt, 0ms);
  m.take_new_session();
  s.on(m.header(0ms), Decoded::ok, kMasterAt, 0ms);
  EXPECT_EQ(drawn, before);
  s.take_new_session();
  EXPECT_EQ(drawn, before + 1);  // for the session after this one
}

TEST(Handshake, ARefusalTellsNoNumberOfThisSide) {
  Pair p;
  Handshake rival = master(7000);
  Action last = Action::reject;
  for (int k = 0; k < 1100 && last != Action::refuse; ++k) {
    p.talk(1);
    last = p.s.on(rival.header(p.now), Decoded::ok, kElsewhere, p.now);
  }
  ASSERT_EQ(last, Action::refuse);
  const Header refusal = p.s.refusal();
  EXPECT_EQ(refusal.refusal, "the slave is busy: it has a session with another master");
  EXPECT_EQ(refusal.peer_session, rival.header(p.now).session);
  EXPECT_FALSE(refusal.identity);
  EXPECT_NE(refusal.session, 0U);
  // Neither the session of now nor one that would begin another.
  EXPECT_NE(refusal.session, p.s.header(p.now).session);
  Header thief = rival.header(p.now);
  thief.peer_session = refusal.session;
  const Duration later = p.now + 800ms;
  EXPECT_EQ(p.s.on(thief, Decoded::ok, kElsewhere, later), Action::reply);
  // It is understood all the same, when it persists.
  EXPECT_EQ(insisted(rival, refusal, kSlaveAt, p.now), Action::end);
  EXPECT_EQ(rival.reject_reason(), refusal.refusal);
}

TEST(Handshake, TellsEachOfTwoWaitingMastersThatTheSlaveIsTaken) {
  Pair p;
  Handshake first = master(7000), second = master(8000);
  int told_first = 0, told_second = 0;
  for (int k = 0; k < 1300; ++k) {
    p.talk(1);
    // Who has been told asks no more.
    if (told_first == 0) told_first += p.s.on(first.header(p.now), Decoded::ok, kElsewhere, p.now) == Action::refuse;
    told_second += p.s.on(second.header(p.now), Decoded::ok, MemoryNetwork::address(4, 4), p.now) == Action::refuse;
  }
  EXPECT_GT(told_first, 0);
  EXPECT_GT(told_second, 0);
}

TEST(Handshake, ALateGreetingDoesNotEndASessionThatWorks) {
  Pair p;
  // Of a slave that was there before, and is gone: it has returned the master's number, and is not closed.
  Handshake gone = slave(6000);
  gone.on(p.m.header(200ms), Decoded::ok, kMasterAt, p.now);
  const Header late = gone.take_greeting()->header;
  p.talk(10);
  EXPECT_EQ(p.m.on(late, Decoded::ok, kSlaveAt, p.now), Action::reject);
  p.talk(10);
  EXPECT_EQ(p.m.pairings(), 1U);
  // When the session is silent it could be the slave that has started again.
  EXPECT_EQ(p.m.on(late, Decoded::ok, kSlaveAt, p.now + 100ms), Action::pair);
}

TEST(Handshake, ASlaveOffersAnotherSessionToAMasterThatHasLeftThisOne) {
  Pair p;
  Handshake gone = slave(6000);
  gone.on(p.m.header(200ms), Decoded::ok, kMasterAt, p.now);
  const Header late = gone.take_greeting()->header;
  p.now += 150ms;
  ASSERT_EQ(p.m.on(late, Decoded::ok, kSlaveAt, p.now), Action::pair);
  p.m.take_new_session();
  // The slave still believes in the old one, whose number is closed at the master.
  EXPECT_EQ(p.m.on(p.s.header(p.now), Decoded::ok, kSlaveAt, p.now), Action::reject);
  ASSERT_EQ(p.s.on(p.m.header(p.now), Decoded::ok, kMasterAt, p.now), Action::reply);
  const Header offer = p.s.take_greeting()->header;
  EXPECT_EQ(p.m.on(offer, Decoded::ok, kSlaveAt, p.now), Action::wait) << "it has just taken up another number";
  ASSERT_EQ(p.m.on(offer, Decoded::ok, kSlaveAt, p.now), Action::pair);
  p.m.take_new_session();
  ASSERT_EQ(p.s.on(p.m.header(p.now), Decoded::ok, kMasterAt, p.now), Action::pair);
  p.s.take_new_session();
  p.talk(5);
  EXPECT_TRUE(p.s.coupled(p.now) && p.m.coupled(p.now));
}

TEST(Handshake, AnOfferThatTheMasterHasClosedIsReplaced) {
  // The master takes the offer up, and then a late greeting of a slave that is gone, before the slave hears of it.
  Handshake s = slave(), gone = slave(6000), m = master();
  s.on(m.header(0ms), Decoded::ok, kMasterAt, 0ms);
  gone.on(m.header(0ms), Decoded::ok, kMasterAt, 0ms);
  m.on(s.take_greeting()->header, Decoded::ok, kSlaveAt, 0ms);
  m.take_new_session();
  m.on(gone.take_greeting()->header, Decoded::ok, kSlaveAt, 0ms);
  m.take_new_session();
  Duration now{0};
  for (; now < 600ms; now += 10ms) {
    if (s.on(m.header(now), Decoded::ok, kMasterAt, now) == Action::pair) break;
    if (m.on(s.take_greeting()->header, Decoded::ok, kSlaveAt, now) == Action::pair) m.take_new_session();
  }
  EXPECT_TRUE(s.take_new_session());
  EXPECT_LE(now, 510ms);
}

TEST(Handshake, AnOlderOfferStaysGoodOverALongWay) {
  Handshake s = slave(), m = master();
  Header returned = m.header(0ms);
  s.on(returned, Decoded::ok, kMasterAt, 0ms);
  const std::uint64_t first_offer = s.take_greeting()->header.session;
  // Meanwhile the master still shows another session, and new offers are drawn.
  returned.peer_session = 99;
  for (Duration now{0}; now < 7s; now += 100ms) s.on(returned, Decoded::ok, kMasterAt, now);
  EXPECT_NE(s.take_greeting()->header.session, first_offer);
  returned.peer_session = first_offer;
  ASSERT_EQ(s.on(returned, Decoded::ok, kMasterAt, 7s), Action::pair);
  s.take_new_session();
  EXPECT_EQ(s.header(7s).session, first_offer);
}

TEST(Handshake, ASlaveThatRestartedPairsOnceHoweverLateThePacketsCome) {
  // 50 ms each way; the first packets come when the key has been agreed on, about half a second after the slave's start.
  for (Duration opened = 380ms; opened <= 520ms; opened += 10ms) {
    Pair p{true};
    Handshake s = slave(5000, true);
    std::deque<std::pair<Duration, Header>> to_slave, to_master;
    int pairings = 0;
    for (Duration now = opened; now < opened + 1s; now += 1ms) {
      const Duration of_master = now + 1s;  // its clock: it has been silent for long
      to_slave.emplace_back(now + 50ms, p.m.header(of_master));
      if (const auto greeting = s.take_greeting()) to_master.emplace_back(now + 50ms, greeting->header);
      if (s.pairings() > 0) to_master.emplace_back(now + 50ms, s.header(now));
      for (; !to_slave.empty() && to_slave.front().first <= now; to_slave.pop_front())
        if (s.on(to_slave.front().second, Decoded::ok, kMasterAt, now) == Action::pair) s.take_new_session();
      for (; !to_master.empty() && to_master.front().first <= now; to_master.pop_front())
        if (p.m.on(to_master.front().second, Decoded::ok, kSlaveAt, of_master) == Action::pair)
          pairings += p.m.take_new_session();
    }
    EXPECT_EQ(pairings, 1) << opened.count();
    EXPECT_EQ(s.pairings(), 1U) << opened.count();
    EXPECT_TRUE(s.coupled(opened + 1s) && p.m.coupled(opened + 2s));
  }
}

TEST(Handshake, WithAKeyAMismatchEndsAnUnpairedSideAfterItHasToldTheOther) {
  Handshake s = slave(2000, true);
  const Handshake other = master(7000, 0x123);
  ASSERT_EQ(s.on(other.header(0ms), Decoded::ok, kElsewhere, 0ms), Action::refuse);
  EXPECT_NE(s.refusal().refusal.find("different scenes"), std::string::npos);
  s.advance(499ms);
  EXPECT_EQ(s.reject_reason(), "");
  s.advance(500ms);
  EXPECT_NE(std::string{s.reject_reason()}.find("different scenes"), std::string::npos);
  EXPECT_FALSE(s.listens());
}

TEST(Handshake, WithoutAKeyNoNumberOfIntroductionsEndsASide) {
  // Each with a forged source: whoever sends them does not receive the refusals.
  Handshake s = slave();
  Handshake other = master(7000, 0x123);
  Header future;
  future.version = kProtocolVersion + 1;
  future.session = 8;
  for (Duration now{0}; now < 10s; now += 5ms) {
    s.on(other.header(now), Decoded::ok, kElsewhere, now);
    s.on(future, Decoded::other_version, kMasterAt, now);
    s.advance(now);
    Header guess = other.header(now);
    guess.refusal = "go away";
    guess.peer_session = static_cast<std::uint64_t>(now.count());
    s.on(guess, Decoded::ok, kElsewhere, now);
    ASSERT_EQ(s.reject_reason(), "");
  }
  // Nor a master, from the address of its slave.
  Handshake m = master();
  for (Duration now{0}; now < 10s; now += 5ms) {
    m.on(future, Decoded::other_version, kSlaveAt, now);
    m.advance(now);
    ASSERT_EQ(m.reject_reason(), "");
  }
}

TEST(Handshake, WithoutAKeyBothEndOnceTheRefusalHasPersistedAndTheRefusedOneHasAnswered) {
  Handshake s = slave(), other = master(7000, 0x123);
  Duration now{0}, answered{0}, ended{0};
  std::string told;
  for (; now < 2s && s.reject_reason().empty(); now += 1ms) {
    s.advance(now), other.advance(now);
    if (!other.listens() || s.on(other.header(now), Decoded::ok, kMasterAt, now) != Action::refuse) continue;
    told = s.refusal().refusal;
    if (other.on(s.refusal(), Decoded::ok, kSlaveAt, now) != Action::refuse) continue;
    if (answered == Duration{0}) answered = now;
    if (s.on(other.refusal(), Decoded::ok, kMasterAt, now) == Action::end) ended = now;
  }
  EXPECT_EQ(told, mismatch_without_reason(Side::slave).view());
  EXPECT_NEAR(static_cast<double>(answered.count()) * 1e-9, 0.2, 1e-9);
  EXPECT_NEAR(static_cast<double>(ended.count()) * 1e-9, 0.4, 1e-9);
  EXPECT_NE(s.reject_reason().find("different scenes"), std::string_view::npos);
  other.advance(answered + 500ms);
  EXPECT_EQ(other.reject_reason(), told);
  EXPECT_TRUE(is_mismatch(other.reject_reason()));
}

// One on the path flips bits of the identity, so that the two seem not to fit, and answers the refusals as if it were the peer.
TEST(Handshake, WithoutAKeyFlippedBitsEndNeitherSideAndTheTwoPair) {
  const Sentence answered = mismatch_without_reason(Side::master);
  for (unsigned seed = 0; seed < 100; ++seed) {
    Handshake s = slave(), m = master();
    std::mt19937 random{seed};
    const unsigned damaged_percent = std::array{10U, 30U, 50U, 80U}[seed % 4];
    Duration now{0};
    const auto damaged = [&](Header h) {
      if (h.identity && random() % 100 < damaged_percent) h.identity->scene_digest ^= 1;
      return h;
    };
    const auto to_slave = [&](const Header& h) {
      if (!s.listens()) return;
      const Action a = s.on(h, Decoded::ok, kMasterAt, now);
      ASSERT_NE(a, Action::end);
      if (a != Action::refuse || !m.listens()) return;
      const Header refusal = s.refusal();
      Header answer = m.header(now);
      answer.identity.reset();
      answer.peer_session = refusal.session;
      answer.refusal = answered.view();
      ASSERT_NE(s.on(answer, Decoded::ok, kMasterAt, now), Action::end);
      ASSERT_NE(m.on(refusal, Decoded::ok, kSlaveAt, now), Action::end);
    };
    for (; now < 3s && !(m.coupled(now) && s.coupled(now)); now += 1ms) {
      m.advance(now), s.advance(now);
      to_slave(damaged(m.header(now)));
      if (const auto greeting = s.take_greeting(); greeting && m.listens())
        m.on(damaged(greeting->header), Decoded::ok, kSlaveAt, now);
      if (s.peer() && m.listens()) m.on(damaged(s.header(now)), Decoded::ok, kSlaveAt, now);
      m.take_new_session(), s.take_new_session();
    }
    EXPECT_EQ(m.reject_reason(), "") << seed;
    EXPECT_EQ(s.reject_reason(), "") << seed;
    EXPECT_TRUE(m.coupled(now) && s.coupled(now)) << seed;
  }
}

// One on the path stops every answer of the slave, makes introductions that do not fit, and answers their refusals himself. The
// true master's introductions arrive.
TEST(Handshake, WithoutAKeyWhoAnswersRefusalsInPlaceOfTheMasterDoesNotEndTheSlave) {
  Handshake s = slave();
  const Handshake m = master(), other = master(7000, 0x123);
  int refused = 0;
  for (Duration now{0}; now < 3s; now += 1ms) {
    s.advance(now);
    if (s.on(other.header(now), Decoded::ok, kMasterAt, now) == Action::refuse) {
      ++refused;
      Header answer = s.refusal();
      std::swap(answer.session, answer.peer_session);
      ASSERT_EQ(s.on(answer, Decoded::ok, kMasterAt, now), Action::reject) << now.count();
    }
    if (now.count() % 50'000'000 == 0) {
      ASSERT_EQ(s.on(m.header(now), Decoded::ok, kMasterAt, now), Action::reply);
    }
  }
  EXPECT_GT(refused, 100);
  EXPECT_EQ(s.reject_reason(), "");
}

TEST(Handshake, WithoutAKeyFourRefusalsAreNoneHoweverFarApart) {
  Handshake m = master();
  Header refusal;
  refusal.session = 5;
  refusal.peer_session = m.header(0ms).session;
  refusal.refusal = "go away";
  for (Duration now{0}; now < 4s; now += 1s) EXPECT_EQ(m.on(refusal, Decoded::ok, kSlaveAt, now), Action::reject);
  EXPECT_EQ(m.on(refusal, Decoded::ok, kSlaveAt, 4s), Action::end);
}

TEST(Handshake, WithoutAKeyRefusalsEndAPairedMasterOnlyAfterALongSilence) {
  Pair p;
  Header refusal;
  refusal.session = 5;
  refusal.peer_session = p.m.header(p.now).session;
  refusal.refusal = "go away";
  const Duration heard = p.now;
  for (; p.now < heard + 740ms; p.now += 10ms)
    ASSERT_EQ(p.m.on(refusal, Decoded::ok, kSlaveAt, p.now), Action::reject) << (p.now - heard).count();
  // The slave is there after all.
  p.now += 20ms;
  EXPECT_EQ(p.m.on(p.s.header(heard), Decoded::ok, kSlaveAt, p.now), Action::deliver);
  p.now += 760ms;
  for (int k = 0; k < 8; ++k, p.now += 20ms) {
    refusal.refusal = k % 2 == 0 ? "go away" : "begone";  // not the same
    EXPECT_EQ(p.m.on(refusal, Decoded::ok, kSlaveAt, p.now), Action::reject);
  }
  refusal.refusal = "go away";
  EXPECT_EQ(insisted(p.m, refusal, kSlaveAt, p.now + 220ms), Action::end);
}

TEST(Handshake, AMasterOfAnotherSceneIsToldThatTheSlaveIsBusyWhileItIs) {
  Pair p;
  const Handshake other = master(7000, 0x123);
  ASSERT_EQ(p.s.on(other.header(p.now), Decoded::ok, kElsewhere, p.now), Action::refuse);
  EXPECT_EQ(p.s.refusal().refusal, "the slave is busy: it has a session with another master");
}

TEST(Handshake, TheAnswerToARefusalEndsNoPairedSide) {
  Pair p;
  Handshake other = master(7000, 0x123);
  p.now += 2s;
  ASSERT_EQ(p.s.on(other.header(p.now), Decoded::ok, kElsewhere, p.now), Action::refuse);
  Header answer = other.header(p.now);
  answer.peer_session = p.s.refusal().session;
  answer.refusal = "understood";
  EXPECT_EQ(p.s.on(answer, Decoded::ok, kElsewhere, p.now), Action::reject);
  p.s.advance(p.now + 1s);
  EXPECT_EQ(p.s.reject_reason(), "");
}

TEST(Handshake, AMismatchDoesNotEndAnUnpairedSideThatMeetsItsPeerMeanwhile) {
  Handshake s = slave(), m = master();
  s.on(master(7000, 0x123).header(0ms), Decoded::ok, kElsewhere, 0ms);
  ASSERT_EQ(s.on(m.header(1ms), Decoded::ok, kMasterAt, 1ms), Action::reply);
  m.on(s.take_greeting()->header, Decoded::ok, kSlaveAt, 1ms);
  m.take_new_session();
  ASSERT_EQ(s.on(m.header(2ms), Decoded::ok, kMasterAt, 2ms), Action::pair);
  s.take_new_session();
  s.advance(1s);
  EXPECT_EQ(s.reject_reason(), "");
}

TEST(Handshake, AMismatchFromElsewhereDoesNotEndAPairedSideEvenInSilence) {
  Pair p;
  const Handshake other = master(7000, 0x123);
  p.now += 200ms;
  EXPECT_EQ(p.s.on(other.header(p.now), Decoded::ok, kElsewhere, p.now), Action::refuse);
  p.s.advance(p.now + 1s);
  EXPECT_EQ(p.s.reject_reason(), "");
}

TEST(Handshake, AMismatchFromThePeersAddressEndsNoSessionThatWorksButWithAKeyOneThatIsSilent) {
  for (const bool key : {false, true}) {
    Pair p{key};
    const Handshake other = master(7000, 0x123);
    EXPECT_EQ(p.s.on(other.header(200ms), Decoded::ok, kMasterAt, p.now), Action::refuse);
    p.talk(10);
    p.s.advance(p.now + 1s);
    EXPECT_EQ(p.s.reject_reason(), "");
    p.now += 200ms;
    EXPECT_EQ(p.s.on(other.header(p.now), Decoded::ok, kMasterAt, p.now), Action::refuse);
    p.s.advance(p.now + 500ms);
    EXPECT_EQ(p.s.reject_reason().empty(), !key);
  }
}

TEST(Handshake, AnotherMasterFollowsASilentOneWhenTheRobotIsAlmostReleased) {
  for (const bool key : {false, true}) {
    Pair p{key};
    const Handshake rival = master(7000);
    EXPECT_EQ(p.s.on(rival.header(p.now), Decoded::ok, kElsewhere, p.now + 749ms), Action::reject);
    EXPECT_EQ(p.s.on(rival.header(p.now), Decoded::ok, kElsewhere, p.now + 750ms), Action::reply);
  }
}

TEST(Handshake, ALateRefusalDoesNotEndASessionThatWorks) {
  Pair p;
  Header refusal;
  refusal.session = 5;
  refusal.peer_session = p.m.header(p.now).session;
  refusal.refusal = "go away";
  EXPECT_EQ(p.m.on(refusal, Decoded::ok, kSlaveAt, p.now), Action::reject);
  EXPECT_EQ(p.m.on(refusal, Decoded::ok, kElsewhere, p.now + 900ms), Action::reject);
  EXPECT_EQ(insisted(p.m, refusal, kSlaveAt, p.now + 1s), Action::end);
}

TEST(Handshake, AMasterThatWasSeenAtAWrongAddressIsHeardAtItsOwn) {
  // Somebody has sent the master's answer again from elsewhere, and was first.
  Handshake s = slave(), m = master();
  s.on(m.header(0ms), Decoded::ok, kMasterAt, 0ms);
  m.on(s.take_greeting()->header, Decoded::ok, kSlaveAt, 0ms);
  m.take_new_session();
  ASSERT_EQ(s.on(m.header(1ms), Decoded::ok, kElsewhere, 1ms), Action::pair);
  s.take_new_session();
  EXPECT_EQ(s.on(m.header(2ms), Decoded::ok, kMasterAt, 2ms), Action::reject);
  Duration now{800ms};
  ASSERT_EQ(s.on(m.header(now), Decoded::ok, kMasterAt, now), Action::reply);
  ASSERT_EQ(m.on(s.take_greeting()->header, Decoded::ok, kSlaveAt, now), Action::pair);
  m.take_new_session();
  ASSERT_EQ(s.on(m.header(now), Decoded::ok, kMasterAt, now), Action::pair);
  s.take_new_session();
  EXPECT_EQ(s.peer(), kMasterAt);
}

TEST(Handshake, HearsOnlyThePeerThatItWasGiven) {
  const Handshake m = master(), s = slave();
  EXPECT_TRUE(m.hears(kSlaveAt));
  EXPECT_FALSE(m.hears(kElsewhere));
  EXPECT_TRUE(s.hears(kElsewhere));
}

TEST(Handshake, CanBeginInTheMidstOfASession) {
  Handshake m{{.side = Side::master, .peer = kSlaveAt}, kDof, counting(1), {kSlaveAt, 11, 22}};
  Handshake s{{.side = Side::slave}, kDof, counting(1), {kMasterAt, 22, 11}};
  EXPECT_EQ(s.on(m.header(0ms), Decoded::ok, kMasterAt, 1ms), Action::deliver);
  EXPECT_EQ(m.on(s.header(0ms), Decoded::ok, kSlaveAt, 1ms), Action::deliver);
  EXPECT_FALSE(m.take_new_session() || s.take_new_session());
  EXPECT_EQ(s.pairings(), 1U);
}

TEST(Handshake, DoesNotAllocate) {
  Pair p;
  const Handshake other = master(7000, 0x123), rival = master(8000);
  const NoAlloc guard;
  for (int k = 0; k < 1500; ++k) {
    p.talk(1);
    p.s.on(other.header(p.now), Decoded::ok, kElsewhere, p.now);
    p.s.on(rival.header(p.now), Decoded::ok, kElsewhere, p.now);
    p.s.advance(p.now);
  }
  EXPECT_EQ(guard.seen(), 0);
}

}  // namespace
}  // namespace twoport::handshake_test
