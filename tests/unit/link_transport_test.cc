#include "common/wire/link_transport.h"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <limits>
#include <random>
#include <vector>

#include "common/link/impaired_socket.h"
#include "common/link/mailbox.h"
#include "common/link/zero_requests.h"
#include "tests/support/memory_network.h"
#include "tests/support/no_alloc.h"

namespace twoport::link_transport_test {
namespace {

using namespace std::chrono_literals;

const Endpoint kSlaveAt = MemoryNetwork::address(1, 45000), kMasterAt = MemoryNetwork::address(2, 50000),
               kStranger = MemoryNetwork::address(3, 1);

SessionNumbers seeded(std::uint64_t seed) {
  return [random = std::mt19937_64{seed}]() mutable { return random(); };
}

/// Both ends of a link in memory, each with the whole stack.
template <int N>
struct Link {
  void tick(int ticks = 1) {
    for (int k = 0; k < ticks; ++k) {
      now += 1ms;
      for (auto* mail : {&master, &slave}) {
        if (mail->transport().take_new_session()) mail->reset(mail->transport().handshake().session_since());
        fresh += mail->collect(now).is_new;
        mail->post(Report<N>{}, now);
      }
    }
  }
  [[nodiscard]] bool coupled() { return master.transport().coupled(now) && slave.transport().coupled(now); }

  MemoryNetwork network{1, 4096};
  MemorySocket master_socket = network.open(kMasterAt, 0ms), slave_socket = network.open(kSlaveAt, 0ms);
  ImpairedSocket master_filter{master_socket, {.peer = kSlaveAt}}, slave_filter{slave_socket, {}};
  Mailbox<N, LinkTransport<N>> master{{master_filter, {.side = Side::master, .peer = kSlaveAt}, seeded(1)}};
  Mailbox<N, LinkTransport<N>> slave{{slave_filter, {.side = Side::slave}, seeded(2)}};
  Duration now{0};
  int fresh = 0;
};

// With it the slave knows the age of what it hears a round trip earlier.
TEST(LinkTransport, AMasterSendsBackTheStampOfAGreeting) {
  Link<1> link;
  for (int k = 0; k < 50 && !link.slave.known().has_report; ++k) link.tick();
  ASSERT_TRUE(link.slave.known().has_report);
  EXPECT_GE(link.slave.known().newest.echo_ns, 0);
}

/// Reports of the gripper arrive with those of the main coupling, as many and with the same numbers; one that is not finite stays
/// behind, and the main report arrives.
TEST(LinkTransport, CarriesTheGripper) {
  Link<3> link;
  std::array grippers{Mailbox<1, GripperTransport<3>>{GripperTransport<3>{link.master.transport()}},
                      Mailbox<1, GripperTransport<3>>{GripperTransport<3>{link.slave.transport()}}};
  double opening = 0.0;
  const auto tick = [&] {
    link.now += 1ms;
    opening += 0.001;
    for (std::size_t i = 0; i < 2; ++i) {
      auto& mail = i == 0 ? link.master : link.slave;
      if (mail.transport().take_new_session()) {
        const Duration since = mail.transport().handshake().session_since();
        mail.reset(since), grippers[i].reset(since);
      }
      mail.collect(link.now);
      mail.post(Report<3>{}, link.now);
      grippers[i].collect(link.now);
      grippers[i].post(PortReport<1>{.x = Position<1>{Position<1>::Vector{opening}}}, link.now);
    }
  };
  for (int k = 0; k < 50; ++k) tick();
  ASSERT_TRUE(link.coupled());
  EXPECT_NEAR(grippers[1].known().newest.x.translation()[0], opening, 0.0021);
  EXPECT_EQ(grippers[1].known().newest.sequence, link.slave.known().newest.sequence);
  EXPECT_EQ(grippers[1].counts().received, link.slave.counts().received);
  EXPECT_GT(grippers[0].known().newest.x.translation()[0], 0.0);
  opening = std::numeric_limits<double>::quiet_NaN();
  const std::uint64_t arm = link.slave.counts().received, gripper = grippers[1].counts().received;
  for (int k = 0; k < 50; ++k) tick();
  EXPECT_GE(link.slave.counts().received, arm + 48);
  EXPECT_LE(grippers[1].counts().received, gripper + 2);
}

TEST(LinkTransport, PairsAndDelivers) {
  Link<3> link;
  link.tick(10);
  EXPECT_TRUE(link.coupled());
  EXPECT_TRUE(link.master.known().has_report && link.slave.known().has_report);
  EXPECT_EQ(link.slave.transport().handshake().peer(), kMasterAt);
  EXPECT_EQ(link.master.transport().counts().rejected.total() + link.slave.transport().counts().rejected.total(), 0U);
}

/// Three packets in ten are damaged, over a round trip as long as a program waits for the return of its number: a damaged session number
/// must not pass for a program that has started again.
TEST(LinkTransport, FlippedBitsBreakNoSession) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Link<1> link;
    MemoryNetwork::Conditions c;
    c.impairment.delay_s = 0.05;
    c.corruption = 0.3;
    for (std::uint64_t draws = 0; draws < seed; ++draws) link.network.set_conditions(c);  // other damage each time
    int coupled = 0;
    for (int k = 0; k < 5000; ++k) {
      link.tick();
      coupled += link.coupled();
    }
    // The first number may be a damaged one, and the true one follows.
    EXPECT_LE(link.master.transport().pairings(), 2U) << seed;
    EXPECT_LE(link.slave.transport().pairings(), 2U) << seed;
    // It pairs within three one-way delays, at worst twice.
    EXPECT_GT(coupled, 4500) << seed;
    EXPECT_EQ(link.master.transport().reject_reason(), "") << seed;
  }
}

