#!/bin/sh
# test_return.sh PORTMETD MAKE_SCENE SAME_RECORDING HEARS_THE_SAME STRANGER [KILLS [STEPS [SEED]]]: nodes and the
# coordinator are killed at random while a run goes on; it ends with the bits of an undisturbed one, and
# leaves no process and no file behind.
. "$(dirname "$0")/network.sh"
kills=${6:-4}
steps=${7:-2500}
seed=${8:-$(date +%s)}
configs=$(realpath "$(dirname "$0")/../../configs")

# Three processes: when one dies, it may be between two others, or not. What a balanced integrator
# must remember is more than the state.
chain=$folder/scene_chain.yaml
sed -e "s,weights/,$configs/weights/,; s,reference/,$configs/reference/," \
    -e 's/integrator: rk4, substeps: 6/integrator: rk4_balanced, substeps: 2/' \
    -e '/^time:/i lockstep: {window: 8, checkpoint: 50}' "$configs/chain_3.yaml" >"$chain"
"$portmetd" run "$chain" --in-process --steps $steps --record "$folder/plain.h5" >"$folder/plain.out" ||
    fail "in process"

# laws NAME: what a run's tables say of both laws, errors and fluxes, as speed differs.
laws() {
    grep -v -e '^Speed' -e '; in one process$' -e '; over LCM$' "$folder/$1.out"
}

# same_tables NAME: bits and tables.
same_tables() {
    "$same_recording" "$folder/plain.h5" "$folder/$1.h5" || fail "$1: other bits"
    laws plain >"$folder/plain.laws"
    laws "$1" | cmp -s - "$folder/plain.laws" || fail "$1: other tables"
}

# same_end NAME: and an empty folder.
same_end() {
    same_tables "$1"
    [ -z "$(ls "$folder/$1")" ] || fail "$1: left $(ls "$folder/$1")"
    no_orphans "$1"
}

# Undisturbed.
start calm run "$chain" --steps $steps --checkpoint "$folder/calm" --record "$folder/calm.h5"
ends calm $pid 0 ""
same_end calm

# Killed at random.
start killed run "$chain" --steps $steps --checkpoint "$folder/killed" --record "$folder/killed.h5"
run=$pid
done=0
for choice in $(awk -v seed="$seed" -v kills="$kills" 'BEGIN {
    srand(seed)
    split("link1 link2 link3 scene_chain.yaml", who, " ")
    for (i = 0; i < kills; i++) printf "%.2f:%s ", 0.05 + 0.2 * rand(), who[1 + int(4 * rand())]
}'); do
    sleep "${choice%:*}"
    victim=$(child $run "[^ ]*${choice#*:}")
    [ -n "$victim" ] && kill -KILL "$victim" 2>/dev/null && done=$((done + 1))
done
wait $run
code=$?
[ $code -eq 0 ] || fail "killed: exit code $code"
[ "$(grep -c 'killed by signal 9 (Killed), started again$' "$folder/killed.err")" -eq $done ] ||
    fail "killed: expected $done lines"
same_end killed
echo "seed $seed: $done of $kills kills"
[ $((2 * done)) -ge "$kills" ] || fail "killed: the run was over too early"

# The run itself is killed: its processes end, and the same command goes on with it.
start first run "$chain" --steps $steps --checkpoint "$folder/again" --record "$folder/again.h5"
run=$pid
for _ in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20; do
    [ -e "$folder/again/chain_3-link3.checkpoint" ] && break
    sleep 0.05
done
kill -KILL $run
wait $run
[ -n "$(ls "$folder/again")" ] || fail "again: no checkpoints"
start again run "$chain" --steps $steps --checkpoint "$folder/again" --record "$folder/again.h5"
ends again $pid 0 ""
same_end again

# A run that pauses says so while it does: one process is stopped, not killed.
start paused run "$chain" --steps 1000000 --checkpoint "$folder/paused"
run=$pid
for _ in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20; do
    [ -e "$folder/paused/chain_3-link2.checkpoint" ] && break
    sleep 0.05
done
start second run "$chain" --steps 10 --checkpoint "$folder/paused"
ends second $pid 4 "paused: another run uses it"
victim=$(child $run "[^ ]*link2")
kill -STOP "$victim"
for _ in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20; do
    grep -q "the run pauses after step [0-9]*: no word from link2" "$folder/paused.err" && break
    sleep 0.3
done
grep -q "the run pauses" "$folder/paused.err" || fail "paused: nothing is said while it pauses"
kill -CONT "$victim"
kill -INT $run
wait $run
no_orphans "a run that paused"

# By hand: a node and the coordinator are killed, and started again with the same commands.
by_hand() {
    if [ "$1" = coordinator ]; then
        start "$1" coordinator "$chain" --steps $steps --checkpoint "$folder/hand" \
            --record "$folder/hand.h5"
    else
        start "$1" node "$chain" "$1" --checkpoint "$folder/hand"
    fi
    eval "$1=$pid"
}
for name in link1 link2 link3 coordinator; do
    by_hand $name
done
for name in link2 coordinator link1; do
    sleep 0.15
    eval "kill -KILL \$$name"
    by_hand $name
done
for name in coordinator link1 link2 link3; do
    eval "ends $name \$$name 0 ''"
done
cp "$folder/coordinator.out" "$folder/hand.out"
same_tables hand
[ "$(ls "$folder/hand" | wc -l)" -eq 4 ] || fail "by hand: expected the last checkpoints"

# `run` finds that all is done, says so again, and removes what is left.
mv "$folder/hand.h5" "$folder/done.h5"
mv "$folder/hand" "$folder/done"
start done run "$chain" --steps $steps --checkpoint "$folder/done" --record "$folder/done.h5"
ends done $pid 0 ""
same_end done
finish
