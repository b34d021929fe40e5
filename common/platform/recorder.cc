#include "common/platform/recorder.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <utility>

#include "common/base/built_for.h"
#include "common/base/print_error.h"
#include "common/base/thread.h"

namespace twoport {
namespace {

constexpr double kShowEvery = 0.1;  // [s]
constexpr Duration kSilent = std::chrono::milliseconds{50};

/// Columns of the terminal; 0 where it does not say.
std::size_t columns() {
  winsize size{};
  return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 ? size.ws_col : 0;
}

/// One line that replaces the one before.
void rewrite(std::string line) {
  if (const std::size_t width = columns(); width > 0 && line.size() >= width) line.resize(width - 1);
  print_error("\r{}\033[K", line);
  std::fflush(stderr);
}

}  // namespace

template <int N>
void Recorder<N>::drain() {
  Entry entry;
  take_ordinary_priority();
  terminal_ = o_.shows_progress && isatty(STDERR_FILENO) != 0;
  for (bool last = false; !last;) {
    last = done_.load(std::memory_order_acquire);
    bool any = false;
    if (o_.recording) record(entry);
    while (ring_.try_pop(entry)) {
      log_counts(entry);
      if (entry.view.stopped_by != nullptr && !std::exchange(stopped_, true))
        say(entry, fmt::format("stopped by {}: no force until both programs have ended", entry.view.stopped_by));
      if (entry.view.switches != switches_) log_ignored_switch(entry);
      log_sensor(entry);
      if (!entry.recorded) continue;
      any = true;
      if (rows_++ % o_.trace_every == 0) {
        if (trace_) trace_->add(entry.row);
        if (o_.recording) o_.recording->add(entry.row);
      }
      if (o_.stream) o_.stream->add(entry.row, entry.view);
      if (!o_.metrics.add(entry.row)) diverged_.store(true, std::memory_order_relaxed);
      if (entry.view.sessions > 0) log_change(entry);
      if (!(entry.view.limits == limits_)) log_limits(entry);
      latest_ = std::max(latest_, entry.view.late);
      dissipated_j_ += entry.row.dissipated_j;
    }
    if (any && terminal_ && entry.row.t_s > shown_s_ + kShowEvery) show(entry);
    if (!last) std::this_thread::sleep_for(std::chrono::milliseconds{20});
  }
  if (terminal_ && shown_s_ >= 0.0) std::fputs("\n", stderr);
  say_untold(entry);
}

/// The ticks first: they tell when the rows begin.
template <int N>
void Recorder<N>::record(const Entry& newest) {
  o_.recording->drain();
  if (o_.recording->error().empty() || std::exchange(recording_failed_, true)) return;
  say(newest, "the recording ends here; what was written stays readable: " + o_.recording->error());
}

template <int N>
void Recorder<N>::show(const Entry& newest) {
  const auto& [row, view, recorded] = newest;
  static_cast<void>(recorded);
  const bool master = o_.side == Side::master;
  std::string line = fmt::format("{:6.1f}", row.t_s);
  if (std::isfinite(o_.duration_s)) line += fmt::format(" / {:.1f}", o_.duration_s);
  line += fmt::format(" s   {:8}   force {:6.2f} N  port {:+9.4f} J", to_string(row.mode),
                      translational((master ? row.master_f : row.slave_f).vec()).norm(),
                      master ? row.master_energy_j : row.slave_energy_j);
  if (view.sessions > 0) {
    const double packets = static_cast<double>(std::max<std::uint64_t>(view.received + view.lost, 1));
    line += view.round_trip >= Duration{0} ? fmt::format("  rtt {:5.1f} ms", 1e3 * to_seconds(view.round_trip).si())
                                           : std::string{"  rtt       ms"};
    line += fmt::format("  lost {:4.1f} %", 100.0 * static_cast<double>(view.lost) / packets);
  }
  // Since the line was last shown.
  line += fmt::format("  late {:5.0f} us  controller {:6.1f} mW", 1e6 * to_seconds(latest_).si(),
                      1e3 * dissipated_j_ / std::max(row.t_s - std::max(shown_s_, 0.0), 1e-3));
  rewrite(std::move(line));
  shown_s_ = row.t_s;
  latest_ = Duration{0};
  dissipated_j_ = 0.0;
}

template <int N>
void Recorder<N>::say(const Entry& at, const std::string& text) {
  if (terminal_) std::fputs("\r\033[K", stderr);
  o_.log.info("{:.3f} s: {}", at.row.t_s, text);
}

/// A reading or a report that is bad in every other tick must not fill the disk.
template <int N>
void Recorder<N>::say_change(const Entry& at, const std::string& text) {
  if (at.row.t_s >= changes_since_s_ + kSayEvery) {
    say_untold(at);
    changes_since_s_ = at.row.t_s;
    told_ = 0;
  }
  if (told_ < kMostChanges) {
    ++told_;
    say(at, text);
  } else {
    ++untold_;
  }
}
template <int N>
void Recorder<N>::say_untold(const Entry& at) {
  if (const int more = std::exchange(untold_, 0); more > 0)
    say(at,
        fmt::format("{} more changes in the last {:.0f} s, which are not listed", more, at.row.t_s - changes_since_s_));
}

/// Each limit when it acts for the first time, then at most every kSayEvery.
template <int N>
void Recorder<N>::log_limits(const Entry& entry) {
  const double now = entry.row.t_s;
  for (std::size_t i = 0; i < kLimits; ++i) {
    if (entry.view.limits.of[i] == limits_.of[i]) continue;
    if (now < limit_at_s_[i] + kSayEvery) continue;
    limit_at_s_[i] = now;
    if (static_cast<Limit>(i) == Limit::pause) {
      say(entry, "this side stood still; the coupling begins anew");
    } else {
      say(entry, fmt::format("limit reached: {}, {} times so far", kLimitNames[i], entry.view.limits.of[i]));
    }
  }
  limits_ = entry.view.limits;
}

template <int N>
void Recorder<N>::log_counts(const Entry& entry) {
  const TickView& v = entry.view;
  if (refused_.is_due(v.refused, entry.row.t_s))
    say(entry, fmt::format("refused: {} datagrams so far, damaged or not of the {}", v.refused, peer()));
  if (let_go_.is_due(v.let_go, entry.row.t_s))
    say(entry,
        fmt::format("no force in {} ticks so far: readings of the hardware are not finite, or too old", v.let_go));
  // Where both sides hear each other a queue on the way has held them back.
  if (stale_.is_due(v.stale, entry.row.t_s))
    say(entry, fmt::format("reports of the {} that were too old to count: {} so far; {}", peer(), v.stale,
                           v.answers ? "they waited on the way, or one of the sides stood still"
                                     : fmt::format("the {} hears nothing of this side", peer())));
}

/// Answers to requests to zero the sensor; its drift when it counts as a contact, and then whenever it has doubled.
template <int N>
void Recorder<N>::log_sensor(const Entry& entry) {
  const SensorRest& s = entry.view.sensor;
  if (std::exchange(zero_answers_, s.answered) != s.answered) {
    const bool zeroed = s.answer == ZeroAnswer::zeroed;
    say(entry, std::string{sentence(s.answer)} +
                   (zeroed && s.taken_n > 0.0 ? fmt::format(": {:.2f} N are taken away", s.taken_n) : ""));
    if (zeroed) drift_said_n_ = 0.0;
  }
  if (s.drift_n <= std::max(kSensorDriftSaid_n, 2.0 * drift_said_n_)) return;
  drift_said_n_ = s.drift_n;
  say(entry, fmt::format("the force sensor reads {:.2f} N while nothing is pressed; z and Enter zeroes it", s.drift_n));
}

/// Why this side is not coupled, in words.
template <int N>
std::string Recorder<N>::why_apart(const TickView& view) const {
  if (view.peer_mode == Mode::ended) return fmt::format("the {} has ended", peer());
  if (view.silence > kSilent) return fmt::format("the {} is silent", peer());
  if (!view.answers) return fmt::format("the {} hears nothing of this side", peer());
  if (view.peer_mode == Mode::idle || view.peer_mode == Mode::released)
    return fmt::format("the {} has released", peer());
  return fmt::format("reports of the {} are too old", peer());
}

/// Where SIGUSR1 switches nothing.
template <int N>
void Recorder<N>::log_ignored_switch(const Entry& entry) {
  switches_ = entry.view.switches;
  if (o_.side == Side::slave) {
    say(entry, "SIGUSR1 does nothing here: send it to the master, which switches both sides");
  } else if (o_.configurations.empty()) {
    say(entry, "SIGUSR1 does nothing: the scene has no control.schedule to switch to");
  }
}

template <int N>
void Recorder<N>::log_change(const Entry& entry) {
  const Mode was = std::exchange(mode_, entry.row.mode);
  const std::uint64_t sessions = std::exchange(sessions_, entry.view.sessions);
  const auto tell = [&](const std::string& text) { say_change(entry, text); };
  if (sessions != entry.view.sessions) {
    tell(fmt::format("{} with the {}", sessions == 0 ? "paired" : "re-paired", peer()));
    paired_ = true;
  }
  if (std::exchange(epoch_, entry.view.epoch) != entry.view.epoch && !o_.configurations.empty())
    tell("switched to " + o_.configurations[epoch_ % o_.configurations.size()]);
  if (mode_ == was) return;
  switch (mode_) {
    case Mode::stopped:  // already said
    case Mode::ended:
      break;
    case Mode::idle:
      if (!paired_) tell(fmt::format("packets of the {} arrive again; waiting until it hears this side", peer()));
      break;
    case Mode::coupled:
      if (!std::exchange(paired_, false)) tell(fmt::format("coupled with the {} again", peer()));
      break;
    case Mode::holding:
      tell(why_apart(entry.view) + "; holding");
      break;
    case Mode::released:
      if (was == Mode::coupled && entry.view.peer_mode != Mode::ended)
        tell("released: this side stood still, a reading was not finite, or a plug-in failed");
      else
        tell("released: " + why_apart(entry.view));
      break;
    case Mode::let_go:
      tell("released: nobody holds the handle");
      break;
  }
}

TWOPORT_COMPILE(LiveRecording);
TWOPORT_COMPILE(Recorder);

}  // namespace twoport
