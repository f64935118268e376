#!/bin/sh
# test_same_bits.sh PORTMETD MAKE_SCENE SAME_RECORDING: a run in separate processes over LCM records the
# same bits as one in a single process; launched by `run` or by hand, and whatever the window.
. "$(dirname "$0")/network.sh"

"$portmetd" run "$scene" --in-process --quiet --record "$folder/plain.h5" || fail "in process"

for window in 1 4; do
    sed "/^time:/i lockstep: {window: $window}" "$scene" >"$folder/scene_$window.yaml"
    record=$folder/window_$window.h5
    start run run "$folder/scene_$window.yaml" --quiet --record "$record"
    ends run $pid 0 ""
    "$same_recording" "$folder/plain.h5" "$record" || fail "window $window"
done

# Both subsystems in one process, which talk without sockets.
sed "/^time:/i processes: {both: [left, right]}" "$scene" >"$folder/scene_both.yaml"
start run run "$folder/scene_both.yaml" --quiet --record "$folder/both.h5"
ends run $pid 0 ""
"$same_recording" "$folder/plain.h5" "$folder/both.h5" || fail "one process"

# An integrator that iterates the new state (fluxes carry responses too), and one that balances it.
for integrator in discrete_gradient rk4_balanced; do
    sed "s/integrator: [a-z0-9_]*/integrator: $integrator/" "$scene" >"$folder/scene_$integrator.yaml"
    "$portmetd" run "$folder/scene_$integrator.yaml" --in-process --quiet \
        --record "$folder/$integrator.h5" || fail "$integrator in process"
    "$same_recording" "$folder/plain.h5" "$folder/$integrator.h5" 2>/dev/null &&
        fail "$integrator makes no difference"
    start run run "$folder/scene_$integrator.yaml" --quiet --record "$folder/${integrator}_lcm.h5"
    ends run $pid 0 ""
    "$same_recording" "$folder/$integrator.h5" "$folder/${integrator}_lcm.h5" || fail "$integrator"
done

# States that hold co-energies.
shown=$(dirname "$0")/../support/coenergies.yaml
"$portmetd" run "$shown" --in-process --quiet --record "$folder/shown.h5" || fail "co-energies in process"
start run run "$shown" --quiet --record "$folder/shown_lcm.h5"
ends run $pid 0 ""
"$same_recording" "$folder/shown.h5" "$folder/shown_lcm.h5" || fail "co-energies"

# Two runs of the same scene at once keep apart.
start one run "$scene" --quiet --record "$folder/one.h5"
one=$pid
start two run "$scene" --quiet --record "$folder/two.h5"
ends two $pid 0 ""
ends one $one 0 ""
"$same_recording" "$folder/plain.h5" "$folder/one.h5" || fail "one of two runs"
"$same_recording" "$folder/plain.h5" "$folder/two.h5" || fail "two of two runs"

# By hand, the coordinator last.
start left node "$scene" left
left=$pid
start right node "$scene" right
right=$pid
await_nodes $left $right
start coordinator coordinator "$scene" --quiet --record "$folder/hand.h5"
ends coordinator $pid 0 ""
ends left $left 0 ""
ends right $right 0 ""
"$same_recording" "$folder/plain.h5" "$folder/hand.h5" || fail "by hand"

no_orphans "at the end" ""
finish
