#!/usr/bin/env bash
# A wall made passive outside the tree, as docs/guides/wrap-your-own-element.md says: own_element.sh PREFIX COMPILER EIGEN_DIR [LAUNCHER]
# Builds docs/examples/own_element against the tree installed in PREFIX, with every package but Eigen hidden, and runs it. EIGEN_DIR: the folder
# of Eigen3Config.cmake.
set -euo pipefail
prefix=$1 compiler=$2 eigen=$3 launcher=${4:-}
root=$(readlink -f "$(dirname "$(readlink -f "$0")")/../..")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() { echo "$1"; exit 1; }

# All that the whole project looks for.
mapfile -t hidden < <(grep -rhoE --include=CMakeLists.txt --include='*.cmake' '^ *find_package\(\w+' "$root/CMakeLists.txt" "$root"/*/ |
  sed 's/.*(/-DCMAKE_DISABLE_FIND_PACKAGE_/; s/$/=ON/' | grep -v '_\(Eigen3\|twoport\)=' | sort -u)
[ ${#hidden[@]} -ge 8 ] || fail "only ${#hidden[@]} packages are hidden"
cmake -S "$root/docs/examples/own_element" -B "$work/build" -G Ninja -D CMAKE_BUILD_TYPE=Release -D "CMAKE_PREFIX_PATH=$prefix" -D "Eigen3_DIR=$eigen" \
  -D "CMAKE_CXX_COMPILER=$compiler" ${launcher:+-D "CMAKE_CXX_COMPILER_LAUNCHER=$launcher"} -D CMAKE_EXPORT_COMPILE_COMMANDS=ON \
  -D CMAKE_CXX_FLAGS="-Wall -Wextra -Wconversion -Wshadow -Werror" "${hidden[@]}" >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }
grep -qx "twoport_DIR:PATH=$prefix/.*" "$work/build/CMakeCache.txt" || fail "another twoport than that in $prefix was found"
cmake --build "$work/build" >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }

# One folder of the project is searched for headers, and nothing in it but twoport.
grep -oE -- '-(I|isystem) ?[^ "]+' "$work/build/compile_commands.json" | sed -E 's/^-(I|isystem) ?//' | grep -v '/eigen3$' >"$work/searched"
[ "$(cat "$work/searched")" = "$prefix/include" ] || fail "searched for headers: $(cat "$work/searched")"
[ "$(ls "$prefix/include")" = twoport ] || fail "in $prefix/include: $(ls "$prefix/include")"

# The plain wall creates energy, passivated at most a quarter of that, behind the energy spring no more than E(0) = 0.01 mJ.
"$work/build/own_element" | tee "$work/said"
awk '
  { for (i = 1; i < NF; ++i) if ($i == "smallest") least[$1] = $(i + 1) }
  END {
    if (!(least["plain"] < -1)) { print "the plain wall should have created energy, got " least["plain"] " mJ"; exit 1 }
    if (!(least["passivated"] > 0.25 * least["plain"])) { print "passivated: " least["passivated"] " mJ"; exit 1 }
    if (!("spring" in least && least["spring"] >= -0.01)) { print "behind the energy spring: " least["spring"] " mJ"; exit 1 }
  }' "$work/said"
