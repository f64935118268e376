# Sourced by the distributed tests: runs the test again inside a private network with multicast, as
# root, or skips it (77). Gives it a scene folder and helpers; PORTMETD MAKE_SCENE SAME_RECORDING are
# the test's arguments.
set -u
if [ "${PM_PRIVATE_NETWORK:-}" != yes ]; then
    if ! { [ "$(id -u)" -eq 0 ] && unshare -n true; } 2>/dev/null; then
        echo "skipped: a private network needs root"
        exit 77
    fi
    PM_PRIVATE_NETWORK=yes exec unshare -n sh "$0" "$@"
fi
ip link set lo up
ip link set lo multicast on
ip route add 224.0.0.0/4 dev lo

portmetd=$1
make_scene=$2
same_recording=$3
folder=$(mktemp -d)
failures=0
started=

clean_up() {
    for pid in $started; do
        kill -KILL "$pid" 2>/dev/null
    done
    rm -rf "$folder"
}
trap clean_up EXIT

fail() {
    failures=$((failures + 1))
    echo "FAILED: $*"
    for file in "$folder"/*.err; do
        [ -s "$file" ] && sed "s|^|    ${file##*/}: |" "$file"
    done
}

finish() {
    [ $failures -eq 0 ] || exit 1
    exit 0
}

# start NAME ARGUMENT...: portmetd in the background; its process id in $pid, its words in NAME.out
# and NAME.err.
start() {
    name=$1
    shift
    "$portmetd" "$@" >"$folder/$name.out" 2>"$folder/$name.err" </dev/null &
    pid=$!
    started="$started $pid"
}

# ends NAME PID CODE PATTERN: waits for it, and compares exit code and error ("": none).
ends() {
    wait "$2"
    found=$?
    [ $found -eq "$3" ] || fail "$1: expected exit code $3, found $found"
    if [ -z "$4" ]; then
        [ ! -s "$folder/$1.err" ] || fail "$1: expected no error"
    else
        grep -q -e "$4" "$folder/$1.err" || fail "$1: expected an error like \"$4\""
        [ "$(wc -l <"$folder/$1.err")" -eq 1 ] || fail "$1: expected one line of error"
    fi
}

# child PID NAME: the process id of the node NAME that the run PID launched.
child() {
    for status in /proc/[0-9]*/stat; do
        read -r process _ _ parent _ 2>/dev/null <"$status" || continue
        if [ "$parent" = "$1" ] && tr '\0' ' ' <"/proc/$process/cmdline" | grep -q " $2 \$"; then
            echo "$process"
        fi
    done
}

# wait_for PID NAME...: until all these nodes of the run PID are there, and stepping.
wait_for() {
    run=$1
    shift
    for node in "$@"; do
        for _ in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20; do
            [ -n "$(child "$run" "$node")" ] && break
            sleep 0.1
        done
    done
    sleep 0.5
}

# Until its recording is there, a run has not begun.
wait_for_file() {
    for _ in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20; do
        [ -s "$1" ] && return
        sleep 0.05
    done
    fail "no $1"
}

no_orphans() {
    printf %s "$folder/scene" >"$folder/pattern"
    for file in $(grep -lsF -f "$folder/pattern" /proc/[0-9]*/cmdline); do
        process=${file#/proc/}
        fail "$1: process ${process%/cmdline} is still there: $(tr '\0' ' ' <"$file")"
    done
}

"$make_scene" "$folder" || { echo "FAILED: make_scene"; exit 1; }
scene=$folder/scene.yaml
