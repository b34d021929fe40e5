#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/base/built_for.h"
#include "common/mcap/writer.h"
#include "common/record/row.h"
#include "common/record/trace_table.h"
#include "common/recording/recording.h"

namespace twoport {

/// The rows of trace.csv as a channel of a recording: one field for each column of common/record/columns.h, all digits kept.
template <int N>
class TraceChannel {
 public:
  TraceChannel(mcap::Channels& to, const std::string& topic, int size = N);
  void add(std::uint64_t log_time_ns, const Row<N>& row);

 private:
  mcap::Channels* to_;
  int size_;
  std::uint16_t channel_;
  std::string bytes_;
};

TWOPORT_DECLARE(TraceChannel);

struct ExportedTrace {
  std::string path;
  std::uint64_t rows;
};
/// Where export_trace writes the trace of a gripper: DIR/NAME.csv becomes DIR/NAME-gripper.csv.
std::string gripper_csv(const std::string& path);
/// Writes the trace of a recording as trace.csv has it into `path`, and that of its gripper, where it has one, into
/// gripper_csv(path); each whole or not at all. Where it has none, a file of that name becomes earlier_file(). Returns what was
/// written. Throws ConfigError for a recording without a trace.
std::vector<ExportedTrace> export_trace(RecordingReader& recording, const std::string& path);

/// What a recording says of one run.
struct RecordedRun {
  RecordingHeader header;  ///< of the first side
  std::shared_ptr<const TraceTable> trace;
  std::shared_ptr<const TraceTable> gripper;  ///< null: it has none
};
/// Reads the traces of a recording into memory, all digits kept. Throws ConfigError for a recording without a trace.
RecordedRun read_run(RecordingReader& recording);

}  // namespace twoport
