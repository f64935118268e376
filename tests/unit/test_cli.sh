#!/bin/sh
# test_cli.sh PORTMETD MAKE_SCENE: every command line ends with the exit code of its class of failure
# and, if it failed, exactly one line that says what is wrong. Runs that need a network are in
# tests/distributed.
. "$(dirname "$0")/../support/setting.sh"
portmetd=$1 program=$1
make_scene=$2

# expect_json CODE PART TEXT ARGUMENT...: the exit code, and TEXT in the only line, a JSON object about PART.
expect_json() {
    code=$1 part=$2 text=$3
    shift 3
    timeout 200 "$portmetd" "$@" >"$folder/out" 2>"$folder/err" </dev/null
    found=$?
    [ $found -eq "$code" ] || fail "portmetd $*: expected exit code $code, found $found"
    [ "$(wc -l <"$folder/err")" -eq 1 ] || fail "portmetd $*: expected one line of error"
    grep -q "^{\"time\":\"[0-9T:.-]*Z\",\"level\":\"error\",\"part\":\"$part\",.*\"fields\":{\"code\":$code}}\$" \
        "$folder/err" || fail "portmetd $*: expected an object with its time, level, part and code"
    grep -qF -e "$text" "$folder/err" || fail "portmetd $*: expected \"$text\", found: $(cat "$folder/err")"
}

# edit EXPRESSION: bad.yaml, the good scene changed by sed.
edit() {
    sed "$1" "$folder/scene.yaml" >"$folder/bad.yaml"
    ! cmp -s "$folder/scene.yaml" "$folder/bad.yaml" || fail "sed $1 changed nothing"
}

# spoil FILE: a folder of weights whose FILE may be damaged.
spoil() {
    rm -rf "$folder/spoilt"
    mkdir "$folder/spoilt"
    cp "$folder"/left.h5 "$folder"/right.h5 "$folder"/joint.h5 "$folder/spoilt/"
}

"$make_scene" "$folder" || { echo "FAILED: make_scene"; exit 1; }
scene=$folder/scene.yaml
bad=$folder/bad.yaml

# --- the command line: 2 ---
succeed "Commands:" --help
succeed "portmetd " --version
for command in run node coordinator check test bench stress; do
    succeed "Usage: portmetd $command SCENE" $command --help
    succeed "Options:" $command "$scene" --help
    expect 2 "$command: expected SCENE" $command
    expect 2 'unknown option "--wrong"' $command --wrong "$scene"
    expect 2 'unknown option "-x"' $command -x "$scene"
    expect 2 "--weights needs a value" $command "$scene" --weights
done
for command in serve start pause resume advance set reset stop query reload checkpoint restore; do
    succeed "Usage: portmetd $command SCENE" $command --help
    expect 2 "$command: expected SCENE" $command
    expect 2 'unknown option "--wrong"' $command --wrong "$scene"
done
expect 2 "--pace: expected a number of at least 0" start "$scene" --pace fast
expect 2 "--state: expected numbers with commas" start "$scene" --state 1,a
expect 2 "--state: expected 6 numbers" reset "$scene" --state 1,2
expect 2 "mpi://" serve "$scene" --url mpi://
expect 2 "expected a command"
expect 2 '"walk"' walk
expect 2 "found 2 arguments" run "$scene" "$scene"
expect 2 "found 1 argument " node "$scene"
expect 2 "there are: left, right" node "$scene" middle
for steps in 0 -3 1.5 many '' 99999999999999999999; do
    expect 2 "--steps" run "$scene" --steps "$steps"
done
expect 2 "--session" node "$scene" left --session 0
expect 2 'unknown option "--record"' check "$scene" --record x.h5

