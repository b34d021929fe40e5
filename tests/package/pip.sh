#!/usr/bin/env bash
# `pip install .` into fresh environments, offline and without root: pip.sh BUILD_DIR INTERPRETER
# Exit status 77: skipped, in words.
set -euo pipefail
build=$(readlink -f "$1") interpreter=$2
root=$(readlink -f "$(dirname "$0")/../..")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() { echo "$1"; exit 1; }
"$interpreter" -m venv --system-site-packages "$work/venv" >"$work/log" 2>&1 || { echo "skipped: no venv (apt-get install python3-venv)"; exit 77; }
"$interpreter" -m venv "$work/bare" >"$work/log"
unset PYTHONPATH
cd "$root"

# What is missing is said in one sentence, before anything is built.
mkdir "$work/no_packages"
printf '#!/bin/sh\n' >"$work/no_packages/dpkg-query"
chmod +x "$work/no_packages/dpkg-query"
PATH=$work/no_packages:$PATH "$work/venv/bin/pip" wheel --no-index -w "$work" . >"$work/log" 2>&1 && fail "built without packages"
grep -q 'twoport is built with what is missing here: g++, cmake, .*pybind11-dev; install these Debian packages as root' "$work/log" || { cat "$work/log"; exit 1; }

before=$(date +%s%N)
"$work/venv/bin/pip" install --no-index --config-settings "build=$build" . >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }
took=$((($(date +%s%N) - before) / 1000000))
"$work/venv/bin/pip" wheel --no-index --config-settings "build=$build" -w "$work" . >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }
"$work/bare/bin/pip" install --no-index "$work"/twoport-*.whl >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }
"$work/bare/bin/python" -c 'import twoport' 2>"$work/said" && fail "NumPy is not missed"
[ "$(tail -n 1 "$work/said")" = 'ImportError: twoport needs NumPy, which is not installed: python3-numpy of Debian, or pip install numpy' ] || { cat "$work/said"; exit 1; }

cd "$work"
version=$(sed -n 's/^project(twoport VERSION \([0-9.]*\).*/\1/p' "$root/CMakeLists.txt")
[ "$(venv/bin/python -m twoport --version)" = "twoport $version" ] || fail "another version"
venv/bin/python -m twoport >said
for part in module scenes arms twoport-keygen; do
  path=$(sed -n "s/^$part  *//p" said)
  [ -e "$path" ] && [[ $path == "$work/venv/"* ]] || { cat said; fail "$part is at $path"; }
done
venv/bin/python -m twoport run 2>said && fail "run is known"
grep -q '^python -m twoport: run: not known' said || { cat said; exit 1; }
venv/bin/twoport-keygen key >/dev/null && [ -s key ] || fail "twoport-keygen makes no key"
venv/bin/python -c '
import pathlib, sys, twoport, twoport.lerobot
here = pathlib.Path(twoport.__file__).parent
assert {"py.typed", "__init__.pyi", "lerobot.py"} <= {p.name for p in here.iterdir()}
result = twoport.run(twoport.load_scene("one_axis_wall", "duration_s=2"))
assert result.summary["stable"] and len(result.trace["master_f"]) == 4000
assert twoport.load_scene("leader_follower").dof == 7
try: twoport.load_scene("leader_folower")
except ValueError as e: assert "did you mean leader_follower" in str(e), e
'
"$work/venv/bin/pip" uninstall -y twoport >/dev/null
left=$(find "$work/venv" -type f -path '*twoport*' ! -name '*.pyc' | head -n 3)
[ -z "$left" ] || fail "left behind: $left"

# The archive of the sources builds the same wheel's metadata.
cd "$root"
"$work/venv/bin/python" -c "
import sys, tarfile
sys.path.insert(0, 'cmake')
import pip_build
name = pip_build.build_sdist('$work')
files = tarfile.open('$work/' + name).getnames()
assert f'{pip_build.NAME}/pyproject.toml' in files and f'{pip_build.NAME}/cmake/pip_build.py' in files and f'{pip_build.NAME}/PKG-INFO' in files
" || [ ! -e "$root/.git" ] || exit 1
echo "$(basename "$work"/twoport-*.whl): $(du -h "$work"/twoport-*.whl | cut -f 1), installed in $took ms"
