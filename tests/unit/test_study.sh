#!/bin/sh
# test_study.sh PORTMETD MAKE_SCENE CONFIGS [short]: `bench` finds the orders of the integrators and writes a scene with its
# advice; `stress` finds a step that is too long for fast conduction, and the scene that it writes repeats it. `short`, for
# slow builds: without the orders, and without what takes the same code once more.
. "$(dirname "$0")/../support/setting.sh"
portmetd=$1 program=$1
configs=$(realpath "$3")
"$2" "$folder" || fail "make_scene"
scene=$folder/scene.yaml

# bench: the error falls like h^order, the advice keeps the error asked for, and the seed decides alone.
known=$folder/known.yaml
sed -e "s,reference/,$configs/reference/," "$configs/analytic_double_pendulum.yaml" >"$known"
[ -n "${4:-}" ] || for seed in 1 1 2; do
    "$portmetd" bench "$known" --steps 3 --budget 300 --seed $seed --json >"$folder/bench_$seed.json.new" || fail "bench --json"
    [ ! -f "$folder/bench_$seed.json" ] || mv "$folder/bench_$seed.json" "$folder/bench_before.json"
    mv "$folder/bench_$seed.json.new" "$folder/bench_$seed.json"
done
[ -n "${4:-}" ] || python3 - "$folder" <<'END' || fail "bench: orders"
import json, sys
first, before, other = (json.load(open(f"{sys.argv[1]}/bench_{name}.json")) for name in ("1", "before", "2"))
errors = lambda bench: {(s["integrator"], s["substeps"], s["tolerance"]): s["error"] for s in bench["settings"]}
assert errors(first) == errors(before), "the same seed, other numbers"
assert len(errors(first)) > 60 and first["agreement"] < 1e-11, (len(errors(first)), first["agreement"])
for name, order, coarse in ("euler", 1, 64), ("heun", 2, 32), ("rk4", 4, 8):
    e = errors(first)
    ratio = e[name, coarse, 0] / e[name, 2 * coarse, 0]
    assert 0.6 < ratio / 2**order < 1.6, (name, ratio)
advice = first["advice"]
assert advice["error"] <= 1e-4 and advice["times_faster"] >= 1, advice
assert errors(other) != errors(first) or first["starts"] < 3
END
succeed "For 1e-06 % take " bench "$scene" --steps 2 --budget 300 --error 1e-6 --write "$folder/advised.yaml"
grep -q ' % over 0\.1 s\.$' "$folder/out" || fail "bench: how long the runs are"
succeed "scene pair" check "$folder/advised.yaml"
grep -q '^time: {dt: 0.05, steps: 2, integrator: ' "$folder/advised.yaml" || fail "bench --write: $(grep -A1 time: "$folder/advised.yaml")"
mkdir "$folder/away"
if [ -z "${4:-}" ]; then
    expect 6 "a scene in another folder" bench "$scene" --steps 2 --budget 300 --write "$folder/away/advised.yaml"
    [ ! -s "$folder/out" ] || fail "bench: measures before it knows that it can write: $(cat "$folder/out")"
fi
expect 14 "no setting reaches 1e-30 %" bench "$scene" --steps 2 --budget 300 --error 1e-30
expect 2 "--error: expected" bench "$scene" --error none
expect 2 "--seed" bench "$scene" --seed 0
expect 2 '--budget: expected a number > 0, found "2m"' stress "$known" --budget 2m

# stress: conduction of 300 W/K is too fast for 4 substeps of rk4; from a start within the range.
picture=
command -v gnuplot >/dev/null && picture="--picture $folder/map" # without a word about places that it lacks
succeed "The scene's own settings held" stress "$known" --steps 20 --budget 300 $picture
[ -z "$picture" ] || [ -s "$folder/map.svg" ] || fail "stress --picture"
grep -Eq '^dt doubled until it breaks +[1-9]' "$folder/out" || fail "stress: longer and longer steps"
grep -Eq '^analytic_double_pendulum, 20 steps +rollouts ' "$folder/out" || fail "stress: how many steps a rollout has"
grep -q '^    20000 steps$' "$folder/out" || fail "stress: how many steps"
# The inputs of this scene are in a table: what goes beyond it takes their means, and a scene that is written keeps the table.
driven=$folder/driven.yaml
sed -e "s, reference/, $configs/reference/," -e "s, weights/, $configs/weights/," "$configs/driven_lower.yaml" >"$driven"
succeed "The inputs lie in a table of 100 steps: " stress "$driven" --steps 20 --budget 300
for kind in "dt times 32  " "dt doubled until it breaks" "many steps from the scene's start"; do
    grep -Eq "^$kind +[1-9]" "$folder/out" || fail "stress with a table: $kind"
