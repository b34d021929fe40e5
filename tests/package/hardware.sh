#!/usr/bin/env bash
# Drivers of one's own, as docs/guides/add-a-device.md and add-a-robot.md say: hardware.sh PREFIX COMPILER LAUNCHER
# Builds docs/examples/own_hardware against the tree installed in PREFIX and runs both programs together; then adds the example
# to a copy of drivers/ by one file and one line.
set -euo pipefail
prefix=$1 compiler=$2 launcher=$3
root=$(dirname "$(readlink -f "$0")")/../..
work=$(mktemp -d)
slave=''
trap '[ -z "$slave" ] || kill "$slave" 2>/dev/null || true; rm -rf "$work"' EXIT

build() {
  cmake -S "$1" -B "$2" -G Ninja -D CMAKE_BUILD_TYPE=Release -D "CMAKE_PREFIX_PATH=$prefix" \
    -D "CMAKE_CXX_COMPILER=$compiler" ${launcher:+-D "CMAKE_CXX_COMPILER_LAUNCHER=$launcher"} >"$work/log"
  cmake --build "$2" >"$work/log" || { cat "$work/log"; exit 1; }
}
fail() { echo "$1"; cat "$work"/*.said 2>/dev/null; exit 1; }
figure() { sed -n "s/^ \"$2\": \([^,]*\),*$/\1/p" "$work/$1/summary.json"; }

# Outside the tree: own programs, the example's drivers at both ends.
build "$root/docs/examples/own_hardware" "$work/own"
"$work/own/own-master" --list-devices | grep -q "^own	the rail" || fail "own-master does not list the driver"
"$work/own/own-slave" --list-devices | grep -q "^sim	" || fail "own-slave has lost the drivers of the tree"
port=$((32000 + $$ % 700))
"$work/own/own-slave" --scene "$root/docs/examples/own_hardware/scene.textproto" --duration 6 --robot own --listen "127.0.0.1:$port" \
  --out "$work/slave" >"$work/slave.said" 2>&1 &
slave=$!
"$work/own/own-master" --scene "$root/docs/examples/own_hardware/scene.textproto" --duration 4 --device own:1 --peer "127.0.0.1:$port" \
  --out "$work/master" >"$work/master.said" 2>&1 || fail "own-master failed"
wait "$slave" || fail "own-slave failed"
slave=''
# The hand goes to 40 mm and the wall begins at 20 mm: the cart presses it, and the hand feels no more than the device
# displays.
[ "$(figure master mode)" = '"coupled"' ] || fail "not coupled"
pressed=$(awk -F, 'NR == 1 { for (i = 1; i <= NF; ++i) if ($i == "env_f_0") c = i; next } -$c > most { most = -$c } END { print most + 0 }' \
  "$work/slave/trace.csv")
awk -v f="$(figure master max_force_n)" -v pressed="$pressed" 'BEGIN { exit !(pressed > 1 && f > 0.5 && f <= 6.0001) }' ||
  fail "pressed with $pressed N, felt $(figure master max_force_n) N"
grep -q "hardware: rail of the example" "$work/master.said" || fail "the log does not name the device"

# A size that the driver does not have, and arguments that it does not take.
says() { ! "$@" >"$work/out" 2>"$work/err" || fail "$* did not fail"; cat "$work/err"; }
says "$work/own/own-master" --scene "$root/scenes/demo.textproto" --device own |
  grep -q "own: drives dof 1, but dof of the scene is 3" || fail "wrong size: $(cat "$work/err")"
says "$work/own/own-master" --scene "$root/docs/examples/own_hardware/scene.textproto" --device own:9 |
  grep -q "own:9: no rail at this port" || fail "wrong port: $(cat "$work/err")"

# In the tree: one file, one line. The drivers that are there are left out: they take long to compile. The copy of the tree includes the
# installed headers.
mkdir "$work/tree"
cp -r "$root/drivers" "$work/tree/"
cp "$root/docs/examples/own_hardware/"{own_device.cc,vendor.h} "$work/tree/drivers/"
sed -i 's/^twoport_driver(sim.*/twoport_driver(own_device)/; t; /^twoport_driver(/d' "$work/tree/drivers/CMakeLists.txt"
cp "$root/master/main.cc" "$work/tree/"
sed -i -E -e 's@^#include "common/@#include "twoport/@' -e 's@^#include "(drivers|master|slave|sim)/@#include "twoport/\1/@' \
  "$work/tree/main.cc" "$work/tree/drivers/"*.{cc,h,txt}
cat >"$work/tree/CMakeLists.txt" <<'END'
cmake_minimum_required(VERSION 3.25)
project(tree LANGUAGES CXX)
find_package(twoport REQUIRED)
add_subdirectory(drivers)
add_executable(twoport-master main.cc)
target_link_libraries(twoport-master PRIVATE twoport::master_program twoport_drivers)
END
build "$work/tree" "$work/tree/build"
[ "$("$work/tree/build/twoport-master" --list-devices | cut -f 1 | tr '\n' ' ')" = "own PATH.so[:ARGS] " ] || fail "one file and one line do not list the driver"
echo "drivers of one's own: outside the tree, and in it by one file and one line"
