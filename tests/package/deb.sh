#!/usr/bin/env bash
# The Debian package: built, looked into, unpacked, its programs run: deb.sh BUILD_DIR
# Exit status 77: skipped, in words.
set -euo pipefail
build=$(readlink -f "$1")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() { echo "$1"; exit 1; }
for tool in dpkg-deb dpkg-shlibdeps fakeroot; do
  command -v $tool >/dev/null && continue
  [ $tool = fakeroot ] || { echo "skipped: $tool is not installed (apt-get install dpkg-dev)"; exit 77; }
done

cpack --config "$build/CPackConfig.cmake" -B "$work" >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }
deb=$(ls "$work"/twoport_*.deb)
dpkg-deb -c "$deb" | sed -E 's/^([^ ]+) +([^ ]+).* (\.\/[^ ]*)( -> .*)?$/\1 \2 \3/' >"$work/contents"
for path in ./usr/bin/twoport-{master,slave,lab,device,keygen,play} ./usr/share/man/man1/twoport-{master,slave,lab,device,keygen}.1.gz \
  ./usr/share/bash-completion/completions/twoport-master ./usr/share/twoport/scenes/demo.textproto \
  ./usr/include/twoport/{hardware/plugin,passivity/passivated,version}.h ./usr/lib/udev/rules.d/60-twoport.rules \
  ./etc/security/limits.d/twoport.conf ./usr/share/doc/twoport/copyright ./usr/share/doc/twoport/examples/plugin/rail.cc; do
  grep -qF " $path" "$work/contents" || fail "the package lacks $path"
done
grep -q 'libtwoport_passivity\|libtwoport_platform.a' "$work/contents" || fail "the package lacks the library"
python=/usr/lib/python3/dist-packages
if [ -d "$build/python/twoport" ]; then
  for file in __init__.py __init__.pyi __main__.py _parquet.py lerobot.py py.typed; do
    grep -qF " .$python/twoport/$file" "$work/contents" || fail "the package lacks $file of the Python module"
  done
  grep -q " .$python/twoport/_twoport\..*\.so" "$work/contents" || fail "the package lacks the Python module"
fi
grep -q 'twoport-config.cmake' "$work/contents" || fail "the package lacks its CMake configuration"
grep -v ' root/root ' "$work/contents" && fail "not everything belongs to root"
grep -E '^.......(-w|.-.w)' "$work/contents" | grep -v '^l' && fail "others may write"
grep -E ' \./(usr/local|tmp|home|root)/' "$work/contents" && fail "files in a place of the user's"
maintainer=$(dpkg-deb -f "$deb" Maintainer)
[ "$maintainer" = 'twoport developers <twoport@example.org>' ] || fail "Maintainer: $maintainer"
depends=$(dpkg-deb -f "$deb" Depends)
grep -q 'libc6' <<<"$depends" && grep -q 'libprotobuf' <<<"$depends" || fail "Depends: $depends"
dpkg-deb -e "$deb" "$work/control"
[ -x "$work/control/postinst" ] && sh -n "$work/control/postinst" || fail "postinst"

# Unpacked: the programs run from there, and name their version.
dpkg-deb -x "$deb" "$work/root"
version=$(dpkg-deb -f "$deb" Version)
for program in master slave lab device keygen; do
  "$work/root/usr/bin/twoport-$program" --version | grep -qF "twoport-$program $version" || fail "twoport-$program: other version"
done
"$work/root/usr/bin/twoport-lab" run "$work/root/usr/share/twoport/scenes/held_spring.textproto" >/dev/null
if [ -d "$build/python/twoport" ]; then
  interpreter=$(sed -n 's/^_*Python3_EXECUTABLE:[A-Z]*=//p' "$build/CMakeCache.txt" | head -n 1)
  PYTHONPATH=$work/root$python PYTHONDONTWRITEBYTECODE=1 "${interpreter:-/usr/bin/python3}" -c '
import sys, twoport
assert twoport.__file__.startswith(sys.argv[1]), twoport.__file__
print("twoport", twoport.__version__, twoport.run(twoport.load_scene(sys.argv[1] + "/usr/share/twoport/scenes/held_spring.textproto")).summary["verdict_kind"])
' "$work/root"
fi
grep -rqF "$build" "$work/root/usr/lib" "$work/root/usr/include" --include='*.cmake' --include='*.h' && fail "paths of the build are in the package"
if command -v man >/dev/null; then
  man -l --warnings "$work/root/usr/share/man/man1/twoport-master.1.gz" 2>&1 >"$work/page" | grep . && fail "the man page has faults"
  grep -q -- '--device' "$work/page" || fail "the man page lacks options"
fi
if command -v lintian >/dev/null; then
  lintian --fail-on error --no-tag-display-limit --suppress-tags no-changelog,statically-linked-binary "$deb" >"$work/lintian" 2>&1 ||
    { grep '^E:' "$work/lintian"; fail "lintian finds errors"; }
fi
# Completion, in a shell of its own.
PATH=$work/root/usr/bin:$PATH bash -c '
  . "$0"
  COMP_WORDS=(twoport-master --device s) COMP_CWORD=2; _twoport twoport-master s --device
  [[ " ${COMPREPLY[*]} " == *" sim "* ]] || { echo "no device is completed: ${COMPREPLY[*]}"; exit 1; }
  COMP_WORDS=(twoport-lab do) COMP_CWORD=1; _twoport twoport-lab do twoport-lab
  [[ " ${COMPREPLY[*]} " == *" doctor "* ]] || { echo "no command is completed: ${COMPREPLY[*]}"; exit 1; }
  COMP_WORDS=(twoport-lab sweep --va) COMP_CWORD=2; _twoport twoport-lab --va sweep
  [[ " ${COMPREPLY[*]} " == *" --vary "* ]] || { echo "no option is completed: ${COMPREPLY[*]}"; exit 1; }
' "$work/root/usr/share/bash-completion/completions/twoport-lab"

# The page's programs start from there, and end by Ctrl-C.
env --default-signal=INT "$work/root/usr/bin/twoport-play" --no-browser >"$work/play" 2>&1 &
play=$!
for ((i = 0; i < 200; i++)); do grep -q '^page: http' "$work/play" && break; sleep 0.1; done
address=$(sed -n 's|^page: http://||p' "$work/play")
[ -n "$address" ] || fail "twoport-play: $(cat "$work/play")"
exec 3<>"/dev/tcp/${address%:*}/$(sed 's|.*:||; s|/||' <<<"$address")"
printf 'GET / HTTP/1.1\r\nHost: %s\r\nConnection: close\r\n\r\n' "${address%/}" >&3
head -n 1 <&3 | grep -q '200 OK' || fail "no page at $address"
exec 3>&-
kill -INT $play
wait $play || fail "twoport-play: $(cat "$work/play")"

echo "$(basename "$deb"): $(du -h "$deb" | cut -f 1), $(wc -l <"$work/contents") entries"
