#!/bin/sh
# test_same_bits.sh PORTMETD MAKE_SCENE SAME_RECORDING ... READS_CLOCK: `portmetd test` finds the same bits for
# every integrator, for co-energies and for chains, whatever the cut and however processes and messages are lost; and it
# finds what is wrong: other weights at one end, a part that reads the clock, a law that is not kept. Runs side by side
# keep apart.
. "$(dirname "$0")/network.sh"

# good SCENE RUNS: `test` makes so many runs, and one over MPI where that is built, and all is well.
good() {
    "$portmetd" test "$1" >"$folder/test.out" 2>"$folder/test.err" || fail "$1: $(cat "$folder/test.out")"
    runs=$(($2 + $(grep -c 'over MPI .*the same bits' "$folder/test.out")))
    grep -q "^All $runs runs gave the same bits and kept both laws" "$folder/test.out" ||
        fail "$1: expected $runs runs: $(cat "$folder/test.out")"
}
for integrator in rk4 discrete_gradient rk4_balanced; do
    sed "s/integrator: [a-z0-9_]*/integrator: $integrator/" "$scene" >"$folder/scene_$integrator.yaml"
    good "$folder/scene_$integrator.yaml" 12
done
good "$(dirname "$0")/../support/coenergies.yaml" 14
sed 's/substeps: [0-9]*/tolerance: 1.0e-3/' "$scene" >"$folder/scene_adaptive.yaml"
good "$folder/scene_adaptive.yaml" 8
grep -q 'killed .*skipped: a scene with a tolerance keeps no checkpoints' "$folder/test.out" || fail "no word of what is skipped"

configs=$(cd "$(dirname "$0")/../../configs" && pwd)
# The scene's own processes, one of them with both ends of a chain.
sed -e "s,weights/,$configs/weights/,; s,reference/,$configs/reference/," -e '/^time:/i processes: {ends: [link1, link3]}' \
    -e '/^time:/i lockstep: {window: 16}' "$configs/chain_3.yaml" >"$folder/chain.yaml"
good "$folder/chain.yaml" 15
grep -q "the scene's own processes .*the same bits" "$folder/test.out" || fail "no word of the scene's own processes"
# A chain that is cut by METIS where the program has it, and one whose processes are no neighbours.
for processes in '{auto: 2}' '{auto: 8}' '{even: [link0, link2, link3, "link[20:40]"], odd: [link1, "link[4:20]"]}'; do
    printf 'scene: links\ntime: {dt: 1.0e-2, steps: 8, integrator: rk4}\nprocesses: %s\n' "$processes" >"$folder/links.yaml"
    links 40 >>"$folder/links.yaml"
    "$portmetd" check "$folder/links.yaml" 2>&1 | grep -q 'auto: this program was built without METIS' || good "$folder/links.yaml" 15
done
# Steps that do not converge are divided in the same round by all processes.
sed -e 's/^time: .*/time: {dt: 0.3, steps: 30, integrator: discrete_gradient, substeps: 1}/' -e 's/Tr: 300.0/Tr: 30000.0/' \
    -e "s|file: reference|file: $configs/reference|" "$configs/analytic_double_pendulum.yaml" >"$folder/hot.yaml"
good "$folder/hot.yaml" 12

# wrong CODE PATTERN ARGUMENT...: `test` ends with this code, and its error says why.
wrong() {
    code=$1
    pattern=$2
    shift 2
    "$portmetd" test "$@" >"$folder/test.out" 2>"$folder/test.err"
    found=$?
    [ $found -eq "$code" ] || fail "test $*: expected exit code $code, found $found"
    grep -q -e "$pattern" "$folder/test.err" || fail "test $*: expected \"$pattern\", found $(cat "$folder/test.err")"
}
mkdir "$folder/other"
cp "$folder"/*.h5 "$folder/other"
"$portmetd" test "$scene" --here --other "$folder/other" --json >"$folder/test.json" || fail "the same weights on another host"
python3 -c 'import json, sys; t = json.load(open(sys.argv[1])); assert t["failed"] == 0 and t["ports"][0]["used"] and len(t["runs"]) > 12' \
    "$folder/test.json" || fail "--json"
cp "$folder/idle.h5" "$folder/other/right.h5"
sed '/^time:/i processes: {here: [left], there: [right]}' "$scene" >"$folder/scene_hosts.yaml"
wrong 14 "1 of 1[0-9] runs failed, the first the last process with .*--other: .*node there holds another" \
    "$folder/scene_hosts.yaml" --other "$folder/other"
sed '/^time:/i laws: {energy: 1.0e-30}' "$scene" >"$folder/scene_strict.yaml"
# Steps that the clock chooses; a scene with a tolerance has fewer runs.
sed -e "s|file: reference|file: $configs/reference|; s/substeps: 16/tolerance: 1.0e-3/" \
    "$configs/analytic_double_pendulum.yaml" >"$folder/clock.yaml"
export LD_PRELOAD="$6"
wrong 14 "runs failed, the first a process each: \(subsystems\|ports\|.*substeps\).* at step [1-8]: " "$folder/clock.yaml" --steps 8
unset LD_PRELOAD
wrong 10 "energy residual" "$folder/scene_strict.yaml"
wrong 2 "live inputs need a recording" "$(dirname "$0")/../../configs/live_double_pendulum.yaml"
start interrupted test "$scene" --steps 300 --here
wait_until grep -q 'a process each' "$folder/interrupted.out" || fail "no test to interrupt"
kill -INT $pid
ends interrupted $pid 12 "interrupted"
no_orphans "interrupted" ""

# What differs is named: the earliest step, then the state.
"$portmetd" run "$scene" --in-process --quiet --record "$folder/plain.h5" || fail "in process"
"$portmetd" run "$scene" --in-process --quiet --weights "$folder/other" --record "$folder/idle.h5.run" || fail "idle"
"$same_recording" "$folder/plain.h5" "$folder/idle.h5.run" 2>"$folder/differs" && fail "other weights make no difference"
grep -q 'subsystems/right, z .* at step 1: ' "$folder/differs" || grep -q 'subsystems/right, .* at step 0: ' "$folder/differs" ||
    fail "expected the first difference: $(cat "$folder/differs")"

# Two runs of the same scene at once keep apart.
start one run "$scene" --quiet --record "$folder/one.h5"
one=$pid
start two run "$scene" --quiet --record "$folder/two.h5"
ends two $pid 0 ""
ends one $one 0 ""
"$same_recording" "$folder/plain.h5" "$folder/one.h5" || fail "one of two runs"
"$same_recording" "$folder/plain.h5" "$folder/two.h5" || fail "two of two runs"

no_orphans "at the end" ""
# bench --processes: what a step costs in one process over LCM; a small budget leaves the other cuts out.
"$portmetd" bench "$scene" --processes --budget 0.1 --write "${scene%.yaml}_cut.yaml" >"$folder/bench.out" ||
    fail "bench --processes"
grep -Eq '^ +1 +1 +[0-9.e-]+ +[0-9.e-]+ +process_0 waits for coordinator' "$folder/bench.out" || fail "bench --processes: no row"
grep -q '^Take 1 process and a window of 1: ' "$folder/bench.out" || fail "bench --processes: no advice"
grep -q '^processes: {process_0: \[left, ' "${scene%.yaml}_cut.yaml" || fail "bench --processes --write"
finish