# --- the scene: 3, with file, line and column ---
edit 's/^time:/tome:/'
expect 3 "bad.yaml:2:1: " check "$bad"
edit 's/dt: 0.05/dt: soon/'
expect 3 "bad.yaml:2:12: dt: " check "$bad"
edit 's/between: \[left, right\]/between: [left, middle]/'
expect 3 'bad.yaml:19:21: between: there is no subsystem or boundary input "middle"' check "$bad"
edit 's/right: \[q, p, s\]/right: [q, p, x]/'
expect 3 "bad.yaml:20:42: " check "$bad"
edit 's/integrator: rk4/integrator: rk5/'
expect 3 'bad.yaml:2:41: integrator: expected one of euler, ' check "$bad"
expect 3 "bad.yaml:2:41: " run "$bad" --in-process
configs=$(realpath "$(dirname "$0")/../../configs")
sed -e 's/, dS: \[1\]//' -e "s,weights/,$configs/weights/," "$configs/driven_lower.yaml" >"$bad"
expect 3 'boundary input pivot: group "s" needs a "dS": port base' check "$bad"
edit '/^reference:/d'
expect 3 "bad.yaml:4:3: subsystem left: no state to start from: expected \`initial\`" run "$bad" --in-process
succeed "a run needs either" check "$bad"
sed '/^time:/i url: "udpm://239.255.76.67"' "$scene" >"$bad"
expect 3 "bad.yaml:2:6: url: expected udpm://" check "$bad"
sed '/^time:/i url: "foo://239.255.76.67:7667"' "$scene" >"$bad"
expect 3 "bad.yaml:2:6: url: transport" run "$bad" --in-process
edit '14s|unit: kg m/s|unit: kg;m|'
expect 3 "bad.yaml:14:17: unit: expected a unit without ';'" check "$bad"
expect 3 "a port" run "$scene" --url udpm://239.255.76.67
expect 3 "expected udpm://" node "$scene" left --url pigeon://here
edit 's/trajectory: 0/trajectory: 1/'
expect 3 "bad.yaml:22:45: trajectory 1" check "$bad"

# --- files: 4 ---
expect 4 "nowhere.yaml" check "$folder/nowhere.yaml"
edit 's/file: reference.h5/file: nowhere.h5/'
expect 4 "bad.yaml:22:19: $folder/nowhere.h5: " run "$bad" --in-process
edit 's/file: reference.h5/file: scene.yaml/'
expect 4 "bad.yaml:22:19: $folder/scene.yaml: " run "$bad" --in-process
expect 4 "/nowhere/run.h5" run "$scene" --in-process --record /nowhere/run.h5
expect 4 "/nowhere/run.h5" coordinator "$scene" --record /nowhere/run.h5
expect_json 4 run "/nowhere/run.h5" run "$scene" --in-process --record /nowhere/run.h5 --log=json
expect_json 4 left "nowhere.yaml" node "$folder/nowhere.yaml" left --log json
expect 2 '--log: expected text or json, found "xml"' run "$scene" --log=xml
expect 4 "not a file" run "$scene" --in-process --record "$folder"

# --- datasets: 5 ---
edit 's/file: reference.h5/file: nan.h5/'
expect 5 "bad.yaml:22:19: $folder/nan.h5: " run "$bad" --in-process --record "$folder/none.h5"
[ ! -e "$folder/none.h5" ] || fail "a recording was begun"
edit 's/columns: \[s2\]/columns: [entropy]/'
expect 5 'bad.yaml:15:32: subsystem right: column "entropy" is not in the dataset' check "$bad"
edit 's/dt: 0.05/dt: 0.03/'
expect 5 "bad.yaml:22:19: $folder/reference.h5: dt 0.05 s: expected a whole multiple" check "$bad"

