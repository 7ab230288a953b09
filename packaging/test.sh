#!/bin/sh
# Installs the Debian package on this machine and runs the line as its unit would: the unit's own command, as the user tapline,
# without privileges, on a root that is read-only but for the unit's folders. A tap set is put into the inbox, its verdict is
# waited for, the line is stopped, and the package is removed. Needs root, and a machine without an installed tapline.
# Usage: test.sh PACKAGE.deb
set -eu
package=$(realpath "$1")
unit=/lib/systemd/system/tapline.service
work=$(mktemp -d)
[ "$(id -u)" = 0 ] || { echo "this needs root"; exit 1; }
! dpkg-query -W tapline >/dev/null 2>&1 || { echo "tapline is installed here already"; exit 1; }
[ ! -e /etc/tapline ] && [ ! -e /var/lib/tapline ] || { echo "/etc/tapline or /var/lib/tapline is there already"; exit 1; }

line=
end() {
    [ -z "$line" ] || kill "$line" 2>/dev/null || true
    dpkg --purge tapline >/dev/null 2>&1 || true
    rm -rf "$work" /var/lib/tapline /etc/tapline /run/tapline
    deluser --quiet --system tapline >/dev/null 2>&1 || true
}
trap end EXIT
fail() { echo "FAILED: $*"; cat "$work/out" "$work/err" 2>/dev/null || true; exit 1; }
wait_for() {
    for _ in $(seq 1200); do
        if eval "$2"; then return; fi
        sleep 0.1
    done
    fail "$1"
}

if command -v lintian >/dev/null; then lintian --allow-root --fail-on error "$package" || fail "lintian"; fi
dpkg --install "$package" >"$work/dpkg" 2>&1 || { cat "$work/dpkg"; fail "dpkg"; }
echo "installed: $(tapline --version), $(dpkg -L tapline | grep -c man1) manual pages, user $(id tapline)"
man_page=/usr/share/man/man1/tapline-line.1.gz
zcat "$man_page" | grep -q '^\.TH' || fail "$man_page is no manual page"
systemd-analyze verify "$unit" || fail "systemd-analyze verify"
systemd-analyze security --offline=true --threshold=25 --no-pager "$unit" | tail -n 1 || fail "systemd-analyze security"
tapline config --check /etc/tapline/line.toml

# A tap set of a small simulated casing.
cat >"$work/small.toml" <<END
[scan]
offsets_mm = [0.0]
velocities_m_per_s = [1.85]
repetitions = 2
locations = 24
END
export XDG_RUNTIME_DIR="$work"
(cd "$work" && tapline -q run --config small.toml --reference self --out casings && tapline export casings taps --out taps) >"$work/log"
unset XDG_RUNTIME_DIR
cat >/etc/tapline/line.toml <<END
[[station]]
number = 1
source = "folder"
folder = "inbox"
[fuse]
reference = "self"
END

# As systemd would: the folders of the unit, and all else read-only.
install -d -o tapline -g tapline -m 0700 /run/tapline
install -d -o tapline -g tapline -m 0750 /var/lib/tapline /var/lib/tapline/inbox
before=$(ls /dev/shm | wc -l)
command=$(sed -n 's/^ExecStart=//p' "$unit")
cat >"$work/enter.sh" <<END
set -eu
for folder in /var/lib/tapline /run/tapline; do mount --bind \$folder \$folder; done
mount -t tmpfs tmpfs /tmp
mount -o remount,ro,bind /
if touch /usr/written 2>/dev/null; then echo "the root is not read-only"; exit 1; fi
cd /var/lib/tapline
umask 027
exec setpriv --reuid tapline --regid tapline --init-groups --no-new-privs --bounding-set=-all --inh-caps=-all \
    env -i PATH=/usr/bin:/bin XDG_RUNTIME_DIR=/run/tapline $command
END
cp "$work/enter.sh" /run/tapline/enter.sh
unshare --mount --propagation private sh /run/tapline/enter.sh >"$work/out" 2>"$work/err" &
line=$!
wait_for "the line does not begin" 'grep -q "waiting for casings" "$work/err"'
cp -r "$work/taps" /var/lib/tapline/set && chown -R tapline:tapline /var/lib/tapline/set && mv /var/lib/tapline/set /var/lib/tapline/inbox/set
wait_for "no verdict" '[ "$(grep -c "SIM-" "$work/out")" -ge 2 ]'
as_tapline="setpriv --reuid tapline --regid tapline --init-groups env XDG_RUNTIME_DIR=/run/tapline"
$as_tapline tapline status --out /var/lib/tapline/results || fail "status"
cat "$work/out"
# An upgrade leaves the running line alone.
dpkg --install --force-confold "$package" >"$work/dpkg" 2>&1 || fail "upgrade"
grep -q 'station' /etc/tapline/line.toml && grep -q inbox /etc/tapline/line.toml || fail "the upgrade replaced the configuration"
kill -0 "$line" || fail "the upgrade ended the line"
$as_tapline tapline status --out /var/lib/tapline/results >/dev/null || fail "status after the upgrade"
kill -TERM "$line"
wait "$line" && code=0 || code=$?
line=
[ "$code" = 0 ] || fail "the line ended with $code"
$as_tapline tapline verify /var/lib/tapline/results || fail "verify"
[ "$(stat -c %U /var/lib/tapline/results/*/*.h5 | sort -u)" = tapline ] || fail "the archives are not the user's"
rm /run/tapline/enter.sh
[ -z "$(ls -A /run/tapline)" ] || fail "left in /run/tapline: $(ls -A /run/tapline)"
[ "$(ls /dev/shm | wc -l)" -le "$before" ] || fail "left in /dev/shm: $(ls /dev/shm)"
[ -z "$(find /var/lib/tapline -name '*.new')" ] || fail "drafts are left"
echo "The package works: $package"
