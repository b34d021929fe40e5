#!/usr/bin/env bash
# A new method is one folder and one line: takes the example of docs/howto/add-a-method.md into the catalogue and compiles what
# builds halves by name. new_method.sh COMPILER EIGEN_INCLUDE
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
compiler=$1 eigen=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

mkdir -p "$work/common/method"
cp -r tests/method/local_damping "$work/common/method/"
sed -e 's/^using Methods = TypeList<\(.*\)>;/using Methods = TypeList<\1, LocalDamping>;/' \
  -e 's|^#include "common/method/none/none.h"|&\n#include "common/method/local_damping/local_damping.h"|' \
  common/method/catalogue.h >"$work/common/method/catalogue.h"
! cmp -s common/method/catalogue.h "$work/common/method/catalogue.h" || { echo "the list of methods was not found"; exit 1; }

cat >"$work/main.cc" <<'CC'
#include <cstdio>
#include "common/method/any.h"
#include "common/method/catalogue.h"
int main() {
  using namespace twoport;
  static_assert(MethodOf<LocalDamping, 1> && MethodOf<LocalDamping, 3> && MethodOf<LocalDamping, 6>);
  ControlOptions o;
  o.method_name = "LOCAL_DAMPING";
  AnyMasterHalf<3> half{o};
  DeviceSample<3> device;
  device.v = Velocity<3>{Eigen::Vector3d{0.5, 0, 0}};
  PeerState<3> slave;
  const MasterOutput<3> out =
      half.step({.dt = Seconds{1e-3}, .ended = Seconds{1e-3}, .device = device, .interval = {}, .first = true, .slave = slave,
                 .slave_energy_in = {}, .account = {}, .active = true, .ramp = 1.0, .carried = nullptr});
  std::printf("%g N\n", out.f[0]);
  return out.f[0] == 1.0 ? 0 : 1;
}
CC
"$compiler" -std=c++20 -I"$work" -I. -isystem "$eigen" "$work/main.cc" common/method/any.cc -o "$work/program"
"$work/program"