done
grep -q '^    20000 steps$' "$folder/out" || fail "stress with a table: how many steps"
succeed "Take 1 process and a window of 1: " bench "$driven" --processes --budget 0.1 --write "$folder/cut.yaml"
grep -q "^lockstep: {window: 1, " "$folder/cut.yaml" || fail "bench --processes --write"
grep -q 'p: {unit: kg m/s, dE: \[vx, vy\]' "$folder/cut.yaml" || fail "bench --processes --write: the table of the inputs"
succeed " steps of 1000000: all of them need a --budget of " stress "$known" --steps 1000 --budget 2s
grep -Eq '^a subsystem set to another state +2 +2 ' "$folder/out" || fail "stress: states that are set"
# Inputs of a temperature alone stay as they are, and no rollout claims to change them.
cat >"$folder/cup.yaml" <<'END'
scene: cup
time: {dt: 0.1, steps: 50, integrator: rk4, substeps: 2}
models:
  body: {constants: {c: 5.0, Tr: 300.0}, energy: "c*Tr*exp(s/c)", entropy: s}
  wall: {law: bracket, constants: {K: 0.5}, irreversible: {given: [[a.s, b.s, "K*b.dE.s/a.dE.s"]]}}
boundary_inputs: {room: {s: {unit: J/K, dE: 293, dS: 1}}}
subsystems: {cup: {model: body, state: {s: {unit: J/K, size: 1}}, initial: {s: 0.5}}}
ports: {wall: {law: bracket, between: [cup, room], expose: {cup: s, room: s}, model: wall}}
END
succeed "many steps" stress "$folder/cup.yaml" --steps 20 --budget 300
! grep -q inputs "$folder/out" || fail "stress: inputs that stay as they are"
mkdir "$folder/bin" && cp "$portmetd" "$folder/bin" && program=$folder/bin/portmetd # away from what draws
expect 4 "pictures: the Python package of portmet is not where it was" stress "$known" --steps 2 --budget 300 --picture "$folder/none"
grep -q "^The scene's own settings held" "$folder/out" || fail "stress: no picture, and no result either"
program=$portmetd
[ -n "${4:-}" ] || succeed "The scene's own settings held" stress "$configs/bouncing_masses.yaml" --steps 20 --budget 300 # moves nothing but by rounding
sed -e 's/{K: 0.5}/{K: 300}/' -e 's/substeps: [0-9]*/substeps: 4/' -e '/^reference:/d' "$known" >"$folder/fast.yaml"
sed -n 's/^reference: //p' "$known" | grep -q . || fail "expected a scene with a reference"
echo "start: [1, 0.1, 0, 0, 0.02, 1, 0.2, 0, 0, 0.1]" >>"$folder/fast.yaml"
expect 14 "stress: starts within the training range: " stress "$folder/fast.yaml" --steps 20 --budget 300 \
    --write "$folder/broken.yaml"
grep -Eq "in step [1-9]|in [0-9]+ steps" "$folder/out" || fail "stress: when it broke"
"$portmetd" run "$folder/broken.yaml" --in-process >"$folder/out" 2>"$folder/err"
grep -Eq "became -?nan|the total energy has drifted" "$folder/out" "$folder/err" || fail "the scene that broke does not break again"
"$portmetd" stress "$folder/fast.yaml" --steps 20 --budget 300 --json >"$folder/stress.json" 2>/dev/null
python3 -c 'import json, sys; t = json.load(open(sys.argv[1])); assert not t["held"] and len(t["rollouts"]) > 5' \
    "$folder/stress.json" || fail "stress --json"
sed 's/substeps: 16/&, tolerance: 1.0e-7/' "$known" >"$folder/slow.yaml"
succeed "rollouts are left out: they need a larger --budget" stress "$folder/slow.yaml" --steps 200 --budget 0.1
sed 's/^start: .*/start: [1, 2]/' "$folder/fast.yaml" >"$folder/short.yaml"
expect 3 "start: expected 10 numbers, found 2" check "$folder/short.yaml"

# check says on which range each end was trained, and which parts were learned together.
"$portmetd" check "$configs/double_pendulum.yaml" >"$folder/out" || fail "check"
[ "$(grep -c 'was learned together with this port$' "$folder/out")" -eq 2 ] || fail "check: who was learned together"
grep -Eq '^  end b      lower exposes q \(trained on 0\.[0-9]* to [0-9.]* m\) p \(' "$folder/out" || fail "check: ranges of an end"
"$portmetd" check "$configs/driven_double_pendulum.yaml" >"$folder/out" || fail "check"
grep -q 'upper was learned without this port, by another fit$' "$folder/out" || fail "check: who was learned apart"
grep -q '^  ranges     upper.s was trained on -0.202 to 0.102 J/K, and lower.s reaches -0.212 to 0.148$' "$folder/out" ||
    fail "check: ranges that one end reaches and the other does not know"
finish
