#!/bin/sh
# test_accuracy.sh PORTMET_TRAIN: the shipped weights on trajectories that training never saw. The
# truth is simulated anew; medians per trajectory must stay below the bounds, and neither law may be
# violated at any step.
. "$(dirname "$0")/../support/setting.sh"
train=$1

# number FILE GROUP: the median error per trajectory of a group, or of the entropy that is produced
number() {
    [ "$2" = production ] && pattern='s/.*"kind": "production", .*"median": \([^,]*\), "mean".*/\1/p' ||
        pattern="s/.*\"$2\": {\"trajectory\": {.*\"median\": \([^,]*\),.*\"snapshot\".*/\1/p"
    sed -n "$pattern" "$1" | head -1
}

# scene NAME TRUTH TRAJECTORIES GROUP BOUND...
scene() {
    name=$1 truth=$2 range=$3
    shift 3
    "$train" truth "configs/truth/$truth.yaml" --trajectories "$range" -o "$folder/$name.h5" \
        >/dev/null || failures=$((failures + 1))
    "$train" evaluate "configs/$name.yaml" --data "$folder/$name.h5" --json >"$folder/$name.json" ||
        failures=$((failures + 1))
    while [ $# -ge 2 ]; do
        found=$(number "$folder/$name.json" "$1")
        if ! awk -v x="$found" -v b="$2" 'BEGIN { exit !(x != "" && x + 0 <= b + 0) }'; then
            echo "FAILED: $name, $1: median error $found, at most $2"
            failures=$((failures + 1))
        fi
        shift 2
    done
    if ! grep -q '"violations": 0,' "$folder/$name.json"; then
        echo "FAILED: $name: a law was violated"
        failures=$((failures + 1))
    fi
}

scene double_pendulum double_pendulum 40:50 q 0.00001 p 0.00001 s 0.00001 production 0.00001
scene double_pendulum_fast double_pendulum_fast 40:50 q 0.0001 p 0.0001 s 0.0002 production 0.001
scene chain_10 chain_10 0:20 q 0.00001 p 0.00001 s 0.00001 production 0.00001
scene gas_containers gas_containers 80:100 v 0.0005 p 0.0005 s 0.0005
scene driven_upper driven_upper 80:100 q 0.0000001 p 0.0000001 s 0.0000001
scene driven_lower driven_lower 80:100 q 0.0000001 p 0.0000001 s 0.0000001
scene driven_double_pendulum double_pendulum 40:50 q 0.000001 p 0.000001 s 0.000001 production 0.000001

finish
