#!/bin/sh
# test_faults.sh PORTMETD MAKE_SCENE SAME_RECORDING: lost messages and a node that is paused change no
# bit of the result.
. "$(dirname "$0")/network.sh"
steps=100

"$portmetd" run "$scene" --in-process --quiet --steps $steps --record "$folder/plain.h5" ||
    fail "in process"

# A node stopped for a while in the middle of a run.
start run run "$scene" --quiet --steps 5000 --record "$folder/paused.h5"
wait_for $pid left right
node=$(child $pid right)
kill -STOP "$node" || fail "no node to pause"
sleep 1
kill -CONT "$node"
ends run $pid 0 ""
"$portmetd" run "$scene" --in-process --quiet --steps 5000 --record "$folder/long.h5" ||
    fail "long, in process"
"$same_recording" "$folder/long.h5" "$folder/paused.h5" || fail "paused"

# One message of ten lost, each for all its receivers.
if nft add table ip loss 2>/dev/null &&
    nft add chain ip loss input '{ type filter hook input priority 0; }' &&
    nft add rule ip loss input udp dport 7667 numgen random mod 10 == 0 counter drop; then
    start run run "$scene" --quiet --steps $steps --record "$folder/lossy.h5"
    ends run $pid 0 ""
    "$same_recording" "$folder/plain.h5" "$folder/lossy.h5" || fail "lossy"
    nft list chain ip loss input | grep -q 'packets [1-9]' || fail "nothing was lost"
else
    echo "no nft here: loss is covered by test_lockstep only"
fi

no_orphans "at the end"
finish
