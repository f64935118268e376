#!/bin/sh
# test_return.sh PORTMETD MAKE_SCENE SAME_RECORDING HEARS_THE_SAME STRANGER [KILLS [STEPS [SEED]]]: nodes and the
# coordinator are killed at random while a run goes on; it ends with the bits of an undisturbed one, and
# leaves no process and no file behind. It is held, so that no run is being over before it was killed.
. "$(dirname "$0")/network.sh"
kills=${6:-4}
steps=${7:-800}
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

# An implicit integrator, a part with a boundary input, one at rest, and sealed messages.
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

# has_lost NAME COUNT: whether the run has told of as many deaths.
has_lost() {
    [ "$(grep -c 'killed by signal 9 (Killed), started again$' "$folder/$1.err")" -eq "$2" ]
}

# choices KILLS: holds at random steps, one in each of as many equal parts of the run, when to kill
# after the run was let go so far, and whom. Every other kill waits until the run is held.
choices() {
    awk -v seed="$seed" -v kills="$1" -v steps="$steps" 'BEGIN {
        srand(seed)
        split("link1 link2 link3 coordinator", who, " ")
        for (i = 0; i < kills; i++) {
            hold = 1 + int((steps - 1) * (i + rand()) / (kills + 1))
            when = i % 2 ? "held" : sprintf("%.3f", 0.03 * rand())
            printf "%d:%s:%s ", hold, when, who[1 + int(4 * rand())]
        }
    }'
}

# killed NAME SCENE KILLS: killed at random, on its way to a step or held there. Whoever was killed may still
# be on its way back when the next one is.
killed() {
    start "$1" run "$2" --steps $steps --checkpoint "$folder/$1" --record "$folder/$1.h5" --held
    run=$pid
    kills_done=0
    at_hold=0
    for choice in $(choices "$3"); do
        step=${choice%%:*}
        when=${choice#*:}
        when=${when%:*}
        goes_on "$2" "$step"
        if [ "$when" = held ]; then
            held "$1" "$step"
        else
            sleep "$when" # a place at random, anywhere before it
        fi
        find_child $run "${choice##*:}"
        says "$1" "held after step $step\$" && at_hold=$((at_hold + 1))
        kill -KILL "$victim" || fail "$1: ${choice##*:} was gone before it was killed"
        kills_done=$((kills_done + 1))
        wait_until has_lost "$1" $kills_done || fail "$1: expected $kills_done deaths"
        [ $failures -eq 0 ] || return
    done
    goes_on "$2"
    wait $run
    code=$?
    [ $code -eq 0 ] || fail "$1: exit code $code"
    has_lost "$1" "$3" || fail "$1: expected $3 deaths"
    same_end "$1"
    echo "$1, seed $seed: $kills_done of $3 kills, $((kills_done - at_hold)) on the way, $at_hold held"
}

asked=$steps
steps=800
plain "$mixed"
killed mixed "$mixed" 3
steps=$((2500 + asked))
plain "$strict"
killed strict "$strict" $((3 + kills / 5))
steps=$asked

# Undisturbed.
plain "$chain"
start calm run "$chain" --steps $steps --checkpoint "$folder/calm" --record "$folder/calm.h5"
ends calm $pid 0 ""
same_end calm
killed killed "$chain" $kills

# A process that keeps its name, but serves another subsystem whose state is as long, has no checkpoint.
cut=$folder/scene_cut.yaml
sed 's/^scene: .*/scene: cut/' "$scene" >"$cut"
echo "processes: {a: [left], b: [right]}" >>"$cut"
start cut run "$cut" --steps $steps --checkpoint "$folder/cut" --held
goes_on "$cut" 100
held cut 100
kill -INT $pid
ends cut $pid 12 interrupted
sed -i "s/a: .left., b: .right./b: [left], a: [right]/" "$cut"
start exchanged run "$cut" --steps $steps --checkpoint "$folder/cut"
ends exchanged $pid 4 "the snapshot holds .* other parts shared the process"

# A run that pauses says so while it does: one process is stopped, not killed. No other run takes its folder.
# Both take seconds; more is tested meanwhile.
sed -e 's/^lockstep: {/&patience: 1000, /' -e 's/^scene: .*/scene: pausing/' "$chain" >"$folder/pausing.yaml"
start paused run "$folder/pausing.yaml" --steps $steps --checkpoint "$folder/paused" --held
paused=$pid
goes_on "$folder/pausing.yaml" 100
held paused 100
find_child $paused link2
stopped=$victim
kill -STOP "$stopped"
start second run "$folder/pausing.yaml" --steps 10 --checkpoint "$folder/paused"
second=$pid

# The run itself is killed, on its way: its processes end, and the same command goes on with it.
middle=$((steps / 2))
start first run "$chain" --steps $steps --checkpoint "$folder/again" --record "$folder/again.h5" --held
run=$pid
goes_on "$chain" $middle
held first $middle
goes_on "$chain" $((steps - 1))
kill -KILL $run
wait $run
wait_until has_no_processes scene || fail "again: processes have outlived their run"
[ -n "$(ls "$folder/again")" ] || fail "again: no checkpoints"
start again run "$chain" --steps $steps --checkpoint "$folder/again" --record "$folder/again.h5"
ends again $pid 0 ""
same_end again

# By hand: nodes and the coordinator are killed, and started again with the same commands.
by_hand() {
    if [ "$1" = coordinator ]; then
        start "$1" coordinator "$chain" --steps $steps --checkpoint "$folder/hand" \
            --record "$folder/hand.h5" --held
    else
        start "$1" node "$chain" "$1" --checkpoint "$folder/hand"
    fi
    eval "$1=$pid"
}
for name in link1 link2 link3 coordinator; do
    by_hand $name
done
for choice in $((steps / 4)):link2 $((steps / 2)):coordinator $((steps * 3 / 4)):link1; do
    goes_on "$chain" "${choice%:*}"
    name=${choice#*:}
    # The coordinator on its way, which nobody but itself could tell of.
    [ $name = coordinator ] || held coordinator "${choice%:*}"
    eval "kill -KILL \$$name" || fail "by hand: $name was gone before it was killed"
    by_hand $name
done
goes_on "$chain"
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

# What was begun above.
awaits paused "the run pauses after step 100: no word from link2"
ends second $second 4 "paused: another run uses it"
kill -CONT "$stopped"
kill -INT $paused
wait $paused
[ $? -eq 12 ] || fail "paused: expected an interrupted run"
no_orphans "at the end" ""
finish