TEST(LinkTransport, ReadsABoundedNumberInOnePoll) {
  MemoryNetwork network{1, 8192};
  MemorySocket socket = network.open(kSlaveAt, 0ms);
  LinkTransport<1> transport{socket, {.side = Side::slave}, seeded(1)};
  const std::array<std::byte, 20> noise{};
  for (int k = 0; k < 5000; ++k) network.send(noise, kStranger, kSlaveAt, 0ms);
  transport.poll(1ms, [](const Report<1>&) {});
  EXPECT_EQ(transport.counts().rejected.total(), 1024U);
}

/// A request travels with the packets, the state back; an older request does not undo a newer one, and a session ends both.
TEST(LinkTransport, CarriesARequestToTheEnvironmentAndTheState) {
  Link<3> link;
  link.tick(20);
  ASSERT_TRUE(link.coupled());
  EXPECT_EQ(link.slave.transport().heard_environment().number, 0U);
  EnvironmentMessage request{.number = 5, .count = 1, .surface = {{{700.0, 0.1}}}};
  link.master.transport().say_environment(request);
  link.tick(2);
  EXPECT_EQ(link.slave.transport().heard_environment().number, 5U);
  EXPECT_EQ(link.slave.transport().heard_environment().surface[0].stiffness_n_per_m, 700.0);
  EXPECT_EQ(link.master.transport().heard_environment().number, 0U) << "the slave has said nothing";
  link.slave.transport().say_environment({.number = 5, .answer = EnvironmentAnswer::adjustable, .energy_j = 0.5});
  request.number = 4, request.surface[0].stiffness_n_per_m = 100.0;
  link.master.transport().say_environment(request);
  link.tick(3);
  EXPECT_EQ(link.slave.transport().heard_environment().surface[0].stiffness_n_per_m, 700.0) << "an older one";
  EXPECT_EQ(link.master.transport().heard_environment().answer, EnvironmentAnswer::adjustable);
  EXPECT_EQ(link.master.transport().heard_environment().energy_j, 0.5);
}

