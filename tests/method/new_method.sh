#!/usr/bin/env bash
# A new layer is a folder, a line of the list, and its name and block in the schema: adds these of the example of docs/guides/add-a-method.md
# to a tree of its own, compiles there what reads scenes, makes halves and writes figures, and looks for its option and its figures.
# new_method.sh COMPILER PROTOC EIGEN_INCLUDE LIBRARY...
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
compiler=$1 protoc=$2 eigen=$3
shift 3
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

mkdir -p "$work/common/method/transparency" "$work/proto"
cp -r tests/method/local_damping "$work/common/method/transparency/"
# change FILE SED...: a copy of FILE, changed.
change() {
  local file=$1
  shift
  sed "$@" "$file" >"$work/$file"
  ! cmp -s "$file" "$work/$file" || { echo "$file: no place for the new method"; exit 1; }
}
change common/method/transparency/list.h 's|^#include ".*/delayed_force/layer.h"|&\n#include "common/method/transparency/local_damping/layer.h"|'
change proto/scene.proto -e 's/^ *DELAYED_FORCE = 0;/& LOCAL_DAMPING = 1000;/' \
  -e 's/^ *optional TransparencyPlugin plugin = .*/&\n  optional LocalDamping local_damping = 1000;/' \
  -e '$a message LocalDamping { optional double damping_n_s_per_m = 1 [default = 2, (must_be) = ">= 0"]; }'

cat >"$work/main.cc" <<'CC'
#include <google/protobuf/text_format.h>

#include <cstdio>
#include <sstream>
#include <string>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/method/layers.h"
#include "common/record/contact_figures.h"
#include "common/record/trace.h"
#include "common/scene/blocks.h"

namespace {
using namespace twoport;

ControlOptions read(const char* control) {
  schema::Control message;
  if (!google::protobuf::TextFormat::ParseFromString(control, &message)) std::puts("the schema lacks it");
  const Context context{.file = "scene", .dof = 3};
  return read_control(Block{context, message, "control"}, SceneFor::laboratory);
}

/// A tick of a run with this result leaves the figures of both halves in trace and summary.
bool leaves_its_figures(const MasterOutput<3>& out, const std::string& folder) {
  const Row<3> row{.master_f = out.f, .figures = out.figures, .touching = true, .coupled = true};
  const std::string trace = folder + "/trace.csv";
  {
    WholeFile file{trace};
    Trace<3>{file}.add(row);
    file.commit();
  }
  std::istringstream text{read_whole(trace)};
  std::string header, values;
  std::getline(text, header) && std::getline(text, values);
  std::printf("%s\n%s\n", header.c_str(), values.c_str());
  ContactFigures<3> figures{1000.0, std::nullopt};
  figures.add(row, out.f.vec(), out.f.squared_norm());
  Summary summary;
  figures.fill(summary, true, true, 1.0, 1000.0);
  const double power_w = Figure::named("local_damping_power_w").of(summary), robot = Figure::named("robot_speed_m_per_s").of(summary);
  std::printf("layer_figures.mean of the summary: %g W, %g m/s\n", power_w, robot);
  return header.ends_with(",local_damping_power_w,robot_speed_m_per_s") && values.ends_with(",0.75,0.25") && power_w == 0.75 &&
         robot == 0.25;
}
}  // namespace

int main(int, char** arguments) {
  if (read("").local_damping.damping_n_s_per_m != 2.0) return 1;
  const ControlOptions options =
      read("transparency { layer: LOCAL_DAMPING local_damping { damping_n_s_per_m: 3 } } passivity { layer: NONE }");
  Held<MasterHalf<3>> half{options};
  Held<SlaveHalf<3>> slave_half{options};
  DeviceSample<3> device;
  device.v = Velocity<3>{Eigen::Vector3d{0.5, 0, 0}};
  PeerState<3> slave, master;
  RobotSample<3> robot;
  robot.v = Velocity<3>{Eigen::Vector3d{0, 0.25, 0}};
  const Registration<3> worlds{options};
  slave_half->step({.dt = Seconds{1e-3}, .robot = robot, .master = master, .commanded = robot.x, .worlds = worlds, .master_energy_in = {},
                    .master_energy_net = {}, .account = {}, .coupled = true, .active = true, .bridge = nullptr});
  slave_half->write_payload(slave.words, worlds);
  const MasterOutput<3> out =
      half->step({.dt = Seconds{1e-3}, .ended = Seconds{1e-3}, .device = device, .interval = {}, .first = true, .slave = slave,
                 .slave_energy_in = {}, .account = {}, .active = true, .ramp = 1.0});
  std::printf("%g N\n", out.f[0]);
  if (out.f[0] != 1.5 || !leaves_its_figures(out, arguments[1])) return 1;
  try {
    read("architecture: RENDER transparency { layer: LOCAL_DAMPING }");
  } catch (const ConfigError& e) {
    std::puts(e.what());
    return 0;
  }
  std::puts("a layer is not refused where there is none");
  return 1;
}
CC
cp proto/{field,summary}.proto "$work/proto/"
"$protoc" --proto_path="$work" --cpp_out="$work" proto/{scene,field,summary}.proto
objects=0
for file in "$work"/proto/{scene,field,summary}.pb.cc common/record/{figure,held_force,trace}.cc common/scene/control.cc common/scene/find.cc \
  common/scene/reader.cc common/scene/text.cc common/method/{catalogue,dof_3}.cc common/hardware/transparency_process.cc common/hardware/plugin_trial.cc \
  "$work/main.cc"; do
  objects=$((objects + 1))
  "$compiler" -std=c++20 -I"$work" -I. -isystem "$eigen" -c "$file" -o "$work/$objects.o"
done
"$compiler" "$work"/*.o "$@" -pthread -o "$work/program"
"$work/program" "$work"

# An entry of a passivity layer that states no claim does not compile.
mkdir -p "$work/unclaimed/common/method/passivity/none"
sed 's/\.claim = Claim{}/.claim = {}/' common/method/passivity/none/layer.h >"$work/unclaimed/common/method/passivity/none/layer.h"
"$compiler" -std=c++20 -I"$work/unclaimed" -I. -isystem "$eigen" -fsyntax-only -x c++ common/coupling/layers.h 2>"$work/errors" &&
  { echo "a layer without a claim compiles"; exit 1; }
grep 'each passivity layer states a claim' "$work/errors"

# Nor does the name of a figure that no layer declares.
echo 'int main() { return static_cast<int>(twoport::layer_figure("local_dampin_power_w")); }' >"$work/name.cc"
"$compiler" -std=c++20 -I"$work" -I. -isystem "$eigen" -fsyntax-only -include common/coupling/layers.h "$work/name.cc" 2>"$work/errors" &&
  { echo "a wrong name of a figure compiles"; exit 1; }
grep -m 1 'layer_figure' "$work/errors"
