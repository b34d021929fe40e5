#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <deque>
#include <iostream>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "common/base/sanitized.h"
#include "common/link/mailbox.h"
#include "common/wire/link_transport.h"
#include "tests/support/memory_network.h"

// Whole sessions in virtual time under random schedules: every datagram goes through codec and handshake as bytes, over
// a network that delays, loses, repeats, reorders and damages it, while programs start again, hang and compete, and
// strangers talk. Each schedule is written down by its seed.
namespace twoport::session_schedules_test {
namespace {

using namespace std::chrono_literals;

constexpr Duration kTick = 5ms;
constexpr Duration kTurbulence = 1500ms;
/// From the calm on: what is on its way arrives (0.4 s), an old master is given up (1 s), three trips of 5 ms, 20 ticks.
constexpr Duration kCalmWithin = 1600ms;
constexpr std::uint64_t kScene = 0xabcdef, kOtherScene = 0x123456;

SessionOptions options(Side side, std::optional<Endpoint> peer, std::uint64_t scene = kScene) {
  SessionOptions o;
  o.side = side;
  o.scene_digest = scene;
  o.peer = peer;
  return o;
}

constexpr std::size_t kCopies = 48;

/// Keeps copies of what passes, for strangers to send again.
class Tap final : public DatagramSocket {
 public:
  struct Copy {
    Datagram datagram;
    Endpoint to;
  };
  Tap(DatagramSocket& socket, std::vector<Copy>& copies) : socket_{&socket}, copies_{&copies} {}
  bool send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept override {
    if (++sent_ % 16 == 1 && copies_->size() < kCopies) {
      Copy copy;
      copy.datagram.assign(bytes, socket_->local());
      copy.to = to;
      copies_->push_back(copy);
    }
    return socket_->send(bytes, to, now);
  }
  std::optional<ReceivedDatagram> receive(Duration now) noexcept override { return socket_->receive(now); }
  [[nodiscard]] const Endpoint& local() const noexcept override { return socket_->local(); }
  [[nodiscard]] SocketCounts counts() const noexcept override { return socket_->counts(); }

 private:
  DatagramSocket* socket_;
  std::vector<Copy>* copies_;
  unsigned sent_ = 0;
};

/// Which life of which program has read running totals of which other. A life begins when a program takes a session up
/// and starts its totals from zero. Two lives that share totals share them with nobody else.
class Lives {
 public:
  int begin() {
    partner_.push_back(-1);
    return static_cast<int>(partner_.size()) - 1;
  }
  /// False when one of the two has exchanged totals with another.
  bool share(int reader, int speaker) {
    for (const auto& [a, b] : {std::pair{reader, speaker}, std::pair{speaker, reader}}) {
      int& known = partner_[static_cast<std::size_t>(a)];
      if (known < 0) known = b;
      if (known != b) return false;
    }
    return true;
  }

 private:
  std::vector<int> partner_;
};

/// One program: a mailbox over its link, and a node whose report says in which life it was written.
struct Program {
  struct Checked {
    LinkTransport<1> link;
    Program* self;
    template <class F>
    void poll(Duration now, F f) noexcept {
      link.poll(now, [&](const Report<1>& r) {
        self->check(r);
        f(r);
      });
    }
    void send(const Report<1>& r, Duration now) noexcept { link.send(r, now); }
  };

  Program(MemoryNetwork& network, const Endpoint& at, const SessionOptions& o, SessionNumbers numbers, Lives& all,
          std::vector<Tap::Copy>& copies, Duration now)
      : socket{network.open(at, now)},
        tap{socket, copies},
        lives{&all},
        life{all.begin()},
        mail{Checked{LinkTransport<1>{tap, o, std::move(numbers)}, this}} {}
  Program(const Program&) = delete;

  LinkTransport<1>& link() { return mail.transport().link; }
  [[nodiscard]] bool ended() { return !link().reject_reason().empty(); }

  void tick(Duration now) {
    const bool was_coupled = link().coupled(now);
    if (link().take_new_session()) {
      mail.reset(link().handshake().session_since());
      life = lives->begin();
    }
    mail.collect(now);
    ended_while_coupled = ended_while_coupled || (ended() && was_coupled);
    Report<1> r;
    // Said three times, so that damage shows. The energy is the running total of this life.
    const double word = life + 1;
    r.v = Velocity<1>{Velocity<1>::Vector{word}};
    r.f = Force<1>{Force<1>::Vector{word}};
    r.f_coupling = Force<1>{Force<1>::Vector{word}};
    r.energy_in_j = word;
    mail.post(r, now);
  }

  void check(const Report<1>& r) {
    const double word = r.v.vec()[0];
    if (word != r.f.vec()[0] || word != r.f_coupling.vec()[0]) return;  // damaged
    if (r.energy_in_j == 0.0) return;                                   // a greeting: no totals yet
    if (r.energy_in_j != word) return;                                  // damaged
    ++delivered;
    mixed = mixed || !lives->share(life, static_cast<int>(word) - 1);
  }

