#!/usr/bin/env bash
# Runs SCRIPT.mjs in Chromium against both programs:
#
#   end_to_end.sh MASTER SLAVE LAB NODE_MODULES [PICTURE.png] [SCRIPT] [SCENE] [OPTION OF THE SLAVE...]
#
# SCRIPT: end_to_end (the default) or another one here; SCENE: of docs/examples/play, one_axis. Both sides record, and LAB replays the recordings to the bit. Exit status 77: skipped, with the reason.
set -euo pipefail
master=$1 slave=$2 lab=$3 modules=$4 picture=${5:-} script=${6:-end_to_end} scene=${7:-one_axis}
[ $# -le 7 ] && set -- || shift 7
here=$(dirname "$(readlink -f "$0")")
scene=$here/../../docs/examples/play/$scene.textproto

skip() { echo "SKIPPED: $1"; exit 77; }
command -v node >/dev/null || skip "node is not installed; the page is driven by playwright-core, which needs it"
[ -d "$modules/playwright-core" ] || skip "playwright-core is not there; scripts/page fetches it by npm"
chromium=$(command -v chromium || command -v chromium-browser || command -v google-chrome) ||
  skip "Chromium is not installed; install Debian's package chromium"

work=$(mktemp -d)
pids=()
cleanup() {
  for pid in "${pids[@]}"; do kill -INT "$pid" 2>/dev/null || true; done
  for pid in "${pids[@]}"; do wait "$pid" 2>/dev/null || true; done
  rm -rf "$work"
}
trap cleanup EXIT
wait_for() { # PATTERN FILE
  for ((i = 0; i < 200; i++)); do
    grep -qsE "$1" "$2" && return
    sleep 0.1
  done
  cat "$2" >&2
  echo "end_to_end.sh: no '$1' within 20 s" >&2
  exit 1
}

env --default-signal=INT "$slave" --scene "$scene" --set duration_s=600 --listen 127.0.0.1:0 --no-spin --out "$work/slave" --record "$work/slave.mcap" "$@" >"$work/slave.log" 2>&1 &
pids+=($!)
wait_for 'listening on' "$work/slave.log"
port=$(sed -n 's/.*listening on 127\.0\.0\.1:\([0-9]*\).*/\1/p' "$work/slave.log")
env --default-signal=INT "$master" --scene "$scene" --set duration_s=600 --peer "127.0.0.1:$port" --device page --page 127.0.0.1:0 --no-spin \
  --out "$work/master" --record "$work/master.mcap" >"$work/master.log" 2>&1 &
pids+=($!)
wait_for 'page: http' "$work/master.log"
url=$(grep -om1 'http://[^ ]*' "$work/master.log")
export SLAVE_PID=${pids[0]} MASTER_PID=${pids[1]}
node "$here/$script.mjs" "$url" "$chromium" "$modules" "$picture" || { tail -n 5 "$work"/*.log >&2; exit 1; }

# It has killed the slave and ended the master.
[ "$script" != states ] || { for pid in "${pids[@]}"; do wait "$pid" || true; done; pids=(); exit 0; }

# Both end by SIGINT, with whole summaries.
for pid in "${pids[@]}"; do
  kill -INT "$pid"
  wait "$pid"
done
pids=()
if [ "$script" = end_to_end ]; then
  grep -q '"environment_changes": 2' "$work/slave/summary.json" || {
    echo "the slave's summary does not name the two changes of the environment:" >&2
    cat "$work/slave/summary.json" >&2
    exit 1
  }
  grep -o '"environment_changes.*' "$work/slave/summary.json"
fi
[ "$script" != frames ] || exit 0 # drawing by software leaves no processor to the writers of the recordings
for side in master slave; do "$lab" replay "$work/$side.mcap"; done
grep -o '"loop_lateness_us":.*' -A4 "$work/master/summary.json" | tr -d '\n '
echo
