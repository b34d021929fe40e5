#!/usr/bin/env bash
# Wake-up latency of the master's loop without the page (none), with one page open in Chromium (page), with a client that never
# reads (deaf), each with and without a recording (-rec), in turn: tests/bench/page_lateness.sh [ROUNDS] [SECONDS] [OPTION OF THE MASTER...], e.g. --no-spin. Prints p50, p99
# and p99.9 of each run, and their medians against those without page and recording.
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
rounds=${1:-5} seconds=${2:-8}
[ $# -le 2 ] && set -- || shift 2
options=("$@")
bin=build/release/bin scene=docs/examples/play/three_axes.textproto
work=$(mktemp -d)
trap 'kill $(jobs -p) 2>/dev/null || true; rm -rf "$work"' EXIT
chromium=$(command -v chromium || true)

run() {
  local name=$1 kind=${1%-rec} page=() record=() url host
  [ "$kind" = none ] || page=(--page 127.0.0.1:0)
  [ "$name" = "$kind" ] || record=(--record "$work/master.mcap")
  rm -rf "$work"/*.mcap "$work"/*.log "$work/master" "$work/slave"
  env --default-signal=INT $bin/twoport-slave --scene $scene --listen 127.0.0.1:0 --out "$work/slave" >"$work/slave.log" 2>&1 &
  local slave=$!
  until grep -qs "listening on" "$work/slave.log"; do sleep 0.05; done
  env --default-signal=INT $bin/twoport-master --scene $scene --peer "$(grep -o '127.0.0.1:[0-9]*' "$work/slave.log" | head -1)" \
    "${options[@]}" "${page[@]}" "${record[@]}" --out "$work/master" >"$work/master.log" 2>&1 &
  local master=$!
  until grep -qs "waiting for a slave" "$work/master.log"; do sleep 0.05; done
  url=$(grep -om1 'http://[^ ]*' "$work/master.log" || true)
  local browser=''
  case $kind in
    page)
      setsid "$chromium" --headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking \
        --disable-component-update --disable-sync --user-data-dir="$work/profile" --remote-debugging-port=0 "$url" >"$work/browser.log" 2>&1 &
      browser=$!
      ;;
    deaf)
      host=${url#http://} host=${host%/}
      exec 3<>"/dev/tcp/${host%:*}/${host#*:}"
      printf 'GET /live HTTP/1.1\r\nHost: %s\r\nOrigin: http://%s\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n' "$host" "$host" >&3
      ;;
  esac
  sleep "$seconds"
  kill -INT "$master" "$slave"
  wait "$master" "$slave" || true
  [ -z "$browser" ] || { kill -- "-$browser" 2>/dev/null || true; wait "$browser" 2>/dev/null || true; }
  [ "$kind" != deaf ] || exec 3>&-
  awk -v kind="$name" '/"loop_lateness_us"/ { on = 1 } on && /"p50"|"p99"|"p999"/ { gsub(/[^0-9.e+-]/, "", $2); v = v " " $2 } /}/ { on = 0 }
    END { print kind v }' "$work/master/summary.json"
}

kinds=(none none-rec deaf deaf-rec)
[ -z "$chromium" ] || kinds+=(page page-rec)
for ((round = 0; round < rounds; round++)); do
  for kind in "${kinds[@]}"; do run "$kind"; done
done | tee "$work/all"
awk '{ n[$1]++; for (i = 2; i <= 4; i++) x[$1, i, n[$1]] = $i }
  function median(kind, i,   a, j, k, t, m) { m = n[kind]; for (j = 1; j <= m; j++) a[j] = x[kind, i, j]
    for (j = 2; j <= m; j++) for (k = j; k > 1 && a[k] < a[k-1]; k--) { t = a[k]; a[k] = a[k-1]; a[k-1] = t }
    return m % 2 ? a[(m + 1) / 2] : (a[m / 2] + a[m / 2 + 1]) / 2 }
  END { for (kind in n) printf "%-8s median p50 %.3g us, p99 %.3g us, p99.9 %.3g us; against none %.2f, %.2f, %.2f\n", kind,
          median(kind, 2), median(kind, 3), median(kind, 4), median(kind, 2) / median("none", 2),
          median(kind, 3) / median("none", 3), median(kind, 4) / median("none", 4) }' "$work/all"
