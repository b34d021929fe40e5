#!/usr/bin/env bash
# A new layer is one folder and three lines: takes the example of docs/guides/add-a-method.md into the list of names, the catalogue and
# the schema, compiles what reads its name and builds its halves. new_method.sh COMPILER PROTOC EIGEN_INCLUDE LIBRARY...
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
compiler=$1 protoc=$2 eigen=$3
shift 3
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

mkdir -p "$work/common/method/transparency" "$work/common/coupling" "$work/proto"
cp -r tests/method/local_damping "$work/common/method/transparency/"
# change FILE SED...: a copy of FILE, changed.
change() {
  local file=$1
  shift
  sed "$@" "$file" >"$work/$file"
  ! cmp -s "$file" "$work/$file" || { echo "$file: no place for the new method"; exit 1; }
}
change common/coupling/layers.h 's|^    {.name = "DELAYED_FORCE",.*|&\n    {.name = "LOCAL_DAMPING", .summary = "the delayed force and a damper at the master"},|'
change common/method/classes.h -e 's|^  visit(Classes<DelayedForceMaster,.*|&\n  visit(Classes<LocalDampingMaster, DelayedForceSlave>{"LOCAL_DAMPING"});|' \
  -e 's|^#include "common/method/transparency/random/random.h"|&\n#include "common/method/transparency/local_damping/local_damping.h"|'
change proto/scene.proto 's/^ *DELAYED_FORCE = 0;/& LOCAL_DAMPING = 1000;/'

cat >"$work/main.cc" <<'CC'
#include <google/protobuf/text_format.h>

#include <cstdio>

#include "common/base/check.h"
#include "common/method/layers.h"
#include "common/scene/blocks.h"

namespace {
using namespace twoport;

ControlOptions read(const char* control) {
  schema::Control message;
  if (!google::protobuf::TextFormat::ParseFromString(control, &message)) std::puts("the schema lacks it");
  const Context context{.file = "scene", .dof = 3};
  return read_control(Block{context, message, "control"}, SceneFor::laboratory);
}
}  // namespace

int main() {
  Held<MasterHalf<3>> half{read("transparency { layer: LOCAL_DAMPING } passivity { layer: NONE }")};
  DeviceSample<3> device;
  device.v = Velocity<3>{Eigen::Vector3d{0.5, 0, 0}};
  PeerState<3> slave;
  const MasterOutput<3> out =
      half->step({.dt = Seconds{1e-3}, .ended = Seconds{1e-3}, .device = device, .interval = {}, .first = true, .slave = slave,
                 .slave_energy_in = {}, .account = {}, .active = true, .ramp = 1.0});
  std::printf("%g N\n", out.f[0]);
  if (out.f[0] != 1.0) return 1;
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
cp proto/field.proto "$work/proto/"
"$protoc" --proto_path="$work" --cpp_out="$work" proto/scene.proto proto/field.proto
objects=0
for file in "$work/proto/scene.pb.cc" "$work/proto/field.pb.cc" common/scene/control.cc common/scene/find.cc \
  common/scene/reader.cc common/scene/text.cc common/method/{catalogue,dof_3}.cc common/hardware/transparency_process.cc common/hardware/plugin_trial.cc \
  "$work/main.cc"; do
  objects=$((objects + 1))
  "$compiler" -std=c++20 -I"$work" -I. -isystem "$eigen" -c "$file" -o "$work/$objects.o"
done
"$compiler" "$work"/*.o "$@" -pthread -o "$work/program"
"$work/program"
