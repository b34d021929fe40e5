#!/usr/bin/env bash
# Makes the pictures of docs/guides/play.md from the tests here: pictures.sh [BUILD_DIR]
set -euo pipefail
here=$(dirname "$(readlink -f "$0")")
root=$here/../..
build=$(readlink -f "${1:-$root/build/release}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
picture() { # NAME SCRIPT SCENE
  "$here/end_to_end.sh" "$build/bin/twoport-master" "$build/bin/twoport-slave" "$build/bin/twoport-lab" "$root/build/page/node_modules" "$work/$1.png" "$2" "$3" >"$work/log" ||
    { cat "$work/log" >&2; exit 1; }
}
picture page friction three_axes
picture page_six_axes not_felt six_axes
picture page_no_control tour three_axes
picture page_dead_slave states three_axes
picture page_arm arm ../../../tests/page/arm
picture page screens three_axes # a telephone and a laptop, light and dark
mv "$work/page_phone_dark.png" "$work/page_phone.png"
for name in page page_six_axes page_no_control page_dead_slave page_arm page_phone; do
  size=$(stat -c %s "$work/$name.png")
  ((size < 150000)) || { echo "$name.png has $size bytes; a picture may have 150000" >&2; exit 1; }
  cp "$work/$name.png" "$root/docs/figures/$name.png"
done
