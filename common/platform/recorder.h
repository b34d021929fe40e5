#pragma once

#include <atomic>
#include <optional>
#include <string>
#include <thread>

#include "common/record/metrics.h"
#include "common/record/trace.h"
#include "common/runtime/ring.h"

namespace twoport {

/// The cold side of a live run: a thread that takes rows from the cycle through a ring, writes the trace, adds up the
/// summary and shows progress. The cycle never waits for it; a row that finds the ring full is counted, not recorded.
template <int N>
class Recorder {
 public:
  /// No trace where `trace_path` is empty. Progress goes to stderr: one line rewritten on a terminal, else none.
  Recorder(Metrics<N> metrics, const std::string& trace_path, double duration_s)
      : metrics_{std::move(metrics)}, duration_s_{duration_s}, ring_{kRows} {
    if (!trace_path.empty()) trace_.emplace(trace_path);
    thread_ = std::thread{[this] { drain(); }};
  }
  ~Recorder() { stop(); }
  Recorder(const Recorder&) = delete;

  /// From the cycle.
  void push(const Row<N>& row) noexcept { ring_.try_push(row); }
  /// Has a recorded value run away? The cycle ends the run then.
  [[nodiscard]] bool diverged() const noexcept { return diverged_.load(std::memory_order_relaxed); }

  /// After the last push: what was recorded. The trace is put in place after the summary, so that a disk that is full
  /// does not cost both.
  Summary finish() {
    stop();
    Summary s;
    metrics_.fill(s);
    return s;
  }
  /// Throws IoError when the trace could not be written.
  void close_trace() {
    if (trace_) trace_->close();
  }
  [[nodiscard]] std::uint64_t dropped() const { return ring_.dropped(); }

 private:
  static constexpr std::size_t kRows = 8192;

  void stop() {
    done_.store(true, std::memory_order_release);
    if (thread_.joinable()) thread_.join();
  }
  void drain();
  void show(const Row<N>& row);

  Metrics<N> metrics_;
  double duration_s_, shown_s_ = -1.0;
  std::optional<Trace<N>> trace_;
  Ring<Row<N>> ring_;
  std::atomic<bool> done_{false}, diverged_{false};
  std::thread thread_;
};

extern template class Recorder<1>;
extern template class Recorder<3>;
extern template class Recorder<6>;

}  // namespace twoport
