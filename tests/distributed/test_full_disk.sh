#!/bin/sh
# test_full_disk.sh PORTMETD MAKE_SCENE SAME_RECORDING PORTMET_TRAIN: a recording whose disk becomes full ends
# the run with one line of error and exit code 4, and holds what it says is certain. A scene may choose to go
# on without its recording.
if [ "${PM_PRIVATE_MOUNTS:-}" != yes ] && unshare -m true 2>/dev/null; then
    PM_PRIVATE_MOUNTS=yes exec unshare -m sh "$0" "$@"
fi
. "$(dirname "$0")/network.sh"
disks=
trap 'umount $disks; clean_up' EXIT

# small_disk NAME KIB: an empty file system of this size at $folder/NAME.
small_disk() {
    mkdir "$folder/$1"
    mount -t tmpfs -o "size=$2k" none "$folder/$1" || fail "no file system of $2 KiB"
    disks="$disks $folder/$1"
}

# numbers OPTION OBJECT FILE: the numbers of an attribute (-a) or of a series (-d), one in a line.
numbers() {
    h5dump -y -w 1 "$1" "$2" "$3" | awk '/DATA \{/ { data = 1; next } /\}/ { data = 0 } data && NF { print $1 + 0 }'
}

# keeps_its_promise FILE LEAST: at least so many samples are certain; the rows of these are numbered from 0 on,
# and have an energy.
keeps_its_promise() {
    certain=$(numbers -a /committed "$1")
    [ "$certain" -ge "$2" ] || fail "$1: $certain samples, expected $2"
    numbers -d /step "$1" | head -n "$certain" >"$folder/rows"
    seq 0 $((certain - 1)) | cmp - "$folder/rows" || fail "$1: the steps are not those from 0 to $certain"
    for series in /subsystems/left/E /ledger/energy; do
        numbers -d $series "$1" | head -n "$certain" | grep -vcx 0 >"$folder/rows"
        [ "$(cat "$folder/rows")" -eq "$certain" ] || fail "$1: $series: rows are missing or zero"
    done
}

forever=1000000
for size in 200 400 700; do
    small_disk "disk$size" $size
    start "full$size" run "$scene" --in-process --quiet --steps $forever --record "$folder/disk$size/run.h5"
    ends "full$size" $pid 4 \
        "run.h5: cannot write samples (No space left on device); the first [0-9]* samples are certain"
done
keeps_its_promise "$folder/disk200/run.h5" 0
keeps_its_promise "$folder/disk400/run.h5" 256
keeps_its_promise "$folder/disk700/run.h5" 1024

# With checkpoints nothing is started again, since nothing has crashed.
small_disk kept 400
start kept run "$scene" --quiet --steps $forever --record "$folder/kept/run.h5" --checkpoint "$folder/saved"
ends kept $pid 4 "run.h5: cannot write"
keeps_its_promise "$folder/kept/run.h5" 200

# A limit that comes after space was reserved lets a write fail halfway. No signal and no crash end the process.
start halfway run "$scene" --quiet --steps $forever --record "$folder/halfway.h5" --held
goes_on "$scene" 600
wait_until test -s "$folder/halfway.h5" || fail "halfway: no recording"
prlimit --fsize=1000 --pid $pid
goes_on "$scene"
ends halfway $pid 4 "halfway.h5: cannot write.*(File too large)"

# By choice the run goes on to its end, and says so.
small_disk gone 200
sed '/^time:/i record: {on_error: go_on}' "$scene" >"$folder/scene_gone.yaml"
# goes_on NAME OPTION...: whether the run makes all steps and tells what it lost.
goes_on() {
    gone=$1
    shift
    start "$gone" run "$folder/scene_gone.yaml" "$@" --steps 3000 --record "$folder/gone/run.h5"
    ends "$gone" $pid 0 ""
    says "$gone" "portmetd: the run goes on without its recording: .*; the first [0-9]* samples are certain" ||
        fail "$gone: nobody is told"
    grep -q ": 3000 steps" "$folder/$gone.out" || fail "$gone: not all steps were made"
    keeps_its_promise "$folder/gone/run.h5" 0
}
goes_on together --in-process
goes_on apart
goes_on supervised --checkpoint "$folder/saved_gone"

# A dataset is written as a whole or not at all.
small_disk truth 16
"$4" truth "$(dirname "$0")/../../configs/truth/double_pendulum.yaml" -o "$folder/truth/pendulum.h5" --trajectories \
    0:4 >"$folder/truth.out" 2>"$folder/truth.err"
found=$?
[ $found -eq 4 ] || fail "truth: expected exit code 4, found $found"
says truth "pendulum.h5: cannot write .*(No space left on device)" || fail "truth: no cause"
[ -z "$(ls "$folder/truth")" ] || fail "truth: something is left: $(ls "$folder/truth")"

# Where nothing can be written, whoever writes says so, and what is there stays.
mount -o remount,ro "$folder/disk700" || fail "no file system that is read-only"
before=$(cksum "$folder/disk700/run.h5")
for write in "--in-process --record $folder/disk700/run.h5" "--in-process --record $folder/disk700/new.h5" \
    "--checkpoint $folder/disk700/saved"; do
    start locked run "$scene" --quiet --steps 5 $write
    ends locked $pid 4 "disk700.*Read-only file system"
done
"$4" truth "$(dirname "$0")/../../configs/truth/double_pendulum.yaml" -o "$folder/disk700/new.h5" --trajectories \
    0:1 >"$folder/locked.out" 2>"$folder/locked.err"
[ $? -eq 4 ] && says locked "disk700/new.h5: .*Read-only file system" || fail "truth: read-only"
[ "$before" = "$(cksum "$folder/disk700/run.h5")" ] || fail "the recording has changed"
finish