  MemorySocket socket;
  Tap tap;
  Lives* lives;
  int life;
  Mailbox<1, Checked> mail;
  int delivered = 0;
  bool mixed = false, ended_while_coupled = false;
};

struct Outcome {
  bool coupled = false, sentence = false;
  bool mixed = false, ended_while_coupled = false, paired_slave_ended = false, damaged = false;
  Duration after{0};
  std::string words;
  int restarts = 0;
};

/// What a schedule may contain.
struct Events {
  bool slave_restarts = false, master_restarts = false, competing_masters = false, strangers = false, damage = false;
};

class Schedule {
 public:
  Schedule(std::uint64_t seed, const Events& events) : random_{seed}, events_{events}, network_{random_(), 64} {
    copies_.reserve(kCopies);
  }

  Outcome run() {
    start_slave();
    start_master();
    weather();
    for (; now_ < kTurbulence; now_ += kTick) {
      if (chance(0.02)) weather();
      happen();
      tick();
    }
    calm();
    const Duration calm_since = now_;
    while (now_ - calm_since < 2 * kCalmWithin && !settled()) {
      now_ += kTick;
      tick();
    }
    out_.after = now_ - calm_since;
    out_.coupled = together();
    return out_;
  }

 private:
  bool chance(double p) { return uniform() < p; }
  double uniform() { return static_cast<double>(random_() >> 11) * 0x1p-53; }
  SessionNumbers numbers() {
    return [this] { return random_(); };
  }
  static Endpoint slave_address() { return MemoryNetwork::address(1, 45000); }

  void weather() {
    MemoryNetwork::Conditions c;
    c.impairment.delay_s = 0.080 * uniform();
    c.impairment.jitter_s = chance(0.5) ? 0.050 * uniform() : 0.0;
    c.impairment.loss = 0.3 * uniform();
    c.impairment.duplicate = chance(0.5) ? 0.2 * uniform() : 0.0;
    c.impairment.reorder = chance(0.5) ? 0.2 * uniform() : 0.0;
    c.impairment.reorder_s = 0.1;
    c.corruption = events_.damage ? 0.1 * uniform() : 0.0;
    if (chance(0.1)) c.impairment.loss = 1.0;
    network_.set_conditions(c);
  }

  void start_slave() {
    slave_ = std::make_unique<Program>(network_, slave_address(), options(Side::slave, std::nullopt), numbers(), lives_,
                                       copies_, now_);
  }
  void start_master() {
    // Sometimes from the same port as the one before.
    if (master_port_ == 0 || chance(0.7)) ++master_port_;
    master_ = std::make_unique<Program>(network_, MemoryNetwork::address(2, master_port_),
                                        options(Side::master, slave_address()), numbers(), lives_, copies_, now_);
  }

  void happen() {
    if (events_.slave_restarts && chance(0.01)) gather(slave_, true), slave_.reset(), ++out_.restarts;
    if (events_.master_restarts && chance(0.01)) gather(master_, false), master_.reset(), ++out_.restarts;
    if (!slave_ && chance(0.1)) start_slave();
    if (!master_ && chance(0.1)) start_master();
    if (chance(0.005)) slave_hangs_until_ = now_ + to_duration(0.4 * uniform());
    if (chance(0.005)) master_hangs_until_ = now_ + to_duration(0.4 * uniform());
    if (events_.competing_masters && chance(0.01)) {
      if (rival_) {
        gather(rival_, false), rival_.reset();
      } else {
        rival_ = std::make_unique<Program>(network_, MemoryNetwork::address(3, ++rival_port_),
                                           options(Side::master, slave_address()), numbers(), lives_, copies_, now_);
      }
    }
    if (events_.strangers) strangers();
  }

  void strangers() {
    if (chance(0.02) && !stranger_)
      stranger_ = std::make_unique<Program>(network_, MemoryNetwork::address(4, ++rival_port_),
                                            options(Side::master, slave_address(), kOtherScene), numbers(), lives_,
                                            copies_, now_);
    if (chance(0.02)) stranger_.reset();
    if (copies_.empty() || !chance(0.3)) return;
    const Tap::Copy& copy = copies_[random_() % copies_.size()];
    // From where it came from, which is a very late packet, or from elsewhere.
    const Endpoint from = chance(0.5) ? copy.datagram.from : MemoryNetwork::address(5, 5);
    network_.send(copy.datagram.bytes(), from, copy.to, now_);
    std::array<std::byte, 64> noise;
    for (std::byte& b : noise) b = static_cast<std::byte>(random_());
    network_.send(noise, from, copy.to, now_);
  }

  void calm() {
    if (rival_) gather(rival_, false);
    rival_.reset();
    stranger_.reset();
    slave_hangs_until_ = master_hangs_until_ = now_;
    MemoryNetwork::Conditions c;
    c.impairment.delay_s = 0.005;
    network_.set_conditions(c);
    if (!slave_) start_slave();
    if (!master_) start_master();
  }

