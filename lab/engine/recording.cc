#include "lab/engine/recording.h"

#include "common/base/check.h"
#include "common/base/time.h"

namespace twoport::lab {
namespace {

constexpr const char* kProgram = "twoport-lab " TWOPORT_VERSION;

template <int N>
SideTap<N> side(mcap::Writer& file, const Scene& scene, const RecordingOptions& o, bool master) {
  const bool rendered = scene.control.architecture == Architecture::render;
  if (rendered && !master) return {};
  return {file,
          {.program = kProgram,
           .side = master ? "master" : "slave",
           .dof = N,
           .rate_hz = master ? scene.master_rate_hz : scene.slave_rate_hz,
           .scene_file = o.scene_file,
           .scene_text = o.scene_text,
           .overrides = o.overrides,
           .live = false,
           .hardware = master ? "simulated device" : "simulated robot",
           .properties = std::nullopt,
           .start_unix_ns = 0}};
}

std::string checked(const Scene& scene, const std::string& path) {
  if (scene.control.architecture == Architecture::uncontrolled)
    throw ConfigError{"--record " + path + ": control.architecture is UNCONTROLLED, so there is no node to record"};
  if (scene.gripper) throw ConfigError{"--record " + path + ": the scene has a gripper, which no recording holds"};
  return path;
}

}  // namespace

template <int N>
LabRecording<N>::LabRecording(const Scene& scene, const RecordingOptions& o)
    : file_{checked(scene, o.path), kProgram},
      trace_{file_, "/master/trace"},
      taps_{side<N>(file_, scene, o, true), side<N>(file_, scene, o, false)} {
  file_.flush();  // a file without ticks is whole too
}

template <int N>
void LabRecording<N>::add(const Row<N>& row) {
  trace_.add(static_cast<std::uint64_t>(to_duration(row.t_s).count()), row);
}

template <int N>
void LabRecording<N>::finish() {
  file_.close();
}

template class LabRecording<1>;
template class LabRecording<3>;
template class LabRecording<6>;

}  // namespace twoport::lab
