#!/usr/bin/env bash
# From the start of scripts/play, with the programs built, to the page's address, to the page shown in Chromium, and to the first
# force felt in a drag into the wall: bench/page_start.sh [ROUNDS]. Times in seconds since the start, one line a round.
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/.."
rounds=${1:-5}
chromium=$(command -v chromium) || { echo "Chromium is not installed (apt-get install chromium)" >&2; exit 1; }
scripts/play --help >/dev/null
log=$(mktemp)
trap 'rm -f "$log"' EXIT
for ((round = 0; round < rounds; round++)); do
  : >"$log"
  start=$(date +%s%3N)
  env --default-signal=INT scripts/play --no-browser --dof 1 >"$log" 2>&1 &
  play=$!
  until url=$(grep -om1 'http://[^ ]*' "$log"); do
    kill -0 "$play" || { cat "$log" >&2; exit 1; }
    sleep 0.01
  done
  served=$(date +%s%3N)
  node bench/first_force.mjs "$url" "$chromium" "$PWD/build/page/node_modules" "$start" "$served"
  kill -INT "$play"
  wait "$play" || true
done
