#!/bin/sh
# test_faults.sh PORTMETD MAKE_SCENE SAME_RECORDING: a node that is paused, a network that is down and a run that is
# stopped as a whole for longer than its patience change no bit of the result. test_same_bits.sh and test_many.sh lose
# messages.
. "$(dirname "$0")/network.sh"
steps=100

"$portmetd" run "$scene" --in-process --quiet --steps $steps --record "$folder/plain.h5" ||
    fail "in process"

# A node stopped in the middle of a run: nobody gets on without it, though it is let go. The run says
# so after seconds; more is tested meanwhile.
sed '/^time:/i lockstep: {patience: 1000}' "$scene" >"$folder/patient.yaml"
start paused run "$folder/patient.yaml" --steps $steps --held --record "$folder/paused.h5"
paused=$pid
goes_on "$folder/patient.yaml" 50
held paused 50
find_child $paused right
kill -STOP "$victim" || fail "no node to pause"
goes_on "$folder/patient.yaml" 80

# All processes stopped, as by Ctrl-Z or in a frozen container, held and on their way. Each goes on later.
for hold in 50 1000000; do
    sed -e "/^time:/i lockstep: {patience: 4}" -e "s/^scene: .*/scene: frozen$hold/" "$scene" >"$folder/frozen$hold.yaml"
    start frozen$hold run "$folder/frozen$hold.yaml" --steps 1000000 --held
    eval "frozen$hold=$pid"
    goes_on "$folder/frozen$hold.yaml" 50
    held frozen$hold 50
    goes_on "$folder/frozen$hold.yaml" $hold
    kill -STOP $pid $(children $pid) || fail "no run to stop"
    eval "frozen_processes$hold='$pid $(children $pid)'"
done
sleep 6 # longer than their patience
for hold in 50 1000000; do
    eval "kill -CONT \$frozen_processes$hold"
    eval "pid=\$frozen$hold"
    sleep 0.2 # the silence of others would be found at once
    kill -INT $pid
    ends frozen$hold $pid 12 "interrupted"
done

# What was begun above.
awaits paused "the run pauses after step 50: no word from right"
says paused "held after step 80" && fail "paused: steps were made without a node"
kill -CONT "$victim"
held paused 80
awaits paused "the run goes on"
goes_on "$folder/patient.yaml"
wait $paused || fail "paused: exit code $?"
"$same_recording" "$folder/plain.h5" "$folder/paused.h5" || fail "paused"

# No network for a second, in the middle of a run of 2.5 s; and for longer than the run's patience.
has_begun() {
    "$portmetd" status "$1" 2>/dev/null | grep -q 'step [1-9]'
}
for second in 1 4; do
    sed -e "/^time:/i lockstep: {patience: $((second == 1 ? 10 : 2))}" -e 's/dt: /pace: 2, dt: /' "$scene" >"$folder/down$second.yaml"
    start down$second run "$folder/down$second.yaml" --steps $steps --record "$folder/down$second.h5"
    wait_until has_begun "$folder/down$second.yaml" || fail "down$second: no step"
    ip link set lo down
    sleep $second
    ip link set lo up
    ip route add 224.0.0.0/4 dev lo
    if [ $second = 1 ]; then
        ends down1 $pid 0 ""
        "$same_recording" "$folder/plain.h5" "$folder/down1.h5" || fail "a second without a network"
    else
        ends down4 $pid 8 "no word for 2"
    fi
done

# Too few descriptors for a socket.
(ulimit -n 7 && exec "$portmetd" run "$scene" --quiet) >"$folder/few.out" 2>"$folder/few.err"
[ $? -eq 7 ] && grep -q "no socket: Too many open files" "$folder/few.err" || fail "seven descriptors"

no_orphans "at the end" ""
finish
