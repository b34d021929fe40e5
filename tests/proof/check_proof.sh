#!/usr/bin/env bash
# Usage: check_proof.sh FILE. Z3 finds no counterexample to the claim (unsat), and finds one (sat) for every turned
# sign, a sed script behind "; turned:". Exit status 77 where Z3 is not installed.
set -euo pipefail
command -v z3 >/dev/null || { echo "not checked: z3 is not installed"; exit 77; }
solve() { z3 -T:60 -in; }
answer=$(solve <"$1")
[ "$answer" = unsat ] || { echo "$1: the claim does not hold: $answer" >&2; exit 1; }
turned=0
while IFS= read -r script; do
  changed=$(sed -e '/^;/d' -e "$script" "$1")
  [ "$changed" != "$(sed '/^;/d' "$1")" ] || { echo "$1: nothing to turn for $script" >&2; exit 1; }
  answer=$(solve <<<"$changed")
  [ "$answer" = sat ] || { echo "$1: holds with a sign turned ($script): $answer" >&2; exit 1; }
  turned=$((turned + 1))
done < <(sed -n 's/^; turned: //p' "$1")
[ "$turned" -gt 0 ] || { echo "$1: no sign is turned" >&2; exit 1; }
echo "$1: holds; $turned turned signs are found"
