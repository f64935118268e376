#!/bin/sh
# Fits scenes to the public data of other projects and prints the errors on trajectories that the fit has not seen,
# as README.md in this folder reports them. Rows whose data are missing are skipped.
#   sh tests/bench/peers/peers.sh FOLDER [OUT]
# FOLDER holds the data files (gfinn_gas.h5, viscoelastic.h5, double_pendulum.h5), OUT takes weights and output.
set -u
if [ $# -lt 1 ]; then
    echo "usage: sh $0 FOLDER [OUT]" >&2
    exit 2
fi
root=$(cd "$(dirname "$0")/../../.." && pwd)
data=$1
out=${2:-$root/build/peers}
program=${PORTMET_TRAIN:-$root/build/trainer/portmet-train}
export OPENBLAS_NUM_THREADS=1
failed=0

# row NAME DATASET SCENE TRAINED TESTED [TRAINING]: fits configs/train/TRAINING.yaml, or NAME, and scores SCENE.
row() {
    name=$1 file=$data/$2 scene=$root/configs/$3.yaml training=$root/configs/train/${6:-$1}.yaml
    if [ ! -f "$file" ]; then
        echo "$name: skipped, because $file is missing"
        return
    fi
    mkdir -p "$out/$name"
    echo "== $name"
    if ! (time -p "$program" fit "$training" --data "$file" --trajectories "$4" -o "$out/$name") \
        >"$out/$name/fit.txt" 2>&1; then
        failed=1
    fi
    grep -E ' weights, trajectories|Verdict|^user|^portmet-train' "$out/$name/fit.txt"
    "$program" evaluate "$scene" --weights "$out/$name" --data "$file" --trajectories "$5" --json \
        >"$out/$name/evaluate.json" || failed=1
    "$program" evaluate "$scene" --weights "$out/$name" --data "$file" --trajectories "$5" >"$out/$name/evaluate.txt" 2>&1
    grep -E '^Relative L2| trajectory  |production' "$out/$name/evaluate.txt"
}

row gfinn_gas gfinn_gas.h5 gfinn_gas 0:60 60:80
row gfinn_gas_given gfinn_gas.h5 gfinn_gas 0:60 60:80
unseen=2,7,12,17,22,27,32,37,42,47,52,57,62,67,72,77
seen=0:2,3:7,8:12,13:17,18:22,23:27,28:32,33:37,38:42,43:47,48:52,53:57,58:62,63:67,68:72,73:77,78:80
row couette viscoelastic.h5 couette "$seen" "$unseen"
row public_double_pendulum double_pendulum.h5 public_double_pendulum 0:30 30:40
exit $failed
