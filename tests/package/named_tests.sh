#!/usr/bin/env bash
# Every test that a document names is in the sources, and every cell of the attack tables of docs/reference/security.md that says what happens
# names one, says "not tested", or refers to another cell: tests/package/named_tests.sh
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
bad=0
complain() { echo "$1"; bad=1; }

tests=$(mktemp)
trap 'rm -f "$tests"' EXIT
grep -rhoE --include='*.cc' '^(TYPED_)?TEST(_F|_P)?\(\w+, *\w+\)' tests | sed -E 's/^[A-Z_]+\((\w+), *(\w+)\)/\1.\2/' >"$tests"
grep -rhoE --include=CMakeLists.txt 'NAME [A-Za-z]+\.[A-Za-z.]+' tests | cut -d' ' -f2 >>"$tests"
while IFS=: read -r document line name; do
  grep -qxF "${name//\`/}" "$tests" || complain "$document:$line: there is no test $name"
done < <(grep -noE --with-filename '`[A-Z][A-Za-z0-9]+\.[A-Z][A-Za-z0-9]+`' SECURITY.md docs/*.md docs/reference/*.md)

while IFS=: read -r document line name; do
  name=${name//\`/}
  [ -e "tests/page/${name#page.}.mjs" ] || complain "$document:$line: there is no test $name"
done < <(grep -noE --with-filename '`page\.[a-z_]+`' SECURITY.md docs/*.md docs/reference/*.md)

# Cells after the first one say what happens.
rows=$(awk -F'|' '/^## Attacks/ { here = 1; next } /^## / { here = 0 }
  here && /^\|/ && !/^\| *(tries to|try to|case) / && !/^\|---/ {
    for (i = 3; i < NF; ++i) {
      cell = $i; gsub(/^ +| +$/, "", cell)
      if (cell != "" && cell !~ /`[A-Z][A-Za-z0-9]+\.[A-Z]/ && cell !~ /`page\.[a-z_]+`/ && cell !~ /not tested/ && cell !~ /^(as|the same)/) print NR ": " cell
    }
    ++n
  }
  END { if (n < 30) print "only " n + 0 " rows found" }' docs/reference/security.md)
[ -z "$rows" ] || complain "docs/reference/security.md: neither a test nor \"not tested\":
$rows"
exit $bad
