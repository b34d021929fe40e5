#!/usr/bin/env bash
# A new shape is one file and the lines that docs/guides/add-an-environment.md names: makes them in a copy of what they touch,
# compiles what reads and computes it, and touches it. new_environment.sh COMPILER PROTOC EIGEN_INCLUDE LIBRARY...
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
compiler=$1 protoc=$2 eigen=$3
shift 3
here=tests/environment page=docs/guides/add-an-environment.md
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# put FILE PATTERN ADD: FILE of the copy gets ADD after the first line that matches PATTERN. The page must show it.
put() {
  awk -v pattern="$2" -v add="$3" '{ print } !done && $0 ~ pattern { print add; done = 1 } END { exit !done }' "$work/$1" >"$work/new" ||
    { echo "$1: no line \"$2\""; exit 1; }
  mv "$work/new" "$work/$1"
  grep -qF -- "$(sed 's/^ *//' <<<"$3")" "$page" || { echo "$page does not show: $3"; exit 1; }
}

mkdir -p "$work/common/contact" "$work/common/scene" "$work/proto"
cp common/contact/shape.h "$work/common/contact/"
cp common/scene/environment.cc "$work/common/scene/"
cp proto/scene.proto proto/field.proto "$work/proto/"

cp $here/pipe/pipe.h "$work/common/contact/"
put common/contact/shape.h '#include "common/contact/simple_solids.h"' '#include "common/contact/pipe.h"'
sed -i 's/^using Shape = std::variant<\(.*\)>;/using Shape = std::variant<\1, Pipe>;/' "$work/common/contact/shape.h"
put proto/scene.proto '^    Spring spring = 5;' '    Pipe pipe = 6 [(least_dof) = 3];'
cat $here/pipe/pipe.proto >>"$work/proto/scene.proto"
sed -i -e "0,/^}  .. namespace\$/{//e cat $here/pipe/read_pipe.inc" -e '}' "$work/common/scene/environment.cc"

"$protoc" --proto_path="$work" --cpp_out="$work" proto/scene.proto proto/field.proto
compile() { "$compiler" -std=c++20 -I"$work" -I. -isystem "$eigen" -c "$1" -o "$work/$2.o"; }
compile "$work/proto/scene.pb.cc" schema
compile "$work/proto/field.pb.cc" options
compile "$work/common/scene/environment.cc" environment
compile common/scene/reader.cc reader
compile common/scene/find.cc find
compile common/scene/text.cc text
compile $here/pipe_test.cc test
"$compiler" "$work"/*.o "$@" -pthread -o "$work/program"
"$work/program"
