#!/usr/bin/env bash
# A test of the playground: run.sh build PLAYGROUND_SCENES | same PLAYGROUND_ROWS | felt NODE_MODULES | compare NODE_MODULES. Exit status
# 77: skipped, with the reason.
set -euo pipefail
here=$(dirname "$(readlink -f "$0")")
root=$here/../..
file=$root/out/playground/index.html
skip() { echo "SKIPPED: $1"; exit 77; }
needs() { command -v "$1" >/dev/null || skip "$2 is not installed; install Debian's package $3"; }
case $1 in
  build)
    needs em++ Emscripten emscripten
    "$root/scripts/playground" --jobs 1 --scenes-program "$2"
    size=$(stat -c %s "$file")
    ((size <= 1500000)) || { echo "the file has $size bytes; it may have 1500000" >&2; exit 1; }
    ;;
  same)
    needs node node nodejs
    [ -e "$root/out/playground/core.wasm" ] || skip "there is no out/playground/core.wasm; scripts/playground makes it"
    node "$here/same.mjs" "$root/out/playground/core.wasm" "$2" "$root/scenes"
    ;;
  felt | compare)
    needs node node nodejs
    [ -d "$2/playwright-core" ] || skip "playwright-core is not in $2"
    chromium=$(command -v chromium || command -v chromium-browser || command -v google-chrome) ||
      skip "Chromium is not installed; install Debian's package chromium"
    [ -e "$file" ] || skip "there is no out/playground/index.html; scripts/playground makes it"
    node "$here/$1.mjs" "file://$(readlink -f "$file")" "$chromium" "$2" "${3-}"
    ;;
esac
