#!/bin/sh
# test_crowd.sh PORTMETD MAKE_SCENE SAME_RECORDING [PROCESSES [STEPS]]: a chain of small subsystems, each in a process of
# its own, starts with the default patience and records the bits that it has in one process. Prints how long it took.
. "$(dirname "$0")/network.sh"
count=${4:-48}
steps=${5:-40}
cat >"$folder/scene_crowd.yaml" <<END
scene: crowd
time: {dt: 1.0e-3, steps: $steps, integrator: euler}
models:
  part: {energy: "x^2/2"}
  joint: {law: bracket, reversible: {given: [[a.x, b.x, 1.0]]}}
subsystems:
  p0: {model: part, state: {x: {unit: m, size: 1}}, initial: {x: 1.0}}
  "p[1:$count]": {model: part, state: {x: {unit: m, size: 1}}, initial: {x: 0.25}}
ports:
  "j[0:$((count - 1))]": {law: bracket, between: ["p[i]", "p[i+1]"], expose: {"p[i]": x, "p[i+1]": x}, model: joint}
END
"$portmetd" run "$folder/scene_crowd.yaml" --in-process --quiet --record "$folder/plain.h5" || fail "in one process"

now() { cut -d ' ' -f 1 /proc/uptime; }
took() { awk -v from="$1" -v to="$(now)" 'BEGIN { printf "%.1f s", to - from }'; }

began=$(now)
start crowd run "$folder/scene_crowd.yaml" --record "$folder/crowd.h5" --held
goes_on "$folder/scene_crowd.yaml" 1
wait_until says crowd "held after step 1\$" || fail "the crowd never made a step"
[ "$(children $pid | wc -w)" -ge "$count" ] || fail "expected $count processes"
first=$(took "$began")
began=$(now)
goes_on "$folder/scene_crowd.yaml"
ends crowd $pid 0 ""
"$same_recording" "$folder/plain.h5" "$folder/crowd.h5" || fail "other bits than in one process"
echo "$count processes: start and first step $first, the other steps of $steps and the end $(took "$began"); CPU time:"
times >"$folder/times"
tail -n 1 "$folder/times"
no_orphans "at the end"
finish
