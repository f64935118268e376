#!/bin/sh
# test_allocations.sh PORTMETD MAKE_SCENE SAME_RECORDING STEPS_ALLOCATE_NOTHING: nothing is allocated in
# the step loop over LCM.
. "$(dirname "$0")/network.sh"

"$4" "$folder" || fail "steps_allocate_nothing"
finish
