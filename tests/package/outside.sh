#!/usr/bin/env bash
# Installs the build, builds a program outside the tree against it, runs it: outside.sh BUILD_DIR
set -euo pipefail
build=$(readlink -f "$1")
here=$(dirname "$(readlink -f "$0")")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

cmake --install "$build" --prefix "$work/prefix" >/dev/null
launcher=$(sed -n 's/^CMAKE_CXX_COMPILER_LAUNCHER:[A-Z]*=//p' "$build/CMakeCache.txt")
compiler=$(sed -n 's/^CMAKE_CXX_COMPILER:[A-Z]*=//p' "$build/CMakeCache.txt")
# -Wundef and the like are the user's choice: nothing of the build's own options may come with the package.
grep -rqE 'Werror|Wconversion|twoport_options' "$work/prefix" --include='*.cmake' &&
  { echo "the package carries the build's own options"; exit 1; }
cmake -S "$here/outside" -B "$work/build" -G Ninja -D CMAKE_BUILD_TYPE=Release -D "CMAKE_PREFIX_PATH=$work/prefix" \
  -D "CMAKE_CXX_COMPILER=$compiler" ${launcher:+-D "CMAKE_CXX_COMPILER_LAUNCHER=$launcher"}
cmake --build "$work/build"
"$work/prefix/bin/twoport-lab" --version
"$work/build/all_layers"
"$here/plugin.sh" "$work/prefix" "$compiler" "$launcher"
"$here/hardware.sh" "$work/prefix" "$compiler" "$launcher"
"$work/build/outside" | tee "$work/said"

# The plain wall creates energy; passivated it creates at most a quarter of that.
awk '
  { for (i = 1; i < NF; ++i) if ($i == "smallest") least[$1] = $(i + 1) }
  END {
    if (!(least["plain"] < -1e-3)) { print "the plain wall should have created energy, got " least["plain"] " J"; exit 1 }
    if (!(least["passivated"] > 0.25 * least["plain"])) { print "passivated: " least["passivated"] " J"; exit 1 }
  }' "$work/said"
