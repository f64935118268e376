#!/bin/sh
# test_solid_cli.sh PORTMET_TRAIN: a material learned from a small body bends another one, on another mesh, as the
# finite elements do, and keeps both laws.
. "$(dirname "$0")/../support/setting.sh"
train=$1

# succeed ARGUMENT...
succeed() {
    timeout 400 "$train" "$@" >"$folder/out" 2>&1 </dev/null || fail "portmet-train $*: expected success"
}

# body NAME SEED SIZE ELEMENTS
body() {
    sed "s/^seed: .*/seed: $2/; s/size: .40, 10, 10./size: [$3]/; s/elements: .20, 5, 5./elements: [$4]/
        s/states: 41/states: 21/" configs/truth/beam.yaml >"$folder/$1.yaml"
    succeed truth "$folder/$1.yaml" --trajectories 0:2 -o "$folder/$1.h5"
}

# below LIMIT TEXT: the median in the line of TEXT.
below() {
    value=$(awk -v text="$2" 'index($0, text) { print $(NF - 2) }' "$folder/out")
    [ -n "$value" ] && awk "BEGIN { exit !($value < $1) }" || fail "$2: expected less than $1 %, found \"$value\""
}

body small 3 "12, 8, 8" "3, 2, 2"
body other 4 "24, 8, 12" "5, 2, 3"
succeed solid "$folder/small.h5" --iterations 5 -o "$folder/material.h5"
succeed respond "$folder/other.h5" --weights "$folder/material.h5" -o "$folder/learned.h5"
below 1 "displacement"
below 3 "stress, free nodes"
below 1 "stored energy"
below 3 "dissipated energy"
grep -q ", 0 of 40 steps in violation" "$folder/out" || fail "expected no violation"
# Its fields are those that `respond` compares with: the body follows itself exactly.
succeed respond "$folder/learned.h5" --weights "$folder/material.h5"
below 0.001 "displacement"
below 0.001 "dissipated energy"

# The shipped weights, on a body that they have not seen.
succeed respond "$folder/other.h5" --weights configs/weights/solid_beam/material.h5
below 0.5 "displacement"
below 0.5 "stress, free nodes"
below 1 "dissipated energy"

timeout 300 "$train" respond "$folder/other.h5" --weights configs/weights/beam/body.h5 >"$folder/out" 2>&1
[ $? -eq 6 ] && grep -qF "expected weights of a solid" "$folder/out" || fail "weights of another kind: expected code 6"
timeout 300 "$train" solid "$folder/small.h5" --branches 9 -o "$folder/none.h5" >"$folder/out" 2>&1
[ $? -eq 2 ] && grep -qF -e "--branches: expected a whole number from 0 to 4" "$folder/out" || fail "--branches 9: expected code 2"

finish
