#!/bin/sh
# test_faults.sh PORTMETD MAKE_SCENE SAME_RECORDING: lost messages, a node that is paused and a run that is
# stopped as a whole for longer than its patience change no bit of the result.
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

# Without loss.
configs=$(realpath "$(dirname "$0")/../../configs")
sed -e "s,reference/,$configs/reference/,; s/rk4, substeps: 16/rk4, tolerance: 1.0e-4/" \
    "$configs/analytic_double_pendulum.yaml" >"$folder/adaptive.yaml"
"$portmetd" run "$folder/adaptive.yaml" --in-process --quiet --steps $steps --record "$folder/adaptive.h5" ||
    fail "adaptive, in process"
sed -e "s,weights/,$configs/weights/,; s,reference/,$configs/reference/," \
    -e '/^time:/i processes: {first: [link1, link2]}' \
    -e '/^time:/i lockstep: {window: 16}' "$configs/chain_5.yaml" >"$folder/chain.yaml"
start four run "$folder/chain.yaml" --steps $steps --record "$folder/four.h5"
ends four $pid 0 ""

# What was begun above.
awaits paused "the run pauses after step 50: no word from right"
says paused "held after step 80" && fail "paused: steps were made without a node"
kill -CONT "$victim"
held paused 80
awaits paused "the run goes on"
goes_on "$folder/patient.yaml"
wait $paused || fail "paused: exit code $?"
"$same_recording" "$folder/plain.h5" "$folder/paused.h5" || fail "paused"

# Messages lost, each for all its receivers: one of ten of two processes, one of twenty of four.
lose() {
    nft flush chain ip loss input &&
        nft add rule ip loss input udp dport 7667 numgen random mod "$1" == 0 counter drop
}
# keeps_bits NAME: a lossy run is like the one before without loss.
keeps_bits() {
    "$same_recording" "$folder/$1.h5" "$folder/$1_lossy.h5" || fail "$1, lossy"
    nft list chain ip loss input | grep -q 'packets [1-9]' || fail "$1: nothing was lost"
}
speed() {
    sed -n 's/^Speed: \([0-9]*\).*/\1/p' "$folder/$1.out"
}
if nft add table ip loss 2>/dev/null &&
    nft add chain ip loss input '{ type filter hook input priority 0; }' && lose 10; then
    start run run "$scene" --quiet --steps $steps --record "$folder/plain_lossy.h5"
    ends run $pid 0 ""
    keeps_bits plain

    start adaptive run "$folder/adaptive.yaml" --quiet --steps $steps --record "$folder/adaptive_lossy.h5"
    ends adaptive $pid 0 ""
    keeps_bits adaptive

    lose 20
    start four_lossy run "$folder/chain.yaml" --steps $steps --record "$folder/four_lossy.h5"
    ends four_lossy $pid 0 ""
    keeps_bits four
    echo "four processes: $(speed four) steps/s, with 5 % loss $(speed four_lossy)"
else
    echo "no nft here: loss is covered by test_lockstep only"
fi

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
