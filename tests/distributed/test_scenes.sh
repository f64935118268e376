#!/bin/sh
# test_scenes.sh PORTMETD MAKE_SCENE SAME_RECORDING: scenes assembled from the shipped weights run, stay
# close to their references and keep both laws: parts used many times (chains), and a circle of
# three subsystems and ports (gas containers). In processes over LCM the bits are the same.
. "$(dirname "$0")/network.sh"
configs=$(dirname "$0")/../../configs

# keeps NAME STEPS: a run in this process; every error of its table at most 0.1 %.
keeps() {
    "$portmetd" run "$configs/$1.yaml" --steps "$2" --in-process --record "$folder/$1.h5" \
        >"$folder/$1.out" 2>"$folder/$1.err" || fail "$1: does not run"
    grep -q "steps in violation: 0;" "$folder/$1.out" || fail "$1: a law is violated"
    awk '$3 == "%" { n++; if (!($2 <= 0.1)) bad = 1 } END { exit n < 3 || bad }' "$folder/$1.out" ||
        fail "$1: errors above 0.1 %: $(grep '%$' "$folder/$1.out" | tr -s ' \n' ' ')"
}

# same_bits NAME STEPS: like the run before, but one process per subsystem.
same_bits() {
    start "${1}_lcm" run "$configs/$1.yaml" --steps "$2" --quiet --record "$folder/$1_lcm.h5"
    ends "${1}_lcm" $pid 0 ""
    "$same_recording" "$folder/$1.h5" "$folder/$1_lcm.h5" || fail "$1: other bits over LCM"
}

keeps chain_3 100
keeps chain_5 100
keeps chain_10 20
same_bits chain_10 20
keeps gas_containers 400
same_bits gas_containers 400
finish
