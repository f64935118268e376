#!/bin/sh
# test_noise.sh PORTMET_TRAIN [short|shortest]: short versions of the fits to measurements of configs/train. Six short trajectories
# of the double pendulum get noise and gaps; a fit to four of them predicts the other two, all variables included. `short`
# fits positions with gaps alone, and asks for both laws: the other fits take no code that this one does not take. `shortest`,
# for slow builds, does so with fewer samples. The whole test is the test test_noise_long.
. "$(dirname "$0")/../support/setting.sh"
train=$1
short=${2:-}
configs=$PWD/configs
states=40 missing=
[ -z "$short" ] || states=28 missing="--missing 0.2"
[ "$short" != shortest ] || states=14

# make NAME OPTION...: trajectories with what the options add.
make() {
    name=$1
    shift
    sed -e 's/^trajectories: .*/trajectories: 6/' -e "s/^states: .*/states: $states/" "$configs/truth/double_pendulum.yaml" \
        >"$folder/truth.yaml"
    "$train" truth "$folder/truth.yaml" -o "$folder/$name.h5" "$@" >"$folder/out" 2>&1 || fail "truth $*"
}

# score NAME TRAINING SCENE SECONDS LIMIT...: the median errors of the groups q, p, s are below the limits in %.
score() {
    name=$1 training=$2 scene=$3 seconds=$4
    shift 4
    sed -e "s|^scene: \\.\\./|scene: $configs/|" -e 's/"0:40"/"0:4"/' "$configs/train/$training.yaml" >"$folder/training.yaml"
    timeout 900 "$train" fit "$folder/training.yaml" --data "$folder/$name.h5" -o "$folder/weights" >"$folder/out" 2>&1 ||
        fail "fit of $training to $name"
    timeout 300 "$train" evaluate "$configs/$scene.yaml" --weights "$folder/weights" --data "$folder/$name.h5" \
        --trajectories 4:6 --estimate "$seconds" --truth "$folder/clean.h5" >"$folder/out" 2>&1 || fail "evaluate $name"
    for group in q p s; do
        [ $# -gt 0 ] || break
        awk -v group=$group -v limit="$1" '/against the truth/ { on = 1 }
            on && $1 == group { found = 1; bad = !($2 < limit) } END { exit bad || !found }' "$folder/out" ||
            fail "$name: expected a median error of $group below $1 %"
        shift
    done
    grep -q "steps in violation 0;" "$folder/out" || fail "$name: expected both laws"
}

make clean
make gaps --noise 0.01 --missing 0.5 --seed 2
make camera --noise 0.001 $missing --seed 3
if [ -n "$short" ]; then
    score camera double_pendulum_positions double_pendulum_positions $((states / 6 + 1))
    finish
fi
score gaps double_pendulum_noise double_pendulum 6 0.5 0.8 1.5
score clean double_pendulum_hidden double_pendulum_hidden 3 0.01 0.02
score camera double_pendulum_positions double_pendulum_positions 6 0.3 0.6

# Motion alone tells the heat capacity of springs whose entropy is hidden, though only by terms of second order: 5.08 J/K.
sed -e 's/^trajectories: .*/trajectories: 4/' "$configs/truth/double_pendulum.yaml" >"$folder/truth.yaml"
"$train" truth "$folder/truth.yaml" -o "$folder/long.h5" >"$folder/out" 2>&1 || fail "truth of four trajectories"
sed -e "s|^scene: \\.\\./|scene: $configs/|" -e 's/"0:40"/"0:4"/' -e 's/capacity: 5.08/capacity: {learned: 4.0, positive: true}/' \
    "$configs/train/double_pendulum_hidden.yaml" >"$folder/training.yaml"
timeout 1200 "$train" fit "$folder/training.yaml" --data "$folder/long.h5" -o "$folder/weights" >"$folder/out" 2>&1 ||
    fail "fit of heat capacities"
for name in upper.capacity lower.capacity; do
    awk -v name=$name '$1 == name { found = 1; bad = !($3 + 0 > 4.95 && $3 + 0 < 5.25) } END { exit bad || !found }' "$folder/out" ||
        fail "expected $name = 5.08"
done

finish
