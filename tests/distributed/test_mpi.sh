#!/bin/sh
# test_mpi.sh PORTMETD MAKE_SCENE SAME_RECORDING: over MPI a chain records the bits that it has in one process, with
# 3 and 9 ranks, while LCM repeats chosen channels. A wrong number of ranks, a rank that dies, one that stops and a
# signal end a job within bounded time, and leave a recording that can be read.
if ! command -v mpirun >/dev/null; then
    echo "skipped: mpirun is missing (openmpi-bin)"
    exit 77
fi
. "$(dirname "$0")/network.sh"
# Open MPI refuses root, and more ranks than cores, unless it is told otherwise.
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1

# chain NAME PROCESSES: the scene NAME.
chain() {
    cat >"$folder/$1.yaml" <<EOF
scene: chain
time: {dt: 1.0e-2, steps: 20, integrator: rk4}
lockstep: {patience: ${patience-1000}}
tap: [LEDGER, HEALTH, "FLUX_[b-d]"]
$(links 40)
processes: $2
EOF
}

# ranks NAME COUNT ARGUMENT...: a run of the scene NAME in the background, its process id in $pid.
ranks() {
    name=$1
    count=$2
    shift 2
    : >"$folder/$name.err"
    mpirun -n "$count" "$portmetd" run "$folder/$name.yaml" --url mpi:// "$@" \
        >"$folder/$name.out" 2>"$folder/$name.err" </dev/null &
    pid=$!
    started="$started $pid"
}

# same NAME COUNT: a run with so many ranks records what one process has recorded.
same() {
    ranks "$1" "$2" --quiet --record "$folder/$1.h5"
    wait $pid || fail "$1: exit code $?"
    ! grep -q -v 'warning: ' "$folder/$1.err" || fail "$1: expected no error"
    "$same_recording" "$folder/plain.h5" "$folder/$1.h5" || fail "$1: other bits"
}

# says_once NAME PATTERN: exactly one line of its errors is like this.
says_once() {
    [ "$(grep -c -e "$2" "$folder/$1.err")" -eq 1 ] || fail "$1: expected one line like \"$2\""
}

# one_rank PID: the process id of the last rank that this mpirun has started.
one_rank() {
    children "$1" | tr ' ' '\n' | grep . | tail -n 1
}

# holds NAME: a run with 3 ranks that waits for its second step, which is due after minutes.
holds() {
    sed 's/^time: {/&pace: 1.0e-4, /' "$folder/two.yaml" >"$folder/$1.yaml"
    ranks "$1" 3 --record "$folder/$1.h5"
    wait_until hears "$1" "step 1 of" || fail "$1: no step"
    sleep 0.5 # until the recording is written
}

# hears NAME WORDS: whether `status` hears this.
hears() {
    "$portmetd" status "$folder/$1.yaml" 2>/dev/null | grep -q "$2"
}

# has_ended NAME: no rank is left, and two samples can be read.
has_ended() {
    wait_until has_no_processes "$1.yaml" || fail "$1: ranks are left"
    h5ls "$folder/$1.h5" | grep -q 'step .*{2/Inf}' || fail "$1: the recording is not sound"
}

chain two '{a: "link[0:20]", b: "link[20:40]"}'
if ! "$portmetd" run "$folder/two.yaml" --url mpi:// >"$folder/probe" 2>&1 && grep -q "built without MPI" "$folder/probe"; then
    echo "skipped: portmetd is built without MPI"
    exit 77
fi
grep -q "expected 3 ranks (mpirun -n 3), .*, found 1" "$folder/probe" || fail "without mpirun: $(cat "$folder/probe")"
"$portmetd" run "$folder/two.yaml" --in-process --quiet --record "$folder/plain.h5" || fail "in process"
same two 3

# A listener hears what the scene's tap names, and nothing else.
lcm-logger --quiet --lcm-url='udpm://239.255.76.67:7667?ttl=0&recv_buf_size=4194304' "$folder/log" &
logger=$!
started="$started $logger"
wait_until listens $logger || fail "the logger does not listen"
chain eight '{a: "link[0:5]", b: "link[5:10]", c: "link[10:15]", d: "link[15:20]", e: "link[20:25]",
             f: "link[25:30]", g: "link[30:35]", h: "link[35:40]"}'
same eight 9
kill -INT $logger
wait $logger
for channel in LEDGER FLUX_b FLUX_c FLUX_d; do
    [ "$(grep -a -o "chain_$channel" "$folder/log" | wc -l)" -gt 1 ] || fail "the tap does not repeat $channel"
done
for channel in FLUX_a FLUX_e TICK REPORT_b COMMAND; do
    ! grep -a -q "chain_$channel" "$folder/log" || fail "the tap repeats $channel"
done

# What does not work with ranks is an error, said once.
cp "$folder/two.yaml" "$folder/wrong.yaml"
ranks wrong 2
wait $pid
[ $? -eq 2 ] || fail "wrong: expected exit code 2"
says_once wrong "portmetd: scene chain has 2 processes: expected 3 ranks (mpirun -n 3), .*, found 2"
start node node "$folder/two.yaml" a --url mpi://
ends node $pid 2 'node does not work at mpi://: .*"mpirun -n 3 portmetd run'

# `status` hears the tap; an interrupt ends all ranks, and prints the tables of the steps done.
holds interrupt
kill -INT $pid
wait $pid && fail "interrupt: expected a failure"
has_ended interrupt
grep -q "^Both laws" "$folder/interrupt.out" || fail "interrupt: no tables"

holds death
kill -KILL "$(one_rank $pid)"
wait $pid && fail "death: expected a failure"
has_ended death

patience=6
chain two '{a: "link[0:20]", b: "link[20:40]"}'
holds stopped
kill -STOP "$(one_rank $pid)"
wait $pid
[ $? -eq 8 ] || fail "stopped: expected exit code 8"
has_ended stopped
says_once stopped "portmetd: no word for .* from: [ab]\$"

no_orphans "at the end" ""
finish
