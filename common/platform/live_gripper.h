#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>

#include "common/base/built_for.h"
#include "common/base/file.h"
#include "common/base/print_error.h"
#include "common/link/mailbox.h"
#include "common/platform/live_recording.h"
#include "common/platform/log.h"
#include "common/platform/plot_stream.h"
#include "common/platform/program.h"
#include "common/platform/recorder.h"
#include "common/recording/tick.h"
#include "common/runtime/cycle.h"
#include "common/runtime/modes.h"
#include "common/safety/guarded_transport.h"
#include "common/wire/link_transport.h"

namespace twoport {

/// The gripper of a live side: a second node with its own hardware, account and rows, in the tick and in the packets of the main one.
/// Whatever lets go of the main coupling lets go of the gripper. Side has, for one degree of freedom, what run_live needs of a side
/// (kSide, Clock, Hardware, Sample, scene, hardware, node, metrics(), complete(row, sample)), and
///
///     row(t_s, sample, out, peer)   the row of a tick; `peer` is what is known of the other side
template <class Side_, int N>
class LiveGripper {
 public:
  using Clock = typename Side_::Clock;
  using Sample = typename Side_::Sample;

  template <class... Arguments>
  explicit LiveGripper(LinkTransport<N>& link, const PortLimits& of_the_other_side, const TransmissionOptions& incoming,
                       Arguments&&... arguments)
      : side_{std::forward<Arguments>(arguments)...},
        mail_{Transport{of_the_other_side, link}, age_of_reports(side_.scene.control), incoming} {}

  /// Before the first tick. `output`: of the recording; null: none.
  void begin(const LiveArguments& a, double duration_s, spdlog::logger& log, std::shared_ptr<RecordingOutput> output) {
    constexpr bool kMaster = Side_::kSide == Side::master;
    if (output) {
      const double rate_hz = kMaster ? side_.scene.master_rate_hz : side_.scene.slave_rate_hz;
      recording_ = std::make_unique<LiveRecording<1>>(
          std::move(output),
          recording_header(a, kMaster ? "master" : "slave", true, 1, rate_hz, side_.hardware.info()));
      mail_.transport().tap(&recording_->feed());
    }
    if (!a.stream.empty()) stream_.emplace(a.stream, Side_::kSide, a.stream_hz, true);
    if (!a.out.empty() && a.trace == "csv") trace_ = std::make_unique<WholeFile>(a.out + "/trace-gripper.csv");
    recorder_.emplace(typename Recorder<1>::Options{.metrics = side_.metrics(),
                                                    .trace = trace_.get(),
                                                    .recording = recording_.get(),
                                                    .stream = stream_ ? &*stream_ : nullptr,
                                                    .duration_s = duration_s,
                                                    .side = Side_::kSide,
                                                    .trace_every = a.trace_every,
                                                    .configurations = {},
                                                    .log = log,
                                                    .shows_progress = false});
    log.info("gripper: {}", side_.hardware.info().name);
  }
  /// Just before the first tick: its time.
  void start_at(std::int64_t unix_ns) {
    if (recording_) recording_->start_at(unix_ns);
  }

  // In every tick, in this order.

  /// A session of the other side begins.
  void meet(Duration since) noexcept {
    side_.node.on_peer_restart(Energy{mail_.known().energy_in_j});
    static_cast<void>(mail_.transport().take_new_session());
    mail_.reset(since);
    meets_ = true;
    since_ = since;
  }
  void start() noexcept { side_.hardware.start(); }
  /// `t_s`: since the link came up; -1 before. `lets_go`: the main hardware has let go by itself. `held`: the operator holds the
  /// handle.
  void cycle(const Tick<Clock>& tick, double t_s, bool lets_go, bool held) noexcept {
    Plant plant{side_.hardware, sample_, seen_, lets_go, held};
    if (recording_) recording_->feed().begin(t_s, side_.node.epoch(), meets_, side_.node.epoch(), since_);
    meets_ = false;
    out_ = run_cycle(side_.node, plant, mail_, tick);
    if (recording_) recording_->feed().end(tick, seen_, out_);
  }
  /// Completes the last row; begins one where `has_row`.
  void record(double t_s, bool has_row) noexcept {
    if (has_row_) {
      side_.complete(row_, sample_);
      recorder_->push(row_, {});
    }
    has_row_ = has_row;
    if (has_row) row_ = side_.row(t_s, sample_, out_, mail_.known());
  }
  [[nodiscard]] const Sample& sample() const noexcept { return sample_; }
  [[nodiscard]] const auto& out() const noexcept { return out_; }
  [[nodiscard]] const auto& node() const noexcept { return side_.node; }
  [[nodiscard]] const auto& known() const noexcept { return mail_.known(); }
  [[nodiscard]] bool fault() const noexcept { return sample_.status == HardwareStatus::fault; }
  [[nodiscard]] bool diverged() const noexcept { return recorder_->diverged(); }

