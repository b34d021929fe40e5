#!/usr/bin/env bash
# A recording of the laboratory, and one of a program killed while it wrote, read by others through the index:
#
#   other_readers.sh python|npm LAB MASTER SLAVE FOLDER     FOLDER keeps what npm fetches
#
# Exit status 77: skipped, with the reason.
set -euo pipefail
reader=$1 lab=$2 master=$3 slave=$4 folder=$5
here=$(dirname "$(readlink -f "$0")")
skip() { echo "SKIPPED: $1"; exit 77; }

case $reader in
  python)
    python=/usr/bin/python3
    "$python" -c 'import google.protobuf' 2>/dev/null || skip "python3-protobuf is not installed"
    read_it() { "$python" "$here/../../examples/recordings/read_recording.py" "$1"; }
    ;;
  npm)
    command -v npm >/dev/null || skip "npm is not installed"
    mkdir -p "$folder"
    cp "$here/package.json" "$folder"
    [ -d "$folder/node_modules/@mcap/core" ] ||
      (cd "$folder" && npm install --ignore-scripts --no-audit --no-fund --silent) || skip "npm could not fetch @mcap/core"
    read_it() { node "$here/read_recording.mjs" "$folder/node_modules" "$1"; }
    ;;
esac

work=$(mktemp -d)
pids=()
cleanup() {
  for pid in "${pids[@]}"; do kill -KILL "$pid" 2>/dev/null && wait "$pid" 2>/dev/null || true; done
  rm -rf "$work"
}
trap cleanup EXIT

scene=$here/../../scenes/demo.textproto
"$lab" run "$scene" --set duration_s=3 --verdict plain --out "$work" --record "$work/lab.mcap" >/dev/null 2>&1 || [ $? -eq 3 ]
read_it "$work/lab.mcap"

"$slave" --scene "$scene" --listen 127.0.0.1:0 --no-spin --trace none --out "$work/slave" >"$work/slave.log" 2>&1 &
pids+=($!)
for ((i = 0; i < 200; i++)); do grep -qs 'listening on' "$work/slave.log" && break; sleep 0.1; done
port=$(sed -n 's/.*listening on 127\.0\.0\.1:\([0-9]*\).*/\1/p' "$work/slave.log")
"$master" --scene "$scene" --peer "127.0.0.1:$port" --no-spin --trace none --out "$work/master" --record "$work/killed.mcap" >"$work/master.log" 2>&1 &
pids+=($!)
for ((i = 0; i < 200; i++)); do grep -qs 'paired' "$work/master.log" && break; sleep 0.1; done
sleep 2
kill -KILL "${pids[1]}"
wait "${pids[1]}" 2>/dev/null || true
echo "killed:"
read_it "$work/killed.mcap"