# --- weights: 6, with the place in the scene also when they come from elsewhere ---
edit 's|weights: joint.h5|weights: nowhere/joint.h5|'
expect 6 "bad.yaml:21:14: port joint: weights $folder/nowhere/joint.h5: " check "$bad"
expect 6 "scene.yaml:5:14: subsystem left: weights $folder/nowhere/left.h5: " run "$scene" --weights "$folder/nowhere"
spoil
head -c 1000 "$folder/left.h5" >"$folder/spoilt/left.h5"
expect 6 "scene.yaml:5:14: subsystem left: weights $folder/spoilt/left.h5: " check "$scene" --weights "$folder/spoilt"
spoil
cp "$folder/joint.h5" "$folder/spoilt/right.h5"
expect 6 "scene.yaml:11:14: subsystem right: $folder/spoilt/right.h5: " node "$scene" right --weights "$folder/spoilt"
spoil
cp "$folder/reference.h5" "$folder/spoilt/joint.h5"
expect 6 "scene.yaml:21:14: port joint: $folder/spoilt/joint.h5: " run "$scene" --weights "$folder/spoilt"
edit 's/expose: {left: \[p, s\]/expose: {left: [s]/'
expect 6 "bad.yaml:20:20: port joint, end left: the weights $folder/joint.h5 " check "$bad"
edit 's/unit: kg m.s, columns: \[p2\]/unit: g m\/s, columns: [p2]/'
expect 6 "bad.yaml:14:7: subsystem right: the weights $folder/right.h5 " check "$bad"

# --- what works ---
succeed "port joint (bracket, hard)" check "$scene"
succeed "left: irreversible bulk: none" check "$scene"
succeed "pair_FLUX_left" check "$scene"
grep -q "does nothing" "$folder/out" && fail "every operator does something"
spoil
cp "$folder/idle.h5" "$folder/spoilt/right.h5"
for line in "right: reversible bulk: does nothing: it acts on 2 components" \
    "right: irreversible bulk: does nothing: it acts on 1 component,"; do
    succeed "$line" check "$scene" --weights "$folder/spoilt"
done
# A scene of many is summed up, and its recording keeps what it is asked for.
cat > "$folder/many.yaml" <<END
scene: many
time: {dt: 0.01, steps: 20, integrator: euler}
models:
  mass:
    constants: {m: 2.0, k: 3.0}
    energy: "|p|^2/(2*m) + k/2*|q|^2"
    reversible: {given: [[q, p, 1.0]]}
subsystems:
  "mass[0:1000]":
    model: mass
    state: {q: {unit: m, size: 1}, p: {unit: kg m/s, size: 1}}
    initial: {q: 1, p: 0}
record: {parts: ["mass[998:1000]"], every: 5}
END
succeed "and 999 more subsystems with the same model" check "$folder/many.yaml"
[ "$("$portmetd" check "$folder/many.yaml" | wc -l)" -lt 400 ] || fail "a check of many is long"
succeed "and 936 more subsystems" run "$folder/many.yaml" --in-process --record "$folder/many.h5"
if command -v h5ls > /dev/null; then
    h5ls -r "$folder/many.h5" | grep -q '^/subsystems/mass999/z *Dataset {5/Inf' ||
        fail "every fifth state is not recorded"
    [ "$(h5ls "$folder/many.h5/subsystems" | wc -l)" -eq 2 ] || fail "other parts are recorded"
fi
succeed "  q                       0 %" run "$scene" --in-process --record "$folder/run.h5"
[ -s "$folder/run.h5" ] || fail "no recording"
succeed "of 1 copy, 0 of which" run "$scene" --starts "$folder/reference.h5" --steps 4 --record "$folder/copies.h5"
succeed "left.q[0]" run "$scene" --copies 1 --starts "$folder/copies.h5" --steps 2
succeed "of 70 copies, 0 of which" run "$scene" --copies 70 --steps 2
expect 5 "trajectories, and 9 copies" run "$scene" --copies 9 --starts "$folder/reference.h5"
expect 4 "copies.h5" run "$scene" --copies 2 --record "$folder/copies.h5"
expect 2 "--copies" run "$scene" --copies 2 --held
expect 2 "--held for clients" run "$scene" --in-process --held
expect 2 "--copies" run "$scene" --copies 0
export XDG_CACHE_HOME="$folder/cache"
succeed "  q                       0 %" run "$scene" --in-process --compiled
CC=/nowhere/cc expect 4 "the C compiler /nowhere/cc" run "$scene" --in-process --compiled
succeed "  q                       0 %" run "$scene" --in-process --record "$folder/run.h5" # an earlier recording is replaced

