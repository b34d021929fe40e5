#!/usr/bin/env bash
# A recording of the laboratory, and one of a program killed while it wrote, read by others through the index; a live run, heard by the
# client of Foxglove's protocol:
#
#   other_readers.sh python|npm|foxglove LAB MASTER SLAVE FOLDER     FOLDER keeps what npm fetches
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
    read_it() { "$python" "$here/../../docs/examples/recordings/read_recording.py" "$1"; }
    ;;
  npm | foxglove)
    command -v npm >/dev/null || skip "npm is not installed"
    mkdir -p "$folder"
    cp "$here/package.json" "$folder"
    [ -d "$folder/node_modules/@foxglove/ws-protocol" ] ||
      (cd "$folder" && npm install --ignore-scripts --no-audit --no-fund --silent) || skip "npm could not fetch the packages"
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
wait_for() { for ((i = 0; i < 200; i++)); do grep -qs "$1" "$2" && break; sleep 0.1; done; }
start_slave() {
  "$slave" --scene "$scene" --listen 127.0.0.1:0 --no-spin --trace none --out "$work/slave" >"$work/slave.log" 2>&1 &
  pids+=($!)
  wait_for 'listening on' "$work/slave.log"
  port=$(sed -n 's/.*listening on 127\.0\.0\.1:\([0-9]*\).*/\1/p' "$work/slave.log")
}
if [ "$reader" = foxglove ]; then
  start_slave
  "$master" --scene "$scene" --set duration_s=6 --peer "127.0.0.1:$port" --no-spin --trace none --foxglove 127.0.0.1:0 \
    --record "$work/heard.mcap" >"$work/master.log" 2>&1 &
  pids+=($!)
  wait_for 'foxglove: ws' "$work/master.log"
  node "$here/foxglove.mjs" "$folder/node_modules" "$(grep -om1 'ws://[^ ]*' "$work/master.log")" "$work/heard.mcap"
  exit
fi
"$lab" run "$scene" --set duration_s=3 --verdict plain --out "$work" --record "$work/lab.mcap" >/dev/null 2>&1 || [ $? -eq 3 ]
read_it "$work/lab.mcap"

start_slave
"$master" --scene "$scene" --peer "127.0.0.1:$port" --no-spin --trace none --out "$work/master" --record "$work/killed.mcap" >"$work/master.log" 2>&1 &
pids+=($!)
wait_for paired "$work/master.log"
sleep 2
kill -KILL "${pids[1]}"
wait "${pids[1]}" 2>/dev/null || true
echo "killed:"
read_it "$work/killed.mcap"
