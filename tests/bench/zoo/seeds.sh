#!/bin/sh
# seeds.sh PORTMET_TRAIN SCENE TRAINING_DATA TEST_DATA DIR SEED...: proposes a training file for a
# scene and fits it with each seed. Prints one line for each seed, with the exit code of the fit and
# the median and the mean error of every group and of the entropy produced, in percent. The last
# line is the CPU time of all fits and evaluations, in user mode and in the kernel.
set -eu
train=$1
scene=$2
data=$3
test=$4
folder=$5
shift 5
export OPENBLAS_NUM_THREADS=1
mkdir -p "$folder"
"$train" propose "$scene" --data "$data" -o "$folder/proposed.yaml" >/dev/null
for seed in "$@"; do
    out=$folder/$seed
    mkdir -p "$out"
    code=0
    "$train" fit "$folder/proposed.yaml" --data "$data" -o "$out" --seed "$seed" >"$out/fit.log" 2>&1 || code=$?
    "$train" evaluate "$scene" --weights "$out" --data "$test" >"$out/evaluate.log" 2>&1 || true
    awk -v seed="$seed" -v code="$code" '
        $2 == "trajectory" { line = line sprintf("  %s %s (%s)", $1, $5, $8) }
        $1 == "production" { line = line sprintf("  production %s (%s)", $4, $5) }
        END { printf "seed %s, exit code %s:%s\n", seed, code, line }' "$out/evaluate.log"
done
times | tail -1
