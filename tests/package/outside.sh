#!/usr/bin/env bash
# Installs the build, moves what is installed, builds programs outside the tree against it, runs them: outside.sh BUILD_DIR
set -euo pipefail
build=$(readlink -f "$1")
here=$(dirname "$(readlink -f "$0")")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

cmake --install "$build" --prefix "$work/installed" >/dev/null
mv "$work/installed" "$work/prefix"
launcher=$(sed -n 's/^CMAKE_CXX_COMPILER_LAUNCHER:[A-Z]*=//p' "$build/CMakeCache.txt")
compiler=$(sed -n 's/^CMAKE_CXX_COMPILER:[A-Z]*=//p' "$build/CMakeCache.txt")
# -Wundef and the like are the user's choice: nothing of the build's own options may come with the package.
grep -rqE 'Werror|Wconversion|twoport_options' "$work/prefix" --include='*.cmake' &&
  { echo "the package carries the build's own options"; exit 1; }
grep -rnE '"/[^"]|[;>]/' "$work/prefix" --include='twoport-*.cmake' && { echo "the package names places of this system"; exit 1; }
cmake -S "$here/outside" -B "$work/build" -G Ninja -D CMAKE_BUILD_TYPE=Release -D "CMAKE_PREFIX_PATH=$work/prefix" \
  -D "CMAKE_CXX_COMPILER=$compiler" ${launcher:+-D "CMAKE_CXX_COMPILER_LAUNCHER=$launcher"}
cmake --build "$work/build"
"$work/prefix/bin/twoport-lab" --version
"$work/build/all_layers"
"$here/plugin.sh" "$work/prefix" "$compiler" "$launcher"
"$here/hardware.sh" "$work/prefix" "$compiler" "$launcher"
"$here/own_element.sh" "$work/prefix" "$compiler" "$(sed -n 's/^Eigen3_DIR:[A-Z]*=//p' "$build/CMakeCache.txt")" "$launcher"
