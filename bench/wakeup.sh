#!/bin/sh
# PeriodicLoop against cyclictest (Debian: rt-tests) at 1 and 2 kHz, in turns on the same core, in the same run.
# usage: bench/wakeup.sh [ROUNDS [SECONDS [CORE]]]     WAKEUP=path/to/wakeup_lateness (build/release/bin/ by default)
set -eu
rounds=${1:-3} seconds=${2:-5} core=${3:-0}
wakeup=${WAKEUP:-$(dirname "$0")/../build/release/bin/bench_wakeup_lateness}
for program in cyclictest taskset; do
  command -v $program >/dev/null || { echo "$program is missing: apt-get install rt-tests util-linux" >&2; exit 1; }
done
[ -x "$wakeup" ] || { echo "$wakeup is missing: cmake --build --preset release, or set WAKEUP" >&2; exit 1; }

# The histogram that cyclictest prints, as our own line. Its buckets are 1 us wide.
percentiles() {
  awk -v rate="$1" '
    /^[0-9]/ { if ($2 > 0) { value[++rows] = $1 + 0; times[rows] = $2; total += $2 } }
    /^# Max Latencies/ { max = $4 + 0 }
    /^# Histogram Overflows/ { over = $4 + 0 }
    function percentile(p,   i, seen) {
      for (i = 1; i <= rows; ++i) { seen += times[i]; if (seen >= p * (total + over)) return value[i] }
      return max
    }
    END {
      printf "cyclictest   FIFO  %5d Hz %7d ticks  p50 %8d  p99 %8d  p99.9 %8d  max %9d us\n",
             rate, total + over, percentile(0.5), percentile(0.99), percentile(0.999), max
    }'
}

for round in $(seq "$rounds"); do
  echo "round $round of $rounds, $seconds s each, core $core"
  for rate in 1000 2000; do
    taskset -c "$core" cyclictest -m -p80 -i$((1000000 / rate)) -D"$seconds" -q -h2000 -t1 -a"$core" | percentiles $rate
    taskset -c "$core" "$wakeup" --rate $rate --seconds "$seconds" --spin 0
    taskset -c "$core" "$wakeup" --rate $rate --seconds "$seconds" --spin 1
  done
done
