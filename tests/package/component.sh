#!/usr/bin/env bash
# The passivity layer alone: configured, built and installed with Eigen and nothing else, moved, and used outside the tree:
# component.sh COMPILER [LAUNCHER]
set -euo pipefail
compiler=$1 launcher=${2:-}
here=$(dirname "$(readlink -f "$0")")
root=$(readlink -f "$here/../..")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() { echo "$1"; exit 1; }

before=$(date +%s%N)
cmake -S "$root" -B "$work/build" -G Ninja -D TWOPORT_COMPONENTS=passivity -D "CMAKE_CXX_COMPILER=$compiler" >"$work/log" 2>&1 ||
  { cat "$work/log"; exit 1; }
cmake --build "$work/build" >"$work/log"
cmake --install "$work/build" --prefix "$work/prefix" >"$work/log"
took=$((($(date +%s%N) - before) / 1000000))
[ -f "$work/build/include/twoport/version.h" ] || fail "a program that has this project in a subdirectory finds no version.h"
looked_for=$(sed -n 's/^\(\w*\)_DIR:PATH=.*/\1/p' "$work/build/CMakeCache.txt" | tr '\n' ' ')
[ "$looked_for" = "Eigen3 " ] || fail "looked for: $looked_for"
eigen=$(sed -n 's/^Eigen3_DIR:PATH=//p' "$work/build/CMakeCache.txt")

# Moved, its build forgotten: nothing in it names a place of this system.
mv "$work/prefix" "$work/moved"
rm -r "$work/build"
grep -rnE '"/[^"]|[;>]/|/(usr|tmp|home|opt)/' "$work/moved/lib"* && fail "the package names places of this system"
grep -rn --include='*.h' -E '#include ["<](common|sim|drivers|master|slave|proto)/' "$work/moved" && fail "headers include each other by paths of the tree"
"$here/own_element.sh" "$work/moved" "$compiler" "$eigen" "$launcher"

# The version header says what the package is called.
version=$(sed -n 's/^set(PACKAGE_VERSION "\(.*\)")/\1/p' "$work/moved"/lib*/cmake/twoport/twoport-config-version.cmake)
header=$(sed -n 's/^#define TWOPORT_VERSION_[A-Z]* //p' "$work/moved/include/twoport/version.h" | paste -s -d .)
[ -n "$version" ] && [ "$header" = "$version" ] || fail "version.h says $header, the package $version"

# Both components in one prefix, one after the other, are found.
cmake -S "$root" -B "$work/build" -G Ninja -D TWOPORT_COMPONENTS=plugin -D "CMAKE_CXX_COMPILER=$compiler" >"$work/log"
cmake --install "$work/build" --prefix "$work/moved" >"$work/log"
mkdir "$work/user"
cat >"$work/user/CMakeLists.txt" <<'CMAKE'
cmake_minimum_required(VERSION 3.16)
project(user CXX)
find_package(twoport REQUIRED COMPONENTS passivity plugin)
CMAKE
cmake -S "$work/user" -B "$work/user/build" -G Ninja -D "CMAKE_PREFIX_PATH=$work/moved" -D "Eigen3_DIR=$eigen" >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }
rm -r "$work/build"

# A name that is no component is refused with what may stand there.
cmake -S "$root" -B "$work/build" -G Ninja -D TWOPORT_COMPONENTS=nonsense -D "CMAKE_CXX_COMPILER=$compiler" >"$work/log" 2>&1 && fail "nonsense was built"
grep -q 'TWOPORT_COMPONENTS is nonsense; it may name passivity and plugin' "$work/log" || { cat "$work/log"; exit 1; }
echo "passivity alone: $(find "$work/moved" -type f | wc -l) files, installed in $took ms"
