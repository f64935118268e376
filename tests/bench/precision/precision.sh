#!/bin/sh
# precision.sh PORTMETD CONFIGS FOLDER: `portmetd bench` for the learned double pendula, and for known ones with slow,
# fast and very fast conduction. Leaves a table and a picture of each in FOLDER.
set -eu
portmetd=$1
configs=$(cd "$2" && pwd)
mkdir -p "$3"
cd "$3"

# bench SCENE: table and picture. 60 s from each start, as long as the reports.
bench() {
    "$portmetd" bench "$1" --steps 200 --budget 240 --picture "$(basename "$1" .yaml)" | tee "$(basename "$1" .yaml).table"
}
bench "$configs/double_pendulum.yaml"
bench "$configs/double_pendulum_fast.yaml"
for K in 0.5 300 3000; do
    sed -e "s/^scene: .*/scene: known_${K%.*}/; s/{K: 0.5}/{K: $K}/; s|file: reference|file: $configs/reference|" \
        "$configs/analytic_double_pendulum.yaml" >"known_${K%.*}.yaml"
    bench "known_${K%.*}.yaml"
done
