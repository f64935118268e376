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

# Strict lock-step of steps of one round: fluxes grant, and reports wait (lockstep/lookahead.h).
strict=$folder/scene_strict.yaml
sed -e '/^lockstep:/d' -e 's/^time:.*/time: {dt: 0.001, steps: 20, integrator: euler}/' \
    -e '/^time:/i lockstep: {window: 1, checkpoint: 50}' -e 's/^scene: .*/scene: strict/' "$chain" >"$strict"

# An implicit integrator, a part under a load, one at rest, and sealed messages.
mixed=$folder/scene_mixed.yaml
head -c 32 /dev/urandom >"$folder/mixed.key"
chmod 600 "$folder/mixed.key"
sed -n '/^models:/,/^subsystems:/p' "$configs/analytic_double_pendulum.yaml" >"$folder/models"
cat >"$mixed" <<END
scene: mixed
key_file: mixed.key
time: {dt: 0.05, steps: 20, integrator: discrete_gradient, substeps: 1}
lockstep: {window: 4, checkpoint: 40}
$(sed '$d' "$folder/models")
  bead: {energy: ["|p|^2/2"], reversible: {given: [[q, p, 1.0]]}}
boundary_inputs:
  pivot: {p: {unit: kg m/s, dE: [0.1, 0]}, s: {unit: J/K, dE: 295, dS: 1}}
subsystems:
  link1:
    model: link
    constants: {m: 1.0, C: 0.027, l0: 2.0}
    state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}
    initial: {q: [0.0, 2.0], p: [-0.2, 0.1], s: 0.0}
  link2:
    model: link
    constants: {m: 2.0, C: 0.192, l0: 1.0}
    state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}
    initial: {q: [1.1, 0.0], p: [0.0, 0.3], s: 0.1}
  link3:
    model: bead
    state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}}
    initial: {q: [1.0, 0.0], p: [0.0, 0.0]}
ports:
  base: {law: bracket, between: [pivot, link1], expose: {pivot: [p, s], link1: [q, s]}, model: joint}
  joint: {law: bracket, between: [link1, link2], expose: {link1: [p, s], link2: [q, s]}, model: joint}
END

# plain SCENE: the run that all others must be like.
plain() {
    "$portmetd" run "$1" --in-process --steps $steps --record "$folder/plain.h5" \
        >"$folder/plain.out" || fail "in process"
}

# laws NAME: what a run's tables say of both laws, errors, fluxes and terms, as speed differs.
laws() {
    grep -v -e '; in one process$' -e '; over LCM$' "$folder/$1.out" | sed 's/^Speed: .*;//'
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

# killed NAME SCENE KILLS: killed at random.
killed() {
    start "$1" run "$2" --steps $steps --checkpoint "$folder/$1" --record "$folder/$1.h5"
    run=$pid
    done=0
    for choice in $(awk -v seed="$seed" -v kills="$3" -v scene="${2##*/}" 'BEGIN {
        srand(seed)
        split("link1 link2 link3 " scene, who, " ")
        for (i = 0; i < kills; i++) printf "%.2f:%s ", 0.05 + 0.2 * rand(), who[1 + int(4 * rand())]
    }'); do
        sleep "${choice%:*}"
        victim=$(child $run "[^ ]*${choice#*:}")
        [ -n "$victim" ] && kill -KILL "$victim" 2>/dev/null && done=$((done + 1))
    done
    wait $run
    code=$?
    [ $code -eq 0 ] || fail "$1: exit code $code"
    [ "$(grep -c 'killed by signal 9 (Killed), started again$' "$folder/$1.err")" -eq $done ] ||
        fail "$1: expected $done lines"
    same_end "$1"
    echo "$1, seed $seed: $done of $3 kills"
    [ $((2 * done)) -ge "$3" ] || fail "$1: the run was over too early"
}

asked=$steps
steps=2500
plain "$mixed"
killed mixed "$mixed" 3
steps=$((40000 + 2 * asked))
plain "$strict"
killed strict "$strict" $((3 + kills / 5))
steps=$asked

# Undisturbed.
plain "$chain"
start calm run "$chain" --steps $steps --checkpoint "$folder/calm" --record "$folder/calm.h5"
ends calm $pid 0 ""
same_end calm
killed killed "$chain" $kills

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
