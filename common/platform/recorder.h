#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <optional>
#include <string>
#include <thread>

#include "common/base/built_for.h"
#include "common/base/ring.h"
#include "common/link/sensor_rest.h"
#include "common/platform/live_recording.h"
#include "common/platform/log.h"
#include "common/platform/plot_stream.h"
#include "common/record/metrics.h"
#include "common/record/trace.h"
#include "common/safety/limits.h"
#include "common/wire/codec.h"

namespace twoport {

/// Data of a tick for the live view, besides its row.
struct TickView {
  Duration late{0};            ///< wake-up latency of the tick
  Duration round_trip{-1};     ///< of the newest report; negative: not known
  std::uint64_t received = 0;  ///< packets from the other side so far
  std::uint64_t lost = 0;
  std::uint64_t sessions = 0;        ///< of the other side so far; 0 where there is none
  std::uint64_t refused = 0;         ///< datagrams so far that were none of the other side
  std::uint64_t stale = 0;           ///< reports so far that were too old to count
  Mode peer_mode = Mode::idle;       ///< as the newest report says, whatever its age
  Duration silence{0};               ///< since that report came
  bool answers = true;               ///< does it send back a new stamp of this side?
  std::uint64_t let_go = 0;          ///< ticks so far in which the hardware had let go by itself
  const char* stopped_by = nullptr;  ///< null: not stopped
  LimitCounts limits{};
  std::uint32_t epoch = 0;  ///< of the method
  unsigned switches = 0;    ///< asked for by hand so far
  SensorRest sensor{};      ///< of the robot
};

/// The recording thread of a live run: takes rows from the cycle through a ring buffer, writes the trace, computes the
/// summary, shows progress and logs the state of the link. The cycle never waits for it; if the ring is full, a row is
/// counted, not recorded.
template <int N>
class Recorder {
 public:
  struct Options {
    Metrics<N> metrics;
    int size = N;                             ///< number of coordinates of a port
    WholeFile* trace;                         ///< null: none. The caller commits it after finish()
    LiveRecording<N>* recording;              ///< null: none. The caller finishes it after finish()
    PlotStream* stream;                       ///< null: none
    double duration_s;                        ///< planned; infinity: until somebody ends it
    Side side;                                ///< whose port is shown
    std::uint64_t trace_every;                ///< one row in so many
    std::vector<std::string> configurations;  ///< of the schedule, in words; epoch e has that of e modulo their number
    spdlog::logger& log;
    bool shows_progress = true;  ///< false: of a second recorder of the program
  };
  /// Progress goes to stderr: one line rewritten on a terminal, else none.
  explicit Recorder(Options options) : o_{std::move(options)}, ring_{kRows} {
    limit_at_s_.fill(kNever);
    if (o_.trace) trace_.emplace(*o_.trace, o_.size);
    thread_ = std::thread{[this] { drain(); }};
  }
  ~Recorder() { stop(); }
  Recorder(const Recorder&) = delete;

  /// From the cycle.
  void push(const Row<N>& row, const TickView& view) noexcept { ring_.try_push({row, view, true}); }
  /// The same before the other side has come: for the log only. `t_s`: since the start of the program.
  void push_waiting(double t_s, const TickView& view) noexcept { ring_.try_push({Row<N>{.t_s = t_s}, view, false}); }
  /// Has a recorded value diverged? The cycle then ends the run.
  [[nodiscard]] bool diverged() const noexcept { return diverged_.load(std::memory_order_relaxed); }

  /// After the last push: what was recorded.
  Summary finish() {
    stop();
    Summary s;
    o_.metrics.fill(s);
    return s;
  }
  [[nodiscard]] std::uint64_t dropped() const { return ring_.dropped(); }

 private:
  static constexpr std::size_t kRows = 8192;
  static constexpr double kNever = -1e9, kSayEvery = 10.0;  // [s]
  static constexpr int kMostChanges = 50;                   // of the link, said in kSayEvery
  struct Entry {
    Row<N> row;
    TickView view;
    bool recorded;  ///< false: for the log only
  };

  void stop() {
    done_.store(true, std::memory_order_release);
    if (thread_.joinable()) thread_.join();
  }
  void drain();
  void show(const Entry& newest);
  /// A count that is said when it has changed: at once, then at most every kSayEvery. While the other side has not come, `now` is the
  /// program's time.
  struct SaidCount {
    std::uint64_t said = 0;
    double at_s = kNever;
    bool is_due(std::uint64_t count, double now) {
      if (count == said || (now >= at_s && now < at_s + kSayEvery)) return false;
      said = count;
      at_s = now;
      return true;
    }
  };
  void log_change(const Entry& entry);
  void log_limits(const Entry& entry);
  void log_counts(const Entry& entry);
  void log_sensor(const Entry& entry);
  [[nodiscard]] const char* peer() const { return o_.side == Side::master ? "slave" : "master"; }
  [[nodiscard]] std::string why_apart(const TickView& view) const;
  void log_ignored_switch(const Entry& entry);
  void say(const Entry& at, const std::string& text);
  void say_change(const Entry& at, const std::string& text);
  void say_untold(const Entry& at);
  void record(const Entry& newest);

  Options o_;
  std::optional<Trace<N>> trace_;
  Ring<Entry> ring_;
  std::atomic<bool> done_{false}, diverged_{false};

  // Of the thread.
  double shown_s_ = -1.0;
  Mode mode_ = Mode::idle;  ///< of the newest row, as is the next
  std::uint64_t sessions_ = 0;
  bool paired_ = false;              ///< said so, and not coupled yet
  double changes_since_s_ = kNever;  ///< the changes below
  int told_ = 0, untold_ = 0;
  std::uint64_t rows_ = 0;
  SaidCount refused_, let_go_, stale_;
  LimitCounts limits_;                      ///< as last seen
  std::array<double, kLimits> limit_at_s_;  ///< when each was said last
  bool stopped_ = false;                    ///< said so
  std::uint32_t epoch_ = 0;
  unsigned switches_ = 0;
  std::uint32_t zero_answers_ = 0;
  double drift_said_n_ = 0.0;
  Duration latest_{0};         ///< latest tick since the line was shown
  double dissipated_j_ = 0.0;  ///< by the controller since then
  bool terminal_ = false;
  bool recording_failed_ = false;  ///< said so
  std::thread thread_;
};

TWOPORT_DECLARE(Recorder);

}  // namespace twoport
