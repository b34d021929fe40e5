#!/usr/bin/env bash
# What CMakeLists.txt and docs/reference/speed-and-accuracy.md claim of results on other processors: the C library computes exp, log, pow and
# sin with fused multiply-add where the processor has it, and without it they differ in the last bit.
#
#   processors.sh TWOPORT_LAB SCENES
set -euo pipefail
lab=$1 scenes=$2
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
without=glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4
run() { GLIBC_TUNABLES=$3 "$lab" run "$scenes/$1" --set duration_s=3 --out "$out/$2" >/dev/null || [ $? = 3 ]; }
same() { cmp -s "$out/$1/trace.csv" "$out/$2/trace.csv"; }

run paper/slide.textproto with ''
run paper/slide.textproto without "$without"
run paper/slide.textproto again "$without"
same without again || { echo "one processor, two results"; exit 1; }
# Figures of the same run agree to 1e-9, those near 0 to 1e-9 of their unit; times of the computer are none.
/usr/bin/python3 - "$out" <<'PYTHON'
import json, sys

def figures(path, prefix=""):
    for key, value in path.items():
        if isinstance(value, dict):
            yield from figures(value, prefix + key + ".")
        elif isinstance(value, (int, float)) and key != "step_ns":
            yield prefix + key, float(value)

with_fma, without = (dict(figures(json.load(open(f"{sys.argv[1]}/{name}/summary.json")))) for name in ("with", "without"))
assert with_fma.keys() == without.keys() and len(with_fma) > 10
far = {k: (a, without[k]) for k, a in with_fma.items() if abs(a - without[k]) > 1e-9 * max(abs(a), 1.0)}
sys.exit(f"figures differ: {far}" if far else 0)
PYTHON
same with without && echo "this processor has no fused multiply-add, or this C library does not use it: little is tested"
# No tremor, no noise and no jitter: additions, products, quotients and roots, which every processor rounds alike.
run demo.textproto plain ''
run demo.textproto plain_without "$without"
same plain plain_without || { echo "scenes/demo differs between the two"; exit 1; }
