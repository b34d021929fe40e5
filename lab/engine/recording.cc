#include "lab/engine/recording.h"

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/base/time.h"

namespace twoport::lab {
namespace {

std::string name_of(bool master, bool of_gripper) {
  return std::string{master ? "master" : "slave"}.append(of_gripper ? kOfGripper : "");
}

template <int N>
SideTap<N> side(mcap::Writer& file, const Scene& scene, const RecordingOptions& o, bool master, bool of_gripper) {
  const bool rendered = scene.control.architecture == Architecture::render;
  if (rendered && !master) return {};
  return {file,
          {.program = kRecordedBy,
           .side = name_of(master, of_gripper),
           .dof = N,
           .rate_hz = master ? scene.master_rate_hz : scene.slave_rate_hz,
           .scene_file = o.scene_file,
           .scene_text = o.scene_text,
           .overrides = o.overrides,
           .live = false,
           .hardware = master ? "simulated device" : "simulated robot",
           .properties = std::nullopt,
           .start_unix_ns = 0,
           .joints = scene.joints}};
}

}  // namespace

const char* const kRecordedBy = "twoport-lab " TWOPORT_VERSION;

const std::string& recordable(const Scene& scene, const RecordingOptions& o) {
  if (scene.control.architecture == Architecture::uncontrolled)
    throw ConfigError{"--record " + o.path + ": control.architecture is UNCONTROLLED, so there is no node to record"};
  return o.path;
}

template <int N>
LabRecording<N>::LabRecording(mcap::Writer& file, const Scene& scene, const RecordingOptions& o, bool of_gripper)
    : trace_{file, of_gripper ? "/master/gripper/trace" : "/master/trace", scene.coordinates()},
      taps_{side<N>(file, scene, o, true, of_gripper), side<N>(file, scene, o, false, of_gripper)} {
  file.flush();  // a file without ticks is whole too
}

template <int N>
void LabRecording<N>::add(const Row<N>& row) {
  trace_.add(static_cast<std::uint64_t>(to_duration(row.t_s).count()), row);
}

TWOPORT_COMPILE(LabRecording);

}  // namespace twoport::lab
