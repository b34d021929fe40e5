#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/base/file.h"
#include "common/mcap/writer.h"
#include "common/platform/foxglove_server.h"
#include "common/platform/program.h"
#include "common/record/row.h"
#include "common/record/trace_channel.h"
#include "common/recording/feed.h"
#include "common/recording/recording.h"

namespace twoport {

/// Where a live recording goes: the file of --record, who listens at --foxglove, or both. The main coupling and the gripper write into it,
/// each from its recording thread.
class RecordingOutput final : public mcap::Channels {
 public:
  /// Throws ConfigError where the file cannot be written or the address cannot be bound.
  RecordingOutput(const LiveArguments& a, const std::string& program) {
    if (!a.record.empty()) {
      file_.emplace(a.record, program);
      flush();
      if (!error().empty()) throw ConfigError{"--record " + error()};
    }
    if (!a.foxglove.empty()) listeners_.emplace(a.foxglove, program);
  }
  std::uint16_t add_channel(std::string_view topic, std::string_view schema, std::string_view descriptors,
                            const mcap::Metadata& metadata) override {
    std::uint16_t id = 0;  // the same in both: all channels are added here
    if (file_) id = file_->add_channel(topic, schema, descriptors, metadata);
    if (listeners_) id = listeners_->add_channel(topic, schema, descriptors, metadata);
    return id;
  }
  void write(std::uint16_t channel, std::uint64_t log_time_ns, std::string_view message) override {
    if (file_) file_->write(channel, log_time_ns, message);
    if (listeners_) listeners_->write(channel, log_time_ns, message);
  }
  void flush() {
    if (file_) file_->flush();
  }
  void close() {
    if (file_) file_->close();
  }
  [[nodiscard]] std::string error() const { return file_ ? file_->error() : std::string{}; }
  [[nodiscard]] const std::optional<FoxgloveServer>& listeners() const noexcept { return listeners_; }

  mutable std::mutex mutex;  ///< of all of it

 private:
  std::optional<mcap::Writer> file_;
  std::optional<FoxgloveServer> listeners_;
};

/// The recording of one side of a live run, or of its gripper: a feed from the cycle, and what the recording thread makes of it. A
/// file is whole after the first ticks, and then after every half second.
template <int N>
class LiveRecording {
 public:
  LiveRecording(std::shared_ptr<RecordingOutput> to, RecordingHeader header)
      : header_{std::move(header)}, to_{std::move(to)} {}

  /// Before the first tick: its time.
  void start_at(std::int64_t unix_ns) { header_.start_unix_ns = unix_ns; }
  [[nodiscard]] TickFeed<N>& feed() noexcept { return feed_; }

  // From the recording thread.
  void drain() {
    const std::lock_guard lock{to_->mutex};
    const bool begins = !side_;
    while (feed_.try_pop(entry_)) {
      if (!side_) {
        side_.emplace(*to_, header_);
        trace_.emplace(*to_, "/" + header_.side + "/trace", header_.coordinates());
      }
      if (entry_.is_tick) {
        side_->add(entry_.tick, std::span<const Report<N>>{received_});
        received_.clear();
        if (entry_.tick.t_s >= 0.0) met_at_ = entry_.tick.now - to_duration(entry_.tick.t_s);
      } else {
        received_.push_back(entry_.tick.sent);
      }
    }
    // A program that is killed within the first half second leaves a recording too.
    if (begins && side_) to_->flush();
  }
  void add(const Row<N>& row) {
    const std::lock_guard lock{to_->mutex};
    if (trace_) trace_->add(side_->log_time_ns(met_at_ + to_duration(row.t_s)), row);
  }
  [[nodiscard]] std::string error() const {
    const std::lock_guard lock{to_->mutex};
    return to_->error();
  }

  /// After the last tick, when the threads have ended, and drain() of the gripper: completes the file. Throws IoError where not
  /// everything was written.
  void finish() {
    drain();
    to_->close();
  }
  [[nodiscard]] const std::shared_ptr<RecordingOutput>& output() const noexcept { return to_; }
  [[nodiscard]] std::uint64_t missing() const noexcept { return feed_.missing(); }

 private:
  RecordingHeader header_;
  std::shared_ptr<RecordingOutput> to_;
  TickFeed<N> feed_;
  typename TickFeed<N>::Entry entry_;
  std::optional<RecordingSide> side_;
  std::optional<TraceChannel<N>> trace_;
  std::vector<Report<N>> received_;
  Duration met_at_{0};
};
TWOPORT_DECLARE(LiveRecording);

/// `hardware`: what the driver says, a DeviceInfo or RobotInfo.
template <class Info>
RecordingHeader recording_header(const LiveArguments& a, const std::string& side, bool of_gripper, int dof,
                                 double rate_hz, const Info& hardware, int joints = 0) {
  DeviceInfo properties;
  if constexpr (std::is_same_v<Info, DeviceInfo>) {
    properties = hardware;
  } else {
    properties.limits = hardware.limits;
  }
  return {.program = program_name(side),
          .side = of_gripper ? std::string{side}.append(kOfGripper) : side,
          .dof = dof,
          .rate_hz = rate_hz,
          .scene_file = a.scene,
          .scene_text = read_whole(a.scene),
          .overrides = a.set,
          .live = true,
          .hardware = hardware.name,
          .properties = properties,
          .start_unix_ns = 0,
          .joints = joints};
}

/// Null where nothing is recorded and nobody can listen.
template <int N, class Info>
std::unique_ptr<LiveRecording<N>> open_recording(const LiveArguments& a, const std::string& side, double rate_hz,
                                                 const Info& hardware, int joints) {
  if (a.record.empty() && a.foxglove.empty()) return nullptr;
  return std::make_unique<LiveRecording<N>>(std::make_shared<RecordingOutput>(a, program_name(side)),
                                            recording_header(a, side, false, N, rate_hz, hardware, joints));
}

}  // namespace twoport
