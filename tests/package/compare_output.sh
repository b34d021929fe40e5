#!/usr/bin/env bash
# Which differences between a shown output and a printed one count: compare_output.sh SCRIPT
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
bad=0
# differs yes|no SHOWN PRINTED [OPTION]
differs() {
  printf '%b\n' "$2" >"$folder/shown"
  printf '%b\n' "$3" >"$folder/printed"
  local found=no
  "$script" ${4:-} "$folder/shown" "$folder/printed" >/dev/null || found=yes
  [ "$found" = "$1" ] || { echo "differs $1 expected: $2 | $3"; bad=1; }
}
script=$1
differs no "force 4.53 N" "force 4.6 N"
differs yes "force 4.53 N" "force 4.7 N"
differs no "drag 0.02 N" "drag 0.03 N"
differs yes "drag 0.02 N" "drag 0.04 N"
differs yes "port -41.88 J" "port 41.88 J"
differs no "residual 1.2e-15 m" "residual 3e-13 m"
differs yes "3 cells" "4 cells, stable"
differs no "took 3.2 s, 12 us a tick" "took 9 s, 40 us a tick"
differs yes "growing, 3.2 1/s" "growing, 4.2 1/s"
differs no "a 1\nb 2" "b 2\na   1"
differs yes "a 1\na 5" "a 1"
differs yes "a 1\na 5" "a 5\na 1"
differs no "120 ns 1.10" "98 ns 1.90" --words
differs yes "120 ns a" "120 ns b" --words
exit "$bad"
