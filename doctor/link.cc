#include "doctor/link.h"

#include <fmt/format.h>

#include <chrono>
#include <functional>
#include <memory>

#include "common/base/check.h"
#include "common/platform/live_link.h"
#include "common/platform/log.h"
#include "common/platform/realtime.h"
#include "common/scene/load.h"

namespace twoport::doctor {
namespace {

constexpr int kPolls = 4;  // of the socket, for each packet sent: transit times are known to a quarter of a period
constexpr double kPatience = 5.0;      // for the other side [s]
constexpr double kFiguresEvery = 0.2;  // the answering side sends its figures anew [s]

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

/// One end: sends a packet every period, and meters what arrives.
class End {
 public:
  End(Side side, const LinkRequest& request)
      : scene_{scene_of(request.rate_hz)}, link_{side, scene_, arguments_of(request)} {}

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
        packet.words = words_;
        transport.send(packet, now_);
      }
      return tick(now_);
    });
  }
  void begin() {
    meter_ = std::make_unique<DirectionMeter>();
    other_ = {};
    words_.clear();
    sent_before_ = sent_;  // numbers go on, as the programs' do
    state_ = {};
    clock_ = {};
    round_trip_ = Histogram{};
    ++sessions_;
    since_ = now_;
  }
  void receive(const Report<3>& r) {
    now_ = clock_now_();
    // A side that has heard nothing yet answers invitations: not a packet each period.
    if (r.echo_ns >= 0) meter_->on(r.sequence, Duration{r.sent_ns}, now_);
    from_words(r.words, other_);
    if (state_.has_report && r.sequence <= state_.newest.sequence) return;
    state_.newest = r;
    state_.received_at = now_;
    state_.has_report = state_.is_new = true;
    if (state_.round_trip() >= Duration{0}) round_trip_.add(state_.round_trip());
    clock_.step(state_);
  }

  Scene scene_;
  LiveLink<3> link_;
  std::unique_ptr<DirectionMeter> meter_ = std::make_unique<DirectionMeter>();
  PeerState<3> state_;
  DirectionFigures other_;  ///< of the packets that this side has sent, by the other
  Words words_;
  Histogram round_trip_;
  ClockOffset clock_;
  std::uint64_t sent_ = 0, sent_before_ = 0, sessions_ = 0;
  std::function<Duration()> clock_now_;
  Duration now_{0}, since_{0};
};

}  // namespace

LinkFigures measure_link(const LinkRequest& request, const std::atomic<bool>& stop) {
  const auto end = std::make_unique<End>(Side::master, request);
  bool too_late = false;
  end->run(request, stop, [&](Duration now) {
    if (!end->link_.refusal().empty()) return false;
    if (end->sessions_ == 0) {
      too_late = to_seconds(now).si() > kPatience;
      return !too_late;
    }
    return to_seconds(now - end->since_).si() < request.seconds;
  });
  if (!end->link_.refusal().empty()) throw IoError{refused(request, std::string{end->link_.refusal()})};
  if (end->sessions_ == 0)
    throw IoError{fmt::format("nobody answered at {} within {:g} s; start twoport-lab doctor --answer {} there{}",
                              request.address, kPatience, request.address,
                              request.key.empty() ? "" : " with the same --key")};
  constexpr double kSilent = 0.5;  // [s]
  if (const double silent = to_seconds(end->meter_->silence(end->now_)).si(); silent > kSilent)
    throw IoError{fmt::format("{} has been silent for the last {:.1f} s of {:.1f} s; was it ended?", request.address,
                              silent, to_seconds(end->now_ - end->since_).si())};
  LinkFigures f;
  f.seconds = to_seconds(end->now_ - end->since_).si();
  f.sent = static_cast<double>(end->sent_ - end->sent_before_);
  f.encrypted = !request.key.empty();
  f.round_trip = end->round_trip_;
  f.clock_known = end->clock_.known();
  if (f.clock_known) f.clock = end->clock_.figures(to_seconds(end->now_).si());
  f.to_slave = end->other_;
  f.to_master = end->meter_->figures(end->now_);
  return f;
}

void answer(const LinkRequest& request, const std::atomic<bool>& stop) {
  const auto end = std::make_unique<End>(Side::slave, request);
  spdlog::logger log = make_log("doctor");
  end->link_.say_where(log);
  Duration figures_at{0};
  std::uint64_t said = 0;
  end->run(request, stop, [&](Duration now) {
    if (end->sessions_ != said) {
      said = end->sessions_;
      log.info("measurement {} begins", said);
    }
    if (now >= figures_at) {
      figures_at = now + to_duration(kFiguresEvery);
      end->words_ = to_words(end->meter_->figures(now));
    }
    return end->link_.refusal().empty() && to_seconds(now).si() < request.seconds;
  });
}

}  // namespace twoport::doctor