/// A request is answered once, whatever packets repeat it; one of an earlier session is none.
TEST(ZeroRequests, AreAnsweredOnceInTheirSession) {
  ZeroRequests master;
  ZeroAnswers slave;
  EnvironmentMessage asked{.number = 1}, said;
  SensorRest sensor{.drift_n = 0.4};
  int times = 0;
  std::uint64_t session = 1;
  const auto exchange = [&](int ticks) {
    for (int k = 0; k < ticks; ++k) {
      if (slave.hear(asked, session)) {
        ++times;
        sensor.asked = true;
      } else if (sensor.asked && k % 5 == 4) {
        sensor = {.answer = ZeroAnswer::zeroed, .answered = sensor.answered + 1, .drift_n = 0.0};
      }
      slave.say(sensor, said);
      said.number = asked.number;
      master.step(said, asked);
    }
  };
  master.step(said, asked);
  EXPECT_EQ(master.rest().drift_n, -1.0) << "the slave has said nothing";
  exchange(10);
  EXPECT_EQ(times, 0);
  EXPECT_EQ(master.rest().drift_n, 0.4);
  master.ask();
  exchange(20);
  EXPECT_EQ(times, 1);
  EXPECT_EQ(master.rest().answer, ZeroAnswer::zeroed);
  EXPECT_EQ(master.rest().answered, 1U);
  session = 2;
  exchange(20);
  EXPECT_EQ(times, 1) << "the number is of the session before";
  EXPECT_EQ(master.rest().answered, 1U);
  // Another slave, which has answered nothing yet, in the middle of a request.
  master.ask();
  exchange(1);
  slave = {}, said = {}, sensor = {};
  session = 1;
  exchange(40);
  EXPECT_EQ(times, 2);
  EXPECT_EQ(master.rest().answered, 2U);
  EXPECT_FALSE(master.rest().asked);
}

/// Another program at the master's address knows no number of the session: what it says is not heard.
TEST(LinkTransport, HearsOfTheEnvironmentFromItsPeerOnly) {
  Link<3> link;
  link.tick(20);
  ASSERT_TRUE(link.coupled());
  Codec<3> codec;
  Envelope<3> forged;
  forged.session = 12345;
  forged.report.sequence = 1000;
  forged.environment = {.number = 9, .count = 1, .surface = {{{10.0, 0.0}}}};
  for (const Endpoint& from : {kMasterAt, kStranger}) {
    link.network.send(codec.encode(forged), from, kSlaveAt, link.now);
    link.tick(3);
    EXPECT_EQ(link.slave.transport().heard_environment().number, 0U);
  }
}

TEST(LinkTransport, DropsWhatIsNotFromItsPeerWithoutReadingIt) {
  MemoryNetwork network;
  MemorySocket socket = network.open(kMasterAt, 0ms);
  LinkTransport<1> transport{socket, {.side = Side::master, .peer = kSlaveAt}, seeded(1)};
  Codec<1> codec;
  Envelope<1> refusal;
  refusal.session = 1;
  refusal.peer_session = transport.handshake().header(0ms).session;
  refusal.refusal = "go away";
  network.send(codec.encode(refusal), kStranger, kMasterAt, 0ms);
  transport.poll(1ms, [](const Report<1>&) {});
  EXPECT_EQ(transport.counts().rejected.total(), 1U);
  EXPECT_EQ(transport.reject_reason(), "");
  // Of its peer, and again and again.
  for (Duration now{1ms}; now < 202ms; now += 20ms) {
    EXPECT_EQ(transport.reject_reason(), "");
    network.send(codec.encode(refusal), kSlaveAt, kMasterAt, now);
    transport.poll(now + 1ms, [](const Report<1>&) {});
  }
  EXPECT_EQ(transport.reject_reason(), "go away");
}

TEST(LinkTransport, DoesNotAllocateInAFloodOfFieldsThatNobodyKnows) {
  Link<6> link;
  link.tick(20);
  ASSERT_TRUE(link.coupled());
  // Ours by its first bytes, and then as many fields of number 100 as there is room for: 3 bytes each.
  std::vector<std::byte> flood = {std::byte{0x0d}, std::byte{1}, std::byte{0}, std::byte{0x50}, std::byte{0x54}};
  while (flood.size() + 3 <= kMaxDatagram)
    for (unsigned b : {0xa0U, 0x06U, 0x01U}) flood.push_back(static_cast<std::byte>(b));
  const int fresh = link.fresh;
  const NoAlloc guard;
  for (int k = 0; k < 500; ++k) {
    for (int f = 0; f < 50; ++f) {
      link.network.send(flood, kStranger, kSlaveAt, link.now);
      link.network.send(flood, kMasterAt, kSlaveAt, link.now);
    }
    link.tick();
  }
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_EQ(link.fresh - fresh, 1000);
  EXPECT_EQ(link.slave.transport().counts().rejected.total(), 50'000U);
  EXPECT_TRUE(link.coupled());
}

}  // namespace
}  // namespace twoport::link_transport_test
