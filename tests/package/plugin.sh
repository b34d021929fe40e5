#!/usr/bin/env bash
# Plug-ins as docs/guides/add-a-device.md says: plugin.sh PREFIX COMPILER LAUNCHER
# Builds docs/examples/plugin against the tree installed in PREFIX, without its libraries, and runs the installed programs with them.
set -euo pipefail
prefix=$1 compiler=$2 launcher=$3
root=$(readlink -f "$(dirname "$(readlink -f "$0")")/../..")
work=$(mktemp -d)
slave=''
trap '[ -z "$slave" ] || kill "$slave" 2>/dev/null || true; rm -rf "$work"' EXIT
fail() { echo "$1"; cat "$work"/*.said 2>/dev/null; exit 1; }
figure() { sed -n "s/^ \"$2\": \([^,]*\),*$/\1/p" "$work/$1/summary.json"; }

# The example needs the installed headers only: no other package is looked for.
cmake -S "$root/docs/examples/plugin" -B "$work/build" -G Ninja -D CMAKE_BUILD_TYPE=Release -D "CMAKE_PREFIX_PATH=$prefix" \
  -D CMAKE_DISABLE_FIND_PACKAGE_Eigen3=ON -D CMAKE_DISABLE_FIND_PACKAGE_Protobuf=ON -D CMAKE_DISABLE_FIND_PACKAGE_fmt=ON \
  -D "CMAKE_CXX_COMPILER=$compiler" ${launcher:+-D "CMAKE_CXX_COMPILER_LAUNCHER=$launcher"} >"$work/log"
cmake --build "$work/build" >"$work/log" || { cat "$work/log"; exit 1; }
for file in rail cart scara; do
  lines=$(wc -l <"$root/docs/examples/plugin/$file.cc")
  [ "$lines" -lt 60 ] || fail "docs/examples/plugin/$file.cc has $lines lines; a driver should need fewer than 60"
done

"$prefix/bin/twoport-master" --list-devices | grep -q "^PATH.so" || fail "--list-devices does not name plug-ins"
# run SCENE ROBOT DEVICE
run() {
  "$prefix/bin/twoport-slave" --scene "$root/docs/examples/$1" --duration 6 --robot "$work/build/$2" --listen 127.0.0.1:0 \
    --out "$work/slave" >"$work/slave.said" 2>&1 &
  slave=$!
  for _ in $(seq 100); do grep -q 'listening on' "$work/slave.said" && break; sleep 0.1; done
  port=$(sed -n 's/.*listening on 127\.0\.0\.1:\([0-9]*\).*/\1/p' "$work/slave.said")
  [ -n "$port" ] || fail "the slave does not listen"
  "$prefix/bin/twoport-master" --scene "$root/docs/examples/$1" --duration 4 --device "$work/build/$3" --peer "127.0.0.1:$port" \
    --out "$work/master" >"$work/master.said" 2>&1 || fail "the master failed"
  wait "$slave" || fail "the slave failed"
  slave=''
  [ "$(figure master mode)" = '"coupled"' ] || fail "not coupled"
}
run plugin/scene.textproto scara.so scara.so
grep -q "hardware: arm of the example" "$work/master.said" || fail "the log does not name the arm"
run own_hardware/scene.textproto cart.so rail.so:1
# The hand goes to 40 mm and the wall begins at 20 mm: the cart presses it, and the hand feels no more than the device displays.
awk -v f="$(figure master max_force_n)" 'BEGIN { exit !(f > 0.5 && f <= 6.0001) }' ||
  fail "felt $(figure master max_force_n) N"
grep -q "hardware: rail of the example" "$work/master.said" || fail "the log does not name the device"
grep -q "hardware: cart of the example" "$work/slave.said" || fail "the log does not name the robot"

# What is wrong with a plug-in is said in one sentence, and the status is that of a wrong argument.
says() {
  local status=0
  "$prefix/bin/twoport-master" --scene "$root/docs/examples/own_hardware/scene.textproto" --device "$1" >"$work/out" 2>"$work/err" || status=$?
  [ "$status" -eq 2 ] && [ "$(wc -l <"$work/err")" -eq 1 ] && grep -qF "$2" "$work/err" || fail "$1: status $status, $(cat "$work/err")"
}
says "$work/build/rail.so:9" "no rail at port 9; connect it"
says "$work/build/cart.so" "it has no entry point twoport_device_plugin; it has one for --robot"
says "$work/build/none.so" "there is no such file"
echo "plug-ins: built against the installed headers, loaded and run"
