# Sourced by the distributed tests: runs the test again inside a private network with multicast, as
# root, or skips it (77). Gives it a scene folder and helpers; PORTMETD MAKE_SCENE SAME_RECORDING are
# the test's arguments.
set -u
. "$(dirname "$0")/../support/private_network.sh"

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

# wait_until COMMAND...: looks every few milliseconds whether COMMAND succeeds; fails if it has not after
# 120 s, which only a fault takes, however busy the machine is.
wait_until() {
    read -r limit _ </proc/uptime
    limit=$((${limit%.*} + 120))
    until "$@"; do
        read -r clock _ </proc/uptime
        [ "${clock%.*}" -le "$limit" ] || return 1
        sleep 0.005
    done
}

# start NAME ARGUMENT...: portmetd in the background; its process id in $pid, its words in NAME.out
# and NAME.err.
start() {
    name=$1
    shift
    : >"$folder/$name.err"
    "$portmetd" "$@" >"$folder/$name.out" 2>"$folder/$name.err" </dev/null &
    pid=$!
    started="$started $pid"
}

# goes_on SCENE [STEP] [OPTION...]: lets the run that is held there go on, until as many steps are complete.
goes_on() {
    goes_scene=$1
    goes_step=${2-}
    shift $(($# > 1 ? 2 : 1))
    wait_until "$portmetd" resume "$goes_scene" ${goes_step:+--steps "$goes_step"} --quiet "$@" 2>>"$folder/clients" ||
        fail "$goes_scene: nobody lets it go on: $(tail -n 1 "$folder/clients")"
}

# says NAME PATTERN: whether its errors have such a line.
says() {
    grep -q -e "$2" "$folder/$1.err"
}

# awaits NAME PATTERN: waits until its errors have such a line.
awaits() {
    wait_until says "$1" "$2" || fail "$1: never said \"$2\""
}

# held NAME STEP: waits until the run is held there.
held() {
    awaits "$1" "portmetd: held after step $2\$"
}

# ends NAME PID CODE PATTERN: waits for it, and compares exit code and error ("": none). That it
# was held, or paused, is no error, nor is who makes others wait.
ends() {
    wait "$2"
    found=$?
    [ $found -eq "$3" ] || fail "$1: expected exit code $3, found $found"
    grep -v -e 'portmetd: \(held after step\|the run pauses\|the run goes on\)' \
        -e 'warning: .*\(makes all others wait\|had to be sent\)' "$folder/$1.err" \
        >"$folder/errors"
    if [ -z "$4" ]; then
        [ ! -s "$folder/errors" ] || fail "$1: expected no error"
    else
        grep -q -e "$4" "$folder/errors" || fail "$1: expected an error like \"$4\""
        [ "$(wc -l <"$folder/errors")" -eq 1 ] || fail "$1: expected one line of error"
    fi
}

# children PID: the processes that it has started; not every kernel lists them.
children() {
    cat "/proc/$1/task/$1/children" 2>/dev/null && return
    for status in /proc/[0-9]*/stat; do
        read -r process _ _ parent _ 2>/dev/null <"$status" && [ "$parent" = "$1" ] && echo "$process"
    done
}

# child PID NAME: the process id of the node NAME that the run PID launched; nothing if there is none.
child() {
    for process in $(children "$1"); do
        read -r comm 2>/dev/null <"/proc/$process/comm" && [ "$comm" = "$2" ] && echo "$process"
    done
}

has_child() {
    [ -n "$(child "$1" "$2")" ]
}

# find_child PID NAME: waits until that process is there; its id in $victim.
find_child() {
    wait_until has_child "$1" "$2" || fail "no process $2"
    victim=$(child "$1" "$2")
}

# has_own_network PID: whether it has left the network of this test.
has_own_network() {
    [ "$(readlink "/proc/$1/ns/net")" != "$(readlink /proc/self/ns/net)" ]
}

# listens PID: whether it has a socket on LCM's port.
listens() {
    for socket in $(awk '$2 ~ /:1DF3$/ { print $10 }' /proc/net/udp); do # port 7667
        ls -l "/proc/$1/fd" | grep -q "socket:\[$socket\]" && return
    done
    return 1
}

# await_nodes PID...: waits until these nodes listen. What a coordinator that starts then tells them, also
# as its last word, waits in their sockets.
await_nodes() {
    for node in "$@"; do
        wait_until listens "$node" || fail "a node does not listen"
    done
}

# misses SCENE NODE: whether a coordinator says that all nodes but this one have joined.
misses() {
    "$portmetd" status "$1" 2>/dev/null | grep -q "steps/s; $2 is missing"
}

# await_missing SCENE NODE: waits until all nodes but this one have joined.
await_missing() {
    wait_until misses "$1" "$2" || fail "no coordinator waits for $2 alone"
}

# processes SCENES: those that have an argument which begins like this in the test's folder.
processes() {
    for file in $(printf %s "$folder/$1" | grep -lsF -f - /proc/[0-9]*/cmdline); do
        process=${file#/proc/}
        echo "${process%/cmdline}"
    done
}

has_no_processes() {
    [ -z "$(processes "$1")" ]
}

# no_orphans WHEN [SCENES]: no such process is left.
no_orphans() {
    for process in $(processes "${2-scene}"); do
        fail "$1: process $process is still there: $(tr '\0' ' ' <"/proc/$process/cmdline")"
    done
}

"$make_scene" "$folder" || { echo "FAILED: make_scene"; exit 1; }
scene=$folder/scene.yaml

# links COUNT: the sections `subsystems` and `ports` of a scene, for a chain of COUNT learned links.
links() {
    configs=$(realpath "$(dirname "$0")/../../configs")
    state="state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}"
    cat <<EOF
subsystems:
  link0:
    weights: $configs/weights/double_pendulum/upper.h5
    $state
    initial: {q: [4.5, 4.4], p: [-0.5, 1.4], s: [-0.1]}
  "link[1:$1]":
    weights: $configs/weights/double_pendulum/lower.h5
    $state
    initial: {q: [-2.7, 0.1], p: [1.4, -0.2], s: [0.1]}
ports:
  "joint[0:$(($1 - 1))]":
    law: bracket
    between: ["link[i]", "link[i+1]"]
    weights: $configs/weights/double_pendulum/joint.h5
    expose: {"link[i]": [q, p, s], "link[i+1]": [q, p, s]}
EOF
}
