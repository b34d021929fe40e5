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

/// A recording of both sides of a run in virtual time, with its trace.
template <int N>
class LabRecording {
 public:
  /// Throws ConfigError for a scene without a node, or a file that cannot be written.
  LabRecording(const Scene& scene, const RecordingOptions& options);

  [[nodiscard]] Taps<N>& taps() { return taps_; }
  void add(const Row<N>& row);
  /// Completes the file. Throws IoError where not everything could be written.
  void finish();

 private:
  mcap::Writer file_;
  TraceChannel<N> trace_;
  Taps<N> taps_;
};

}  // namespace twoport::lab
