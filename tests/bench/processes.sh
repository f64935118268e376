#!/bin/sh
# processes.sh PORTMETD CONFIGS [LINKS...]: what a step of chains of so many learned links in different states (1,000, 10,000
# and 100,000) costs in one process, in one for each core, and in eight, by `portmetd bench --processes`.
set -eu
portmetd=$1
configs=$(realpath "$2")
shift 2
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
for links in ${*:-1000 10000 100000}; do
    awk -v n="$links" -v weights="$configs/weights/double_pendulum" 'BEGIN {
        state = ".h5, state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}}"
        print "scene: chain\ntime: {dt: 1.0e-6, steps: 300, integrator: euler}\nlockstep: {patience: 60}\nsubsystems:"
        print "  link0: {weights: " weights "/upper" state "\n  \"link[1:" n "]\": {weights: " weights "/lower" state
        print "ports:\n  \"joint[0:" n - 1 "]\": {law: bracket, weights: " weights "/joint.h5,"
        print "    between: [\"link[i]\", \"link[i+1]\"], expose: {\"link[i]\": [q, p, s], \"link[i+1]\": [q, p, s]}}"
        split("4.5 4.4 -0.5 1.4 -0.1 -2.7 0.1 1.4 -0.2 0.1", mean, " ")
        for (i = 0; i < 5*n; ++i) printf "%s%g", i == 0 ? "start: [" : ", ", mean[(i < 5 ? i : 5 + i % 5) + 1] + 0.1*(rand() - 0.5)
        print "]"
    }' >"$folder/chain.yaml"
    "$portmetd" bench "$folder/chain.yaml" --processes --budget 120
done