  // After the last tick.

  void release() noexcept { side_.hardware.release(); }
  /// The last row and tick are recorded. Before the file of the recording is completed.
  void end() {
    if (has_row_) recorder_->push(row_, {});
    summary_ = recorder_->finish();
    mail_.transport().tap(nullptr);
    if (recording_) recording_->drain();
  }
  /// Ticks that are not in the recording.
  [[nodiscard]] std::uint64_t missing() const noexcept { return recording_ ? recording_->missing() : 0; }
  /// Why a fault came, for why_failed().
  [[nodiscard]] std::string trouble() const {
    const std::string why = side_.hardware.trouble();
    return why.empty() ? "the gripper" : "the gripper: " + why;
  }
  /// After end(). Leaves the trace, and fills the gripper's figures. False where the trace could not be written, which is said.
  bool finish(Summary& s, const char* side) {
    Summary own = std::move(summary_);
    own.set_mode(to_string(side_.node.mode()));
    fill_own_limits<Side_::kSide>(side_.node.limit_counts(), own);
    *own.mutable_limits()->mutable_peer() = limits_of_peer(mail_.transport().limit_counts());
    if (own.verdict_kind() == twoport::to_string(VerdictKind::undecided)) own.clear_stable();
    fill_gripper(own, s);
    if (!trace_) return true;
    try {
      trace_->commit_rows();
    } catch (const std::exception& e) {
      print_error("twoport-{}: {}\n", side, e.what());
      return false;
    }
    return true;
  }

 private:
  using Output = typename Side_::Output;
  using Hardware = typename Side_::Hardware;

  /// Hardware for run_cycle. A reading that the node may not use is none.
  struct Plant {
    Hardware& hardware;
    Sample &sample, &seen;
    bool lets_go, held;
    Sample sense(const Tick<Clock>& tick) noexcept {
      sample = hardware.sense(tick);
      Sample s = sample;
      if constexpr (requires { s.held; }) s.held = s.held && held;
      if (lets_go) [[unlikely]]
        s.x = Position<1>{typename Position<1>::Vector{std::numeric_limits<double>::quiet_NaN()}};
      seen = s;
      return s;
    }
    template <class Command>
    void actuate(const Command& command) noexcept {
      if (lets_go) [[unlikely]]
        return hardware.release();
      hardware.actuate(command);
    }
  };

  using Transport = TappedTransport<1, GuardedTransport<1, GripperTransport<N>>>;

  Side_ side_;
  Mailbox<1, Transport> mail_;
  std::unique_ptr<WholeFile> trace_;
  std::unique_ptr<LiveRecording<1>> recording_;  ///< null: none
  std::optional<PlotStream> stream_;
  std::optional<Recorder<1>> recorder_;
  Summary summary_;
  Sample sample_, seen_;  ///< the hardware's newest reading, and what the node was given of it
  bool meets_ = false;    ///< a session of the other side has begun since the last tick
  Duration since_{0};     ///< of that session
  Output out_{};
  Row<1> row_;
  bool has_row_ = false;
};

/// In place of LiveGripper where a side has none: a virtual environment, and a build without one degree of freedom, which refuses scenes with
/// a gripper.
struct NoGripper {
  void begin(auto&&...) {}
  void start_at(std::int64_t) {}
  void meet(Duration) noexcept {}
  void start() noexcept {}
  void cycle(auto&&...) noexcept {}
  void record(double, bool) noexcept {}
  void release() noexcept {}
  void end() {}
  [[nodiscard]] static bool fault() noexcept { return false; }
  [[nodiscard]] static bool diverged() noexcept { return false; }
  [[nodiscard]] static std::uint64_t missing() noexcept { return 0; }
  [[nodiscard]] static std::string trouble() { return {}; }
  static bool finish(auto&&...) { return true; }
};
template <class Side, int N>
using GripperOf = std::conditional_t<built_for(1), LiveGripper<Side, N>, NoGripper>;

}  // namespace twoport
