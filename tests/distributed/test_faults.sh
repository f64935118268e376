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

    configs=$(realpath "$(dirname "$0")/../../configs")
    sed -e "s,reference/,$configs/reference/,; s/rk4, substeps: 16/rk4, tolerance: 1.0e-4/" \
        "$configs/analytic_double_pendulum.yaml" >"$folder/adaptive.yaml"
    "$portmetd" run "$folder/adaptive.yaml" --in-process --quiet --steps $steps --record "$folder/adaptive.h5"
    start adaptive run "$folder/adaptive.yaml" --quiet --steps $steps --record "$folder/adaptive_lossy.h5"
    ends adaptive $pid 0 ""
    keeps_bits adaptive

    nft flush chain ip loss input
    sed -e "s,weights/,$configs/weights/,; s,reference/,$configs/reference/," \
        -e '/^time:/i processes: {first: [link1, link2]}' \
        -e '/^time:/i lockstep: {window: 16}' "$configs/chain_5.yaml" >"$folder/chain.yaml"
    start four run "$folder/chain.yaml" --steps $steps --record "$folder/four.h5"
    ends four $pid 0 ""
    lose 20
    start four_lossy run "$folder/chain.yaml" --steps $steps --record "$folder/four_lossy.h5"
    ends four_lossy $pid 0 ""
    keeps_bits four
    echo "four processes: $(speed four) steps/s, with 5 % loss $(speed four_lossy)"
else
    echo "no nft here: loss is covered by test_lockstep only"
fi

no_orphans "at the end"
finish
