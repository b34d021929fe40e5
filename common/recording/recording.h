#pragma once

#include <cstdint>
#include <istream>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/hardware/device.h"
#include "common/mcap/reader.h"
#include "common/mcap/writer.h"
#include "common/recording/tick.h"

namespace twoport {

/// Follows "master" and "slave" in the name of the side and of the channels of their gripper.
inline constexpr std::string_view kOfGripper = "/gripper";

/// What the node of a side was made from.
struct RecordingHeader {
  std::string program;  ///< name and version
  std::string side;     ///< "master", "slave"; of their gripper "master/gripper", "slave/gripper"
  int dof = 0;
  double rate_hz = 0.0;
  std::string scene_file, scene_text;
  std::vector<std::string> overrides;  ///< PATH=VALUE, in order
  bool live = false;                   ///< two programs; else the laboratory
  std::string hardware;
  std::optional<DeviceInfo> properties;  ///< what the driver says; of a robot `limits` only
  std::int64_t start_unix_ns = 0;        ///< tick time 0; 0 in the laboratory
  int joints = 0;                        ///< of a port of joints; 0: none

  /// Coordinates of the port that there are.
  [[nodiscard]] int coordinates() const { return joints > 0 ? joints : dof; }
  [[nodiscard]] bool of_master() const { return side.starts_with("master"); }
  [[nodiscard]] bool of_gripper() const { return side.ends_with(kOfGripper); }
};

/// Writes one side of a recording: channel /SIDE/header with one message, and /SIDE/tick.
class RecordingSide {
 public:
  RecordingSide(mcap::Channels& to, const RecordingHeader& header);

  template <int N>
  void add(const TickRecord<N>& tick, std::span<const Report<N>> received);
  [[nodiscard]] std::uint64_t log_time_ns(Duration now) const;

 private:
  mcap::Channels* to_;
  std::int64_t start_unix_ns_;
  bool master_;
  std::uint16_t channel_;
  std::string bytes_;
};

/// A tick as recorded, with the reports received in it.
template <int N>
struct RecordedTick {
  TickRecord<N> tick;
  std::vector<Report<N>> received;
};

/// Reads a recording. Throws ConfigError with its name and the reason for what is damaged or is no recording of these
/// programs.
class RecordingReader {
 public:
  explicit RecordingReader(const std::string& path);
  RecordingReader(std::unique_ptr<std::istream> in, std::string name);

  /// What the next message is of. Ticks of sides whose header has not come are skipped.
  enum class Kind : std::uint8_t { header, tick, other, end };
  Kind next();

  [[nodiscard]] const std::string& topic() const { return message_.channel->topic; }
  [[nodiscard]] const mcap::Message& message() const { return message_; }
  [[nodiscard]] const RecordingHeader& header() const { return header_; }  ///< the newest; after Kind::header
  /// After Kind::tick. False where the numbers do not fit `N`.
  template <int N>
  [[nodiscard]] bool tick(RecordedTick<N>& into);
  [[nodiscard]] bool torn() const { return reader_->torn(); }
  [[noreturn]] void fail(const std::string& why) const;

 private:
  std::string name_;
  std::unique_ptr<std::istream> in_;
  std::unique_ptr<mcap::Reader> reader_;
  mcap::Message message_{};
  RecordingHeader header_;
};

}  // namespace twoport
