#!/bin/sh
# seeds.sh PORTMET_TRAIN SCENE TRAINING DATA TEST_DATA TEST DIR SEED...: fits TRAINING with each seed
# and evaluates the trajectories TEST of TEST_DATA, for instance 40:50, or all of them where TEST is
# "all". Where TRAINING is "propose", the trainer proposes the training file. Prints one line for each
# seed, with the exit code of the fit and the median and the mean error of every group and of the entropy
# produced, in percent. Then come, for each group, the smallest, the middle and the largest of the medians
# and the largest mean. The last line is the CPU time of all fits and evaluations, in user mode and in
# the kernel.
set -eu
train=$1
scene=$2
training=$3
data=$4
test_data=$5
test=$6
folder=$7
shift 7
export OPENBLAS_NUM_THREADS=1
mkdir -p "$folder"
if [ "$training" = propose ]; then
    training=$folder/proposed.yaml
    "$train" propose "$scene" --data "$data" -o "$training" >/dev/null
fi
: >"$folder/errors"
for seed in "$@"; do
    out=$folder/$seed
    mkdir -p "$out"
    code=0
    "$train" fit "$training" --data "$data" -o "$out" --seed "$seed" >"$out/fit.log" 2>&1 || code=$?
    set -- "$scene" --weights "$out" --data "$test_data"
    [ "$test" = all ] || set -- "$@" --trajectories "$test"
    "$train" evaluate "$@" >"$out/evaluate.log" 2>&1 || true
    awk -v seed="$seed" -v code="$code" -v errors="$folder/errors" '
        function add(name, median, mean) {
            line = line sprintf("  %s %s (%s)", name, median, mean)
            print name, median, mean >>errors
        }
        $2 == "trajectory" { add($1, $5, $8) }
        $1 == "production" { add($1, $4, $5) }
        END { printf "seed %s, exit code %s:%s\n", seed, code, line }' "$out/evaluate.log"
done
sort -k1,1 -k2,2g "$folder/errors" | awk '
    function report() {
        if (count > 0) {
            printf "%s: medians %s, %s, %s; largest mean %s\n", name, medians[1],
                   medians[int((count + 1) / 2)], medians[count], worst
        }
        count = 0
        worst = 0
    }
    $1 != name { report(); name = $1 }
    { medians[++count] = $2; if ($3 + 0 > worst + 0) { worst = $3 } }
    END { report() }'
times >"$folder/times" # a pipe would start a shell, which has no children yet
tail -1 "$folder/times"
