#pragma once

#include <string>
#include <vector>

#include "common/mcap/writer.h"
#include "common/record/row.h"
#include "common/record/trace_channel.h"
#include "common/scene/scene.h"
#include "lab/engine/tap.h"

namespace twoport::lab {

/// What a run is recorded with.
struct RecordingOptions {
  std::string path, scene_file, scene_text;
  std::vector<std::string> overrides;
  std::string* unwritten = nullptr;  ///< takes why the file is not complete; null: the run throws IoError
};

/// The path of `options`. Throws ConfigError for a scene without a node.
const std::string& recordable(const Scene& scene, const RecordingOptions& options);
extern const char* const kRecordedBy;  ///< name and version of this program

/// Both sides of a run in virtual time, or of its gripper, with the trace, into a file that must outlive this.
template <int N>
class LabRecording {
 public:
  LabRecording(mcap::Writer& file, const Scene& scene, const RecordingOptions& options, bool of_gripper);

  [[nodiscard]] Taps<N>& taps() { return taps_; }
  void add(const Row<N>& row);

 private:
  TraceChannel<N> trace_;
  Taps<N> taps_;
};

}  // namespace twoport::lab
