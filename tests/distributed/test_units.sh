#!/bin/sh
# test_units.sh BUILD MAKE_SCENE SAME_RECORDING: the installed units under a systemd of their own, as process 1 of a
# container whose root is an overlay over this one, without a network. Needs root, overlayfs and systemd-nspawn (Debian:
# systemd-container); else it is skipped (77).
. "$(dirname "$0")/../support/setting.sh"
build=$(realpath "$1") make_scene=$2 same_recording=$3
root=$folder/root
mkdir "$folder/upper" "$folder/work" "$root"
if ! { [ "$(id -u)" -eq 0 ] && command -v systemd-nspawn &&
    mount -t overlay overlay -o "lowerdir=/,upperdir=$folder/upper,workdir=$folder/work" "$root"; } >"$folder/skip" 2>&1; then
    echo "skipped: no container: $(cat "$folder/skip")"
    exit 77
fi
trap 'umount "$root"; rm -rf "$folder"' EXIT

# --- what the container finds: the program, its units, three scenes, and the script that it runs ---

rm -rf "$root"/etc/systemd/system/*.wants "$root"/etc/portmet "$root"/var/lib/portmet "$root"/var/lib/private/portmet
install "$build/daemon/app/portmetd" "$root/usr/local/bin"
install -m 644 "$build"/daemon/app/*.service "$root/etc/systemd/system"
mkdir "$root/srv/pair"
"$make_scene" "$root/srv/pair" || fail "make_scene"
scene=$root/srv/pair/scene.yaml
portmetd=$root/usr/local/bin/portmetd
"$portmetd" run "$scene" --in-process --quiet --steps 1500 --record "$folder/plain.h5" || fail "in process"
# Ten simulated seconds in one of the clock: a run takes 7.5 s.
sed -i 's/^time: {/lockstep: {patience: 3}\ntime: {pace: 10, /' "$scene"
mkdir "$root/etc/portmet"
sed 's/^scene: pair/scene: served/; s|weights: |weights: /srv/pair/|; s|file: |file: /srv/pair/|' "$scene" \
    >"$root/etc/portmet/served.yaml"
echo "scene: broken" >"$root/etc/portmet/broken.yaml"

cat >"$root/etc/systemd/system/check.service" <<'UNIT'
[Service]
Type=oneshot
ExecStart=-/bin/sh /check.sh
StandardOutput=file:/check.out
StandardError=inherit
ExecStopPost=/bin/systemctl --no-block poweroff
UNIT
cat >"$root/check.sh" <<'SCRIPT'
fail() { echo "FAILED: $*"; systemctl --no-pager --full status 'portmet*'; journalctl --no-pager -n 40; exit 1; }
value() { systemctl show -p "$2" --value "$1"; }
is() { [ "$(value "$1" "$2")" = "$3" ]; }
# wait_until COMMAND...: for 60 s.
wait_until() {
    for i in $(seq 600); do "$@" && return; sleep 0.1; done
    fail "never: $*"
}
networked() { ip link set lo up; ip link set lo multicast on; ip route replace 224.0.0.0/4 dev lo; }
left=portmet-node@pair-left right=portmet-node@pair-right service=portmetd@pair
url='udpm://239.255.76.67:7667?ttl=0' scene=/srv/pair/scene.yaml
# begin NAME: a run begins, which is recorded.
begin() { portmetd start $scene --url "$url" --steps 1500 --record "$1.h5" --quiet || fail "start $1"; }
ended() { portmetd query $scene --url "$url" | grep -q 'ended, run .*step 1500 of'; }
networked
portmetd emit systemd $scene --url "$url" --record /var/lib/portmet/runs -o /hosts && cp -r /hosts/localhost/etc / &&
    systemctl daemon-reload || fail "emit"

# The target starts the processes. One of them is killed, and returns from its checkpoint.
systemctl start portmet-pair.target || fail "the target"
wait_until is $service ActiveState active
begin killed
sleep 1
systemctl kill -s KILL $left
wait_until is $left NRestarts 1
wait_until ended
cp /var/lib/portmet/runs/killed.h5 /
echo "a killed process has returned"

# No network for longer than many starts take: the units do not give up, and serve another run when it is back.
begin lost
sleep 1
ip link set lo down
sleep 15
for unit in $left $right $service; do
    is $unit ActiveState failed && fail "$unit has given up: $(value $unit Result)"
done
networked
for unit in $left $right $service; do
    wait_until is $unit ActiveState active
done
begin cut
wait_until ended
cp /var/lib/portmet/runs/cut.h5 /
systemctl stop $left $right $service
echo "a scene has outlived its network"

# A service is ready when all its processes are there. It returns from a kill, reads its scene again, and ends well.
systemctl start portmetd@served || fail "the service: $(journalctl --no-pager -n 5 -u portmetd@served)"
portmetd status /etc/portmet/served.yaml >/status || fail "the service does not answer"
systemctl kill -s KILL portmetd@served
wait_until is portmetd@served NRestarts 1
wait_until is portmetd@served ActiveState active
systemctl reload portmetd@served || fail "reload"
systemctl stop portmetd@served || fail "stop"
is portmetd@served Result success || fail "the service ends with $(value portmetd@served Result)"
echo "a service has returned"

# What another start does not mend is not started again.
systemctl start portmetd@broken && fail "a broken scene is served"
is portmetd@broken NRestarts 0 || fail "a broken scene is started again"
is portmetd@broken ExecMainStatus 3 || fail "a broken scene: exit code $(value portmetd@broken ExecMainStatus)"
echo "a broken scene is not started again"
SCRIPT

# --- the container ---

timeout 300 systemd-nspawn -q -D "$root" --register=no --keep-unit --private-network -b systemd.unit=check.service \
    >"$folder/boot" 2>&1 </dev/null
cat "$root/check.out"
[ "$(grep -c '^a ' "$root/check.out")" -eq 4 ] || fail "the units; the container said: $(tail -n 3 "$folder/boot")"
for name in killed cut; do
    "$same_recording" "$folder/plain.h5" "$root/$name.h5" || fail "$name: other bits"
done
finish
