#include "tools/doctor/link.h"

#include <algorithm>
#include <chrono>
#include <deque>
#include <functional>
#include <memory>
#include <vector>

#include "common/base/check.h"
#include "common/base/fmt.h"
#include "common/platform/live_link.h"
#include "common/platform/log.h"
#include "common/platform/realtime.h"
#include "common/scene/load.h"

namespace twoport::doctor {
namespace {

constexpr int kPolls = 4;  // of the socket, for each packet sent: transit times are known to a quarter of a period
constexpr double kPatience = 5.0;  // for the other side [s]
constexpr double kSilent = 0.5;    // longer than any gap of a link in use, and three periods [s]
constexpr double kLate = 0.5;      // after the measurement: for packets that are still on their way [s]
constexpr double kReturn = 5.0;    // and at most, for what the other side has to tell [s]
constexpr int kTold = 5;           // arrivals in a packet of the answering side

Scene scene_of(double rate_hz) {
  return parse_scene(
      fmt::format("name: \"doctor\" dof: 3 rate_hz: {} control {{ passivity {{ method: NONE }} }}", rate_hz), "doctor",
      {}, SceneFor::live);
}

/// Why the other side does not answer, and what to do.
std::string refused(const LinkRequest& request, const std::string& why) {
  const auto says = [&](const char* part) { return why.find(part) != std::string::npos; };
  if (says(" is busy")) return request.address + " is busy with another program; try again when that has ended";
  if (says(" in the rate "))
    return fmt::format("{} answers at another rate than {:g} Hz; give both doctors the same --rate-hz", request.address,
                       request.rate_hz);
  if (says(" answers no measurement"))
    return request.address + " is a program with a scene; end it, and start twoport-lab doctor --answer there";
  return request.address + " refuses: " + why;
}

LiveArguments arguments_of(const LinkRequest& request) {
  LiveArguments a;
  a.address = request.address;
  a.key = request.key;
  a.insecure = request.insecure;
  a.measures = true;
  return a;
}

/// One end: sends a packet every period, and notes what arrives. The answering end tells the other one what it has noted, again and
/// again, until that has acknowledged it.
class End {
 public:
  End(Side side, const LinkRequest& request)
      : answers_{side == Side::slave}, scene_{scene_of(request.rate_hz)}, link_{side, scene_, arguments_of(request)} {}

  /// Calls `tick(now)` kPolls times in a period until it returns false.
  template <class Tick>
  void run(const LinkRequest& request, const std::atomic<bool>& stop, Tick tick) {
    PeriodicLoop loop{{.rate_hz = kPolls * request.rate_hz, .spin = false}};
    const auto start = std::chrono::steady_clock::now();
    // Moments are read where they happen: a tick's own time would add what the loop is late.
    clock_now_ = [start] { return Duration{std::chrono::steady_clock::now() - start}; };
    loop.run(stop, [&](std::int64_t k, Duration) {
      now_ = clock_now_();
      auto& transport = link_.mail().transport();
      if (transport.take_new_session()) begin();
      transport.poll(now_, [&](const Report<3>& r) { receive(r); });
      if (k % kPolls == 0) {
        now_ = clock_now_();
        Report<3> packet;
        packet.sequence = ++sent_;
        packet.sent_ns = now_.count();
        packet.echo_ns = state_.has_report ? state_.newest.sent_ns + (now_ - state_.received_at).count() : -1;
        if (answers_) {
          tell(packet.words);
        } else {
          sent_s_.push_back(to_seconds(now_).si());
          payload::put(packet.words, static_cast<double>(returned_known_));
        }
        transport.send(packet, now_);
      }
      return tick(now_);
    });
  }
  void begin() {
    arrivals_.clear();
    returned_.clear();
    sent_s_.clear();
    forgotten_ = told_ = returned_known_ = 0;
    sent_before_ = sent_;  // numbers go on, as the programs' do
    state_ = {};
    returned_newest_ = 0;
    clock_ = {};
    round_trip_ = Histogram{};
    ++sessions_;
    since_ = now_;
  }
  void receive(const Report<3>& r) {
    now_ = clock_now_();
    // A side that has heard nothing yet answers invitations: not a packet each period.
    if (r.echo_ns >= 0 && static_cast<double>(arrivals_.size()) < kMostPackets) {
      const Duration sent{r.sent_ns};
      arrivals_.push_back({r.sequence, to_seconds(sent).si(), to_seconds(now_ - sent).si()});
      last_arrival_ = now_;
    }
    if (answers_) {
      forget(r.words);
    } else {
      learn(r.words);
    }
    if (state_.has_report && r.sequence <= state_.newest.sequence) return;
    state_.newest = r;
    state_.received_at = now_;
    state_.has_report = state_.is_new = true;
    if (state_.round_trip() >= Duration{0}) round_trip_.add(state_.round_trip());
    clock_.step(state_);
  }