# An integrator that iterates, where springs are a hundred times too hot for its step: a step that does not converge is
# divided, and no step is wrong. Where springs are hotter still, the run ends with the step before, and says why.
configs=$(cd "$(dirname "$0")/../../configs" && pwd)
sed -e 's/^time: .*/time: {dt: 0.3, steps: 60, integrator: discrete_gradient, substeps: 1}/' -e 's/Tr: 300.0/Tr: 30000.0/' \
    -e "s|file: reference|file: $configs/reference|" "$configs/analytic_double_pendulum.yaml" >"$folder/hot.yaml"
succeed "steps in violation: 0;" run "$folder/hot.yaml" --in-process
sed -i 's/Tr: 30000.0/Tr: 3000000.0/' "$folder/hot.yaml"
expect 9 "step 2: the iteration does not converge in pieces of 0.00469 s" run "$folder/hot.yaml" --in-process
grep -q "steps in violation: 0;" "$folder/out" || fail "hot.yaml: the step before is right"
# Fast conduction on a grid: an iteration that diverges slowly is not taken for one that has converged.
cat >"$folder/grid.yaml" <<'END'
scene: grid
time: {dt: 0.5, steps: 10, integrator: discrete_gradient}
models:
  cell: {constants: {c: 1.0}, energy: "300*c*(exp(s/c) - 1)", entropy: s}
  heat: {law: bracket, constants: {K: 10.0}, irreversible: {given: [[a.s, b.s, "K*b.dE.s/a.dE.s"]]}}
subsystems:
  hot: {model: cell, state: {s: {unit: J/K, size: 1}}, initial: {s: 0.2}}
  "cell[0:4][0:4]": {model: cell, state: {s: {unit: J/K, size: 1}}, initial: {s: 0.0}}
ports:
  at: {law: bracket, between: [hot, cell0_0], expose: {hot: s, cell0_0: s}, model: heat}
  "right[0:4][0:3]":
    {law: bracket, between: ["cell[i][j]", "cell[i][j+1]"], expose: {"cell[i][j]": s, "cell[i][j+1]": s}, model: heat}
  "down[0:3][0:4]":
    {law: bracket, between: ["cell[i][j]", "cell[i+1][j]"], expose: {"cell[i][j]": s, "cell[i+1][j]": s}, model: heat}
END
succeed "steps in violation: 0;" run "$folder/grid.yaml" --in-process
# Stiff gaps, and long steps: an iterate that hardly changes has not converged while it leaves energy open.
for change in 's/k: 4.0e+4/k: 3.0e+7/; s/dt: 0.001/dt: 0.005/' 's/dt: 0.001/dt: 0.02/; s/substeps: 8/substeps: 1/'; do
    sed "$change; s/steps: 1000/steps: 400/" "$configs/bouncing_masses.yaml" >"$folder/bouncing.yaml"
    succeed "steps in violation: 0;" run "$folder/bouncing.yaml" --in-process
done

# A recording takes the place of no other file, and never of one that the run reads.
echo "a letter" >"$folder/letter"
expect 4 "$folder/letter: this file exists and is of another kind" run "$scene" --in-process --record "$folder/letter"
grep -q "a letter" "$folder/letter" || fail "the letter was overwritten"
succeed "  q                       0 %" run "$scene" --in-process --record "$folder/letter" --overwrite
grep -q "a letter" "$folder/letter" && fail "the letter was not overwritten"
ln -s "$scene" "$folder/link"
for input in "$scene" "$folder/link" $(sed -n "s|.*\(weights\|reference\): *\([^ ,}]*\).*|$folder/\2|p" "$scene" | sort -u); do
    before=$(cksum <"$input")
    expect 2 "the program reads this file" run "$scene" --in-process --record "$input" --overwrite
    [ "$before" = "$(cksum <"$input")" ] || fail "$input was overwritten"
done
succeed "pair: 7 steps of 0.05 s" run "$scene" --in-process --steps 7 --weights "$folder"
"$portmetd" run "$scene" --in-process --quiet >"$folder/out" 2>"$folder/err" || fail "--quiet"
[ ! -s "$folder/out" ] || fail "--quiet: expected no output"

finish