  void tick() {
    // Either first, by turns.
    const bool slave_first = random_() % 2 == 0;
    if (slave_first) tick(slave_, slave_hangs_until_, true);
    tick(master_, master_hangs_until_, false);
    tick(rival_, now_, false);
    if (stranger_) stranger_->tick(now_);
    if (!slave_first) tick(slave_, slave_hangs_until_, true);
  }
  void tick(std::unique_ptr<Program>& program, Duration hangs_until, bool is_slave) {
    if (!program || now_ < hangs_until) return;
    const bool paired = program->link().pairings() > 0;
    program->tick(now_);
    if (program->ended() && is_slave && paired) out_.paired_slave_ended = true;
    if (!program->ended()) return;
    // Told to the user, who starts it again; in the calm that is the end of it.
    out_.words = std::string{program->link().reject_reason()};
    gather(program, is_slave);
    if (now_ >= kTurbulence) out_.sentence = true;
    if (now_ < kTurbulence) program.reset();
  }
  void gather(const std::unique_ptr<Program>& program, bool) {
    if (!program) return;
    out_.mixed = out_.mixed || program->mixed;
    out_.ended_while_coupled = out_.ended_while_coupled || program->ended_while_coupled;
  }

  bool together() {
    gather(slave_, true), gather(master_, false);
    return slave_ && master_ && slave_->link().coupled(now_) && master_->link().coupled(now_) &&
           slave_->link().handshake().peer() == master_->socket.local();
  }
  bool settled() {
    if (out_.sentence) return true;
    if (!together()) return false;
    return slave_->mail.known().has_report && master_->mail.known().has_report &&
           slave_->mail.known().received_at > now_ - 2 * kTick && master_->mail.known().received_at > now_ - 2 * kTick;
  }

  std::mt19937_64 random_;
  Events events_;
  MemoryNetwork network_;
  Lives lives_;
  std::vector<Tap::Copy> copies_;
  std::unique_ptr<Program> slave_, master_, rival_, stranger_;
  std::uint16_t master_port_ = 0, rival_port_ = 0;
  Duration now_{0}, slave_hangs_until_{0}, master_hangs_until_{0};
  Outcome out_;
};

/// How many of each kind; more with TWOPORT_SCHEDULES=100000 in the environment.
int schedules() {
  const char* wanted = std::getenv("TWOPORT_SCHEDULES");
  return wanted ? std::atoi(wanted) : kSanitized ? 100 : 1000;
}

/// Runs the schedules of seeds from `seed` on and asserts what holds in each of them.
void expect_sound(std::uint64_t seed, const Events& events) {
  const int count = schedules();
  int sentences = 0, restarts = 0;
  Duration longest{0};
  const auto begin = std::chrono::steady_clock::now();
  for (int k = 0; k < count; ++k) {
    SCOPED_TRACE("schedule " + std::to_string(seed + static_cast<std::uint64_t>(k)));
    const Outcome out = Schedule{seed + static_cast<std::uint64_t>(k), events}.run();
    ASSERT_FALSE(out.mixed) << "running totals were read against those of another session";
    ASSERT_FALSE(out.ended_while_coupled) << out.words;
    ASSERT_FALSE(out.paired_slave_ended) << out.words;
    ASSERT_TRUE(out.coupled || out.sentence) << "neither coupled nor told why after " << out.after.count() << " ns";
    ASSERT_LE(out.after, kCalmWithin);
    if (!events.competing_masters && !events.strangers && !events.damage) {
      ASSERT_FALSE(out.sentence) << out.words;
    }
    sentences += out.sentence;
    restarts += out.restarts;
    longest = std::max(longest, out.after);
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  std::cout << count << " schedules, " << count / took.count() << " a second; " << restarts << " restarts; "
            << sentences << " ended with a sentence; coupled " << std::chrono::duration<double>(longest).count()
            << " s after the calm at the latest\n";
}

TEST(SessionSchedules, OfRestartsOfTheSlave) {
  expect_sound(1'000'000, {.slave_restarts = true});
}
TEST(SessionSchedules, OfRestartsOfTheMaster) {
  expect_sound(2'000'000, {.master_restarts = true});
}
TEST(SessionSchedules, OfRestartsOfBoth) {
  expect_sound(3'000'000, {.slave_restarts = true, .master_restarts = true});
}
TEST(SessionSchedules, OfTwoMastersThatCompete) {
  expect_sound(4'000'000, {.slave_restarts = true, .master_restarts = true, .competing_masters = true});
}
TEST(SessionSchedules, OfStrangersAndVeryLatePackets) {
  expect_sound(5'000'000, {.slave_restarts = true, .master_restarts = true, .strangers = true});
}
TEST(SessionSchedules, OfEverythingAndDamage) {
  expect_sound(6'000'000, {true, true, true, true, true});
}

}  // namespace
}  // namespace twoport::session_schedules_test