  /// Number of the first arrival told, then sequence and transit of each.
  void tell(Words& words) {
    const std::size_t end = forgotten_ + arrivals_.size();
    if (told_ < forgotten_ || told_ >= end) told_ = forgotten_;
    payload::put(words, static_cast<double>(told_));
    for (int n = 0; n < kTold && told_ < end; ++n, ++told_) {
      const Arrival& a = arrivals_[told_ - forgotten_];
      payload::put(words, static_cast<double>(a.sequence));
      payload::put(words, a.transit_s);
    }
  }
  void forget(const Words& words) {
    if (words.count != 1) return;
    for (; static_cast<double>(forgotten_) < words.at[0] && !arrivals_.empty(); ++forgotten_) arrivals_.pop_front();
  }
  void learn(const Words& words) {
    if (words.count == 0 || !(words.at[0] >= 0.0 && words.at[0] < kMostPackets)) return;
    auto number = static_cast<std::size_t>(words.at[0]);
    for (std::size_t at = 1; at + 1 < words.count; at += 2, ++number) {
      const double of_this = words.at[at] - static_cast<double>(sent_before_);
      if (!(of_this >= 1.0 && of_this <= static_cast<double>(sent_s_.size()))) continue;
      if (number >= returned_.size()) returned_.resize(number + 1);
      returned_[number] = {static_cast<std::uint64_t>(words.at[at]), sent_s_[static_cast<std::size_t>(of_this) - 1],
                           words.at[at + 1]};
    }
    for (; returned_known_ < returned_.size() && returned_[returned_known_].sequence > 0; ++returned_known_)
      returned_newest_ = std::max(returned_newest_, returned_[returned_known_].sequence);
  }

  bool answers_;
  Scene scene_;
  LiveLink<3> link_;
  PeerState<3> state_;
  std::deque<Arrival> arrivals_;   ///< here; those that are told and acknowledged are forgotten
  std::vector<Arrival> returned_;  ///< there, as told
  std::vector<double> sent_s_;     ///< of each packet of this session
  std::size_t forgotten_ = 0, told_ = 0, returned_known_ = 0;  ///< numbers of arrivals; all before the last are known
  std::uint64_t returned_newest_ = 0;                          ///< sequence
  Histogram round_trip_;
  ClockOffset clock_;
  std::uint64_t sent_ = 0, sent_before_ = 0, sessions_ = 0;
  std::function<Duration()> clock_now_;
  Duration now_{0}, since_{0}, last_arrival_{0};
};

}  // namespace

LinkFigures measure_link(const LinkRequest& request, const std::atomic<bool>& stop) {
  const auto end = std::make_unique<End>(Side::master, request);
  std::uint64_t last_sent = 0, last_heard = 0;  // numbers of the last packets within the measurement
  const auto note_last = [&] { last_sent = end->sent_, last_heard = end->state_.newest.sequence; };
  const double most_silent_s = std::max(kSilent, 3.0 / request.rate_hz);
  const auto silent_s = [&] { return to_seconds(end->now_ - std::max(end->last_arrival_, end->since_)).si(); };
  end->run(request, stop, [&](Duration now) {
    if (!end->link_.refusal().empty()) return false;
    if (end->sessions_ == 0) return to_seconds(now).si() <= kPatience;
    const double over_s = to_seconds(now - end->since_).si() - request.seconds;
    if (over_s < 0.0) {
      last_sent = 0;
      return true;
    }
    if (last_sent == 0) note_last();
    const auto later = static_cast<std::uint64_t>(0.8 * kLate * request.rate_hz);
    const bool told = end->returned_newest_ > last_sent + later;
    return silent_s() < most_silent_s && over_s < kReturn && (over_s < kLate || !told);
  });
  if (last_sent == 0) note_last();
  if (!end->link_.refusal().empty()) throw IoError{refused(request, std::string{end->link_.refusal()})};
  if (end->sessions_ == 0)
    throw IoError{fmt::format("nobody answered at {} within {:g} s; start twoport-lab doctor --answer {} there{}",
                              request.address, kPatience, request.address,
                              request.key.empty() ? "" : " with the same --key")};
  const double silent = silent_s() >= most_silent_s ? silent_s() : 0.0;
  const std::vector<Arrival> here{end->arrivals_.begin(), end->arrivals_.end()};
  const std::span there{end->returned_.data(), end->returned_known_};
  if (here.empty() || there.empty())
    throw IoError{
        fmt::format("{} has answered, but no packet of the measurement came through in {:.1f} s; measure for "
                    "longer, with --seconds",
                    request.address, to_seconds(end->now_ - end->since_).si())};
  LinkFigures f;
  f.silent_s = silent;
  f.seconds = std::min(request.seconds, to_seconds(end->now_ - end->since_).si() - silent);
  f.sent = static_cast<double>(last_sent - end->sent_before_);
  f.encrypted = !request.key.empty();
  f.round_trip = end->round_trip_;
  f.clock_known = end->clock_.known();
  if (f.clock_known) f.clock = end->clock_.figures(to_seconds(end->now_).si());
  const double ahead_s = clocks_apart_s(there, here), since_s = to_seconds(end->since_).si();
  f.to_slave = way_of(there, std::min(last_sent, end->returned_newest_), ahead_s, since_s);
  f.to_master = way_of(here, last_heard, -ahead_s, since_s + ahead_s);
  if (f.to_slave.packets.empty() || f.to_master.packets.empty()) return f;
  const double begin_s = std::min(f.to_slave.packets.front().sent_s, f.to_master.packets.front().sent_s);
  for (TracedWay* way : {&f.to_slave.packets, &f.to_master.packets})
    for (TracedPacket& packet : *way) packet.sent_s -= begin_s;
  return f;
}

void answer(const LinkRequest& request, const std::atomic<bool>& stop) {
  const auto end = std::make_unique<End>(Side::slave, request);
  spdlog::logger log = make_log("doctor");
  end->link_.say_where(log);
  std::uint64_t said = 0;
  end->run(request, stop, [&](Duration now) {
    if (end->sessions_ != said) {
      said = end->sessions_;
      log.info("measurement {} begins", said);
    }
    return end->link_.refusal().empty() && to_seconds(now).si() < request.seconds;
  });
}

}  // namespace twoport::doctor
