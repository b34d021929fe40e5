#!/bin/sh
# The slave of a live pair under a flood of each kind, 100,000 datagrams a second, beside quiet runs, with and without a key.
# usage: tests/bench/flood.sh [SECONDS [SCENE]]
set -eu
cd "$(dirname "$0")/../.."
seconds=${1:-6} scene=${2:-scenes/demo.textproto} bin=build/release/bin port=45877
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
"$bin/twoport-keygen" "$out/key"
figure() { awk -v from="$1" -v key="\"$2\":" '$0 ~ from { inside = 1 } inside && $1 == key { gsub(/[",]/, "", $2); print $2; exit }' "$out/slave/summary.json"; }
printf '%-8s %-4s %10s %10s %10s %8s %9s %9s %10s\n' flood key 'late p99' 'late p99.9' 'late max' skipped received lost rejected
for key in no yes; do
  with=''
  [ $key = no ] || with="--key $out/key"
  for kind in quiet noise fields hello client record; do
    "$bin/twoport-slave" --scene "$scene" $with --listen 127.0.0.1:$port --duration "$seconds" --trace none --out "$out/slave" >"$out/log" 2>&1 &
    slave=$!
    "$bin/twoport-master" --scene "$scene" $with --peer 127.0.0.1:$port --duration "$seconds" --trace none --out "$out/master" >/dev/null 2>&1 &
    master=$!
    sleep 1
    [ $kind = quiet ] || "$bin/bench_flood" $port $kind 100000 $((seconds - 2)) >"$out/rate"
    wait $slave || true
    wait $master || true
    printf '%-8s %-4s %10.1f %10.1f %10.1f %8s %9s %9s %10s' $kind $key "$(figure loop_lateness p99)" "$(figure loop_lateness p999)" \
      "$(figure loop_lateness max)" "$(figure deadline_misses deadline_misses)" "$(figure to_slave received)" "$(figure to_slave lost)" "$(figure to_slave rejected)"
    if [ $kind = quiet ]; then echo; else echo "   $(cat "$out/rate")"; fi
  done
done
