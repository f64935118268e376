#!/bin/sh
# Scores one material of a learned solid on bodies of several shapes, sizes and meshes that it has not seen, and draws box
# plots of the errors of all of them, as README.md in this folder reports them.
#   sh tests/bench/beams/bodies.sh OUT [WEIGHTS]
# OUT takes fields, scores and pictures; fields that are already there are not simulated again.
set -eu
if [ $# -lt 1 ]; then
    echo "usage: sh $0 OUT [WEIGHTS]" >&2
    exit 2
fi
root=$(cd "$(dirname "$0")/../../.." && pwd)
out=$1
weights=${2:-$root/configs/weights/solid_beam/material.h5}
train=${PORTMET_TRAIN:-$root/build/trainer/portmet-train}
mesh=${PORTMET_MESH:-$root/build/trainer/bodies/portmet-mesh}
export OPENBLAS_NUM_THREADS=1
mkdir -p "$out"
: >"$out/bodies"

# score NAME TRAJECTORIES: simulates the body of OUT/NAME.yaml, and lets the learned material follow.
score() {
    [ -e "$out/$1.h5" ] || "$train" truth "$out/$1.yaml" --trajectories "$2" -o "$out/$1.h5"
    echo "== $1"
    "$train" respond "$out/$1.h5" --weights "$weights" --trajectories "$2" --plot "$out/$1.errors" -o "$out/$1.learned.h5" |
        tee "$out/$1.txt"
    echo "$1" >>"$out/bodies"
}

# box NAME SEED TRAJECTORIES SIZE ELEMENTS FORCE
box() {
    sed "s/^seed: .*/seed: $2/; s/size: .40, 10, 10./size: [$4]/; s/elements: .20, 5, 5./elements: [$5]/
        s/force: .2.0e4, 1.0e5./force: [$6]/" "$root/configs/truth/beam.yaml" >"$out/$1.yaml"
    score "$1" "$3"
}

# body NAME SEED TRAJECTORIES MESH FORCE
body() {
    sed "s/^seed: .*/seed: $2/; s,mesh: [^ ]*,mesh: $4,; s/force: .1.0e4, 5.0e4./force: [$5]/" \
        "$root/configs/truth/l_body.yaml" >"$out/$1.yaml"
    score "$1" "$3"
}

box beam 777001 0:20 "40, 10, 10" "20, 5, 5" "2.0e4, 1.0e5"
box finer 777001 0:3 "40, 10, 10" "28, 7, 7" "2.0e4, 1.0e5"
box coarser 777001 0:4 "40, 10, 10" "14, 3, 3" "2.0e4, 1.0e5"
box shorter 91 0:4 "30, 10, 10" "15, 5, 5" "2.0e4, 1.5e5"
box longer 92 0:4 "50, 10, 10" "25, 5, 5" "2.0e4, 6.0e4"
box higher 93 0:4 "40, 8, 14" "20, 4, 7" "2.0e4, 1.0e5"
box plate 94 0:4 "30, 30, 4" "10, 10, 2" "5.0e3, 3.0e4"
body l_body 95 0:20 "$root/configs/meshes/l_body.h5" "1.0e4, 5.0e4"
if "$mesh" "$root/configs/meshes/column.geo" --split -o "$out/column_mesh.h5"; then
    body column 96 0:8 "$(realpath "$out/column_mesh.h5")" "2.0e4, 1.2e5"
fi

{
    echo "set terminal pngcairo size 1100,700 font 'DejaVu Sans,11' background 'white'"
    echo "set output 'bodies.png'"
    echo "set multiplot layout 2,2"
    echo "set style data boxplot"
    echo "set boxwidth 0.5"
    echo "set border 3 linecolor '#555555'"
    echo "set tics nomirror out"
    echo "set grid noxtics ytics linecolor '#e4e4e4'"
    echo "set logscale y"
    echo "set key noautotitle"
    echo "set ylabel 'relative L_2 error, %'"
    printf "set xrange [0.4:%s.6]\nset xtics scale 0 rotate by 30 right (" "$(wc -l <"$out/bodies")"
    awk '{ printf "%s\"%s\" %d", (NR > 1 ? ", " : ""), $1, NR }' "$out/bodies" | sed 's/_/ /g'
    echo ")"
    column=0
    for score in "displacement:#0072b2" "stress, free nodes:#d55e00" "stored energy:#009e73" "dissipated energy:#cc79a7"; do
        column=$((column + 1))
        echo "set title '${score%:*}'"
        awk -v c=$column -v colour="${score##*:}" '{
            printf "%s\"%s.errors/errors.txt\" using (%d):%d pointtype 7 pointsize 0.3 linewidth 1.2 linecolor \"%s\" fillstyle solid 0.5",
                (NR > 1 ? ", " : "plot "), $1, NR, c, colour } END { print "" }' "$out/bodies"
    done
} >"$out/bodies.gp"
(cd "$out" && gnuplot bodies.gp) && echo "drew $out/bodies.png"
train=$(realpath "$train")
(cd "$out" && "$train" picture l_body.h5 l_body.learned.h5 --trajectory 1 --time 0.9 --error -o l_body.png)
