#!/usr/bin/env bash
# The Debian package, installed into a bare Debian of this release, feels a wall: bare_root.sh BUILD_DIR
# Exit status 77: skipped, in words.
set -euo pipefail
build=$(readlink -f "$1")
skip() { echo "skipped: $1"; exit 77; }
command -v dpkg-shlibdeps >/dev/null || skip "dpkg-shlibdeps is not installed (apt-get install dpkg-dev)"
. /etc/os-release

work=$(mktemp -d)
root=$work/root
trap 'umount "$root/proc" 2>/dev/null || true; rm -rf --one-file-system "$work"' EXIT
"$(dirname "$0")/../../tests/package/bare_root" "${VERSION_CODENAME:-bookworm}" "$root"
cpack --config "$build/CPackConfig.cmake" -B "$work" >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }
cp "$work"/twoport_*.deb "$root/tmp/twoport.deb"
installs() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive apt-get "$@" >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }; }
installs update
installs install -y --no-install-recommends /tmp/twoport.deb
before=$(date +%s%N)
chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root bash -euo pipefail -c '
  cd /root
  getent group realtime >/dev/null
  twoport-play --help >/dev/null
  twoport-slave --scene one_axis_wall --set duration_s=4 --out slave >slave.log 2>&1 &
  twoport-master --scene one_axis_wall --set duration_s=4 --trace none --out master >master.log 2>&1 || [ $? = 3 ] || { cat master.log; exit 1; }
  kill -INT $! 2>/dev/null || true
  wait || true
'
took=$((($(date +%s%N) - before) / 1000000))
touching=$(sed -n 's/.*"touching_share": *\([0-9.e+-]*\).*/\1/p' "$root/root/master/summary.json")
awk -v share="${touching:-0}" 'BEGIN { exit !(share > 0.1) }' || { cat "$root/root/master/summary.json"; echo "no wall was felt"; exit 1; }
echo "installed into a bare ${VERSION_CODENAME:-Debian}: touches the wall in $touching of a run of 4 s, which took $took ms with its start"
