#!/bin/sh
# test_train_cli.sh PORTMET_TRAIN MAKE_SCENE: the trainer's command lines end with the exit code of
# their class of failure and one line that says what is wrong, and leave nothing half-written.
. "$(dirname "$0")/../support/setting.sh"
train=$1 program=$1
make_scene=$2

"$make_scene" "$folder" || { echo "FAILED: make_scene"; exit 1; }
scene=$folder/scene.yaml
data=$folder/reference.h5
slow=configs/truth/double_pendulum.yaml
new=$folder/new.h5

# --- the command line: 2 ---
succeed "Commands:" --help
succeed "portmet-train " --version
expect 2 "lists them"
expect 2 '"walk"' walk
for command in truth evaluate fit nodes reduce contact reconstruct picture; do
    succeed "Usage: portmet-train $command" $command --help
    expect 2 "is missing" $command
    expect 2 '"--wrong"' $command x --wrong
    [ $command = picture ] || expect 2 '"y"' $command x y
done
expect 2 "needs a value" truth $slow -o
expect 2 "--output FILE is missing" truth $slow
expect 2 "--data FILE... is missing" evaluate "$scene"
expect 2 "takes no value" evaluate "$scene" --json=yes
for range in 50 99999999999999999999 3:3 4:2 -1:2 1:51 x 1:x ''; do
    expect 2 "expected A:B" truth $slow -o "$new" --trajectories "$range"
done

# --- truth ---
expect 4 "nowhere.yaml" truth nowhere.yaml -o "$new"
expect 4 "/nowhere/new.h5" truth $slow -o /nowhere/new.h5 --trajectories 1
sed 's/dt: 0.3/dt: soon/' $slow >"$folder/bad.yaml"
expect 3 "bad.yaml:7:5: " truth "$folder/bad.yaml" -o "$new"
[ ! -e "$new" ] || fail "a failed command left a file"
beam=$folder/beam.yaml
# with_beam SED-SCRIPT: the beam of the configurations, small and changed by the script.
with_beam() {
    sed -e 's/elements: .*/elements: [4, 1, 1]/; s/states: .*/states: 5/' -e "$1" configs/truth/beam.yaml >"$beam"
}
with_beam ''
succeed "stored and dissipated differ from the work by" truth "$beam" -o "$folder/beam.h5" --trajectories 0:2
grep -q ">beam.h5:/hexahedra<" "$folder/beam.xdmf" || fail "no XDMF beside the field"
with_beam 's/0.49\]/0.7]/'
expect 3 "with a sum below 1" truth "$beam" -o "$new"
with_beam 's/4, 1, 1/4, 1.5, 1/'
expect 3 "elements along x, y, z" truth "$beam" -o "$new"
with_beam 's/substeps: 2/contact: 1.0/; s/4, 1, 1\]/4, 1, 1]\n  substeps: 2/'
expect 3 'contact: expected `beams` beside it' truth "$beam" -o "$new"
with_beam 's/hold: .*/hold: [0.8, 0.2]/'
expect 3 "hold: expected [lowest, highest]" truth "$beam" -o "$new"
with_beam 's/  patches:/  rows: {force: 1.0, positions: 2, ramp: 1.0}/; /Drawn/,/tilt/!{/:.*\[0\./{/material/!d}}; /force: \[/d; /length/d; /width/d; /tilt: /d'
expect 3 "trajectory 8 of 8" truth "$beam" -o "$new" --trajectories 8
# with_beams SED-SCRIPT: likewise for the crossed beams.
with_beams() {
    sed -e 's/elements: .*/elements: [4, 1, 1]/; s/states: .*/states: 8/' -e "$1" configs/truth/crossed_beams.yaml >"$beam"
}
with_beams ''
succeed "contact           lower: in " truth "$beam" -o "$folder/beams.h5" --trajectories 0:2
[ -e "$folder/beams_lower.h5" ] && [ -e "$folder/beams_upper.h5" ] || fail "a file of a beam is missing"
# faces FILE: quadrangles in a script of a picture, whose corners have four numbers each.
faces() {
    echo $(($(grep -Ec '^(-?[0-9.e+-]+ ){3}[0-9.e+-]+$' "$1") / 4))
}
lower=$folder/beams_lower.h5
upper=$folder/beams_upper.h5
if command -v gnuplot >/dev/null; then
    succeed "wrote" picture "$lower" "$upper" --time 0.2 -o "$folder/both.png"
    [ -s "$folder/both.png" ] || fail "no picture"
    [ "$(faces "$folder/both.gp")" -eq 36 ] || fail "two beams of 4 bricks show $(faces "$folder/both.gp") faces"
    grep -q '^36 .* 11 ' "$folder/both.gp" || fail "the upper beam does not begin at its origin"
    ! grep -q multiplot "$folder/both.gp" || fail "beams that are placed are in panels"
    succeed "wrote" picture "$folder/beam.h5" "$upper" -o "$folder/apart.png"
    grep -q "multiplot layout 2,1" "$folder/apart.gp" || fail "beams that are not placed are in one scene"
    succeed "wrote" picture "$lower" "$upper" --beside "$lower,$upper" --trajectory 0,1 --time 0.2 --error -o "$folder/beside.png"
    [ "$(grep -c '^splot' "$folder/beside.gp")" -eq 3 ] || fail "expected three panels"
    [ "$(faces "$folder/beside.gp")" -eq $((3 * 36)) ] || fail "expected both beams in each panel"
    grep -q "trajectory 0, 0.2 s" "$folder/beside.gp" && grep -q "trajectory 1, 0.2 s" "$folder/beside.gp" ||
        fail "expected a trajectory for each scene"
    # An error is zero against itself.
    succeed "wrote" picture "$lower" --beside "$lower" --time 0.2 --error -o "$folder/same.png"
    [ "$(faces "$folder/same.gp")" -eq $((3 * 18)) ] || fail "expected three panels of one beam"
    [ "$(tail -n 120 "$folder/same.gp" | grep -Ec '^(-?[0-9.e+-]+ ){3}0$')" -ge 64 ] || fail "expected no error"
fi
expect 5 "there is no trajectory 2, only 2" picture "$lower" --trajectory 2 -o "$folder/new.png"
expect 2 '--time "soon": expected a number' picture "$lower" --time soon -o "$folder/new.png"
expect 2 'expected a whole number' picture "$lower" --trajectory 0,1 -o "$folder/new.png"
expect 2 'or two joined by a comma' picture "$lower" --beside "$upper" --trajectory 0,1,2 -o "$folder/new.png"
expect 2 'or --beside with a field of each body' picture "$lower" "$upper" --beside "$upper" --error -o "$folder/new.png"
expect 2 'expected a whole number' picture "$lower" --trajectory 0.5 -o "$folder/new.png"
expect 5 "/z" picture configs/reference/double_pendulum.h5 -o "$folder/new.png"
expect 2 "script of the picture has this name" picture "$lower" -o "$folder/new.gp"
expect 4 "there is no folder /nowhere" picture "$lower" -o /nowhere/new.png
with_beams 's/+y, -x, +z/+y, +x, +z/'
expect 3 "right-handed" truth "$beam" -o "$new"
with_beams 's/-26, 11/-26, 9/'
expect 3 "lower and upper overlap" truth "$beam" -o "$new"
with_beams 's/loaded: upper/loaded: middle/'
expect 3 "loaded: expected one of" truth "$beam" -o "$new"
with_beams 's/face: +z/face: +x/'
expect 3 "face: expected one of" truth "$beam" -o "$new"
succeed "2 of 2 trajectories to 1e-10" truth $slow --trajectories=45:47 --output "$new"

# --- correct ---
rows=$folder/rows.yaml
# with_rows SED-SCRIPT: rows of an elastic beam, small and changed by the script.
with_rows() {
    sed -e 's/elements: .*/elements: [4, 1, 1]/; s/states: .*/states: 3/; s/positions: 13/positions: 3/; s/trajectories: 52/trajectories: 12/' \
        -e "$1" configs/truth/beam_elastic.yaml >"$rows"
}
with_rows ''
succeed "wrote" truth "$rows" -o "$folder/own.h5" --trajectories 0:3
with_rows 's/C10: 1.5e5/C10: 1.6e5/'
succeed "wrote" truth "$rows" -o "$folder/known.h5" --trajectories 0:6
succeed "3 trajectories of 3 states, 20 nodes" correct "$folder/own.h5" --by "$folder/known.h5" --trajectories 0,2 -o "$folder/corrected.h5"
expect 5 "no load like that of trajectory 3 of the known fields" correct "$folder/own.h5" --by "$folder/known.h5" -o "$new"
expect 5 "in a row with that of trajectory 3 of the simulation" correct "$folder/known.h5" --by "$folder/own.h5" -o "$new"
expect 5 "the simulation has 20 nodes at 5 times" correct "$folder/beam.h5" --by "$folder/own.h5" -o "$new"
expect 2 "expected A:B" correct "$folder/own.h5" --by "$folder/known.h5" --trajectories 0:7 -o "$new"
expect 2 "by" correct "$folder/own.h5" -o "$new"
expect 4 "/nowhere/new.h5" correct "$folder/own.h5" --by "$folder/known.h5" --trajectories 0 -o /nowhere/new.h5

# --- reduce, reconstruct ---
modes=$folder/modes.yaml
# with_modes SED-SCRIPT: the modes of the configurations, few and changed by the script.
with_modes() {
    sed -e '/^trajectories/d; s/^modes: .*/modes: 6/; s/^state: .*/state: 3/; s/^leading: .*/leading: 2/' -e "$1" \
        configs/modes/beam.yaml >"$modes"
}
with_modes ''
succeed "modes.h5: 16 trajectories of 5 states" reduce "$modes" --data "$folder/beam.h5" -o "$folder/modes"
basis=$folder/modes/basis.h5
succeed "modes.h5: 1 trajectory of 5 states" reduce "$modes" --data "$folder/beam.h5" --basis "$basis" --trajectories 1 -o "$folder/one"
succeed "stress  " reconstruct "$folder/one/modes.h5" --basis "$basis" --truth "$folder/beam.h5" --trajectories 1 -o "$new"
succeed "displacement                 0         0         0" reconstruct "$folder/one/modes.h5" --basis "$basis" --truth "$new"
succeed "Trained on, %" reconstruct "$folder/one/modes.h5" --basis "$basis" --truth "$folder/beam.h5" --trajectories 1 --trained 1
expect 2 "trajectories: 1 in $folder/one/modes.h5, 2 of the truth" reconstruct "$folder/one/modes.h5" --basis "$basis" --truth "$folder/beam.h5"
expect 2 "0 is named twice" reduce "$modes" --data "$folder/beam.h5" --trajectories 0,0: -o "$folder/one"
expect 2 "expected A:B" reduce "$modes" --data "$folder/beam.h5" --trajectories 0,,1 -o "$folder/one"
succeed "modes.h5: 1 trajectory" reduce "$modes" --data "$folder/beam.h5" --basis "$basis" --trajectories 1 -o "$folder/new/deep"
expect 4 "$new: cannot make or write this folder" reduce "$modes" --data "$folder/beam.h5" -o "$new" # a file
expect 5 "no column \"a0\"" reconstruct "$data" --basis "$basis"
expect 5 "modes.h5" reconstruct "$folder/one/modes.h5" --basis "$folder/one/modes.h5"

# --- nodes ---
nodes=$folder/nodes.h5
mesh=$folder/mesh.h5
succeed "20 nodes, 4 bricks" nodes "$folder/beam.h5" --mesh "$mesh" -o "$nodes"
grep -q "nodes.h5: 2 trajectories of 5 states, 241 columns" "$folder/out" || fail "nodes: what it wrote"
succeed "1 trajectory of 5 states, 241 columns" nodes "$folder/beam.h5" --mesh "$mesh" --trajectories 1 -o "$folder/one/nodes.h5"
expect 2 "mesh" nodes "$folder/beam.h5" -o "$nodes"
for states in 6 1.5 0 3x; do
    expect 2 "--states: expected a" nodes "$folder/beam.h5" --mesh "$mesh" --states "$states" -o "$nodes"
done
succeed "2 trajectories of 3 states, 241 columns" nodes "$folder/beam.h5" --mesh "$mesh" --states 3 -o "$folder/one/nodes.h5"
for temperature in 0 1,2; do
    expect 2 "--temperature: expected a number > 0, found \"$temperature\"" \
        nodes "$folder/beam.h5" --mesh "$mesh" --temperature "$temperature" -o "$nodes"
done
expect 5 "one/nodes.h5: trajectories of 3 states, those of $folder/beam.h5 have 5: only whole trajectories" \
    reconstruct "$folder/one/nodes.h5" --truth "$folder/beam.h5"
succeed "stress  " reconstruct "$nodes" --truth "$folder/beam.h5" -o "$folder/again.h5"
grep -qa "Fields reconstructed from nodal values" "$folder/again.h5" || fail "reconstruct: title of fields of nodal values"
expect 2 "nodal values need --truth, modes a --basis" reconstruct "$nodes"
expect 5 "$folder/one/modes.h5 as nodal values of $folder/beam.h5: expected columns u[0:60] and sigma[0:120]" \
    reconstruct "$folder/one/modes.h5" --truth "$folder/beam.h5" --trajectories 1
expect 5 "expected columns other_u[0:60] and other_sigma[0:120]" \
    reconstruct "$nodes" --truth "$folder/beam.h5" --body other
expect 2 "expected A:B" nodes "$folder/beam.h5" --mesh "$mesh" --trajectories 0:3 -o "$nodes"
expect 4 "nowhere.h5" nodes "$folder/nowhere.h5" --mesh "$mesh" -o "$nodes"
expect 5 "/z" nodes "$nodes" --mesh "$mesh" -o "$new"
expect 4 "/nowhere/new.h5" nodes "$folder/beam.h5" --mesh "$mesh" -o /nowhere/new.h5

# --- contact ---
fields="lower=$folder/beams_lower.h5,upper=$folder/beams_upper.h5"
succeed "modes.h5: 2 trajectories of 8 states" reduce "$modes" --data "$folder/beams_upper.h5" --basis "$basis" -o "$folder/one"
with_beams ''
succeed "lower_upper.h5: 2 contact pairs, 1 m apart" contact "$beam" --basis "$basis" --stiffness 1e6 --creep 1e-6 -o "$folder/two"
[ -e "$folder/two/lower_upper.h5" ] && [ ! -e "$folder/two/modes.h5" ] || fail "contact: its files"
succeed "modes.h5: 1 trajectory of 8 states" contact "$beam" --basis "$basis" --stiffness 1e6 --data "$fields" --trajectories 0:1 -o "$folder/two"
succeed "displacement" reconstruct "$folder/two/modes.h5" --body upper --basis "$basis" --truth "$folder/beams_upper.h5" --trajectories 0
with_contact="reconstruct $folder/two/modes.h5 --basis $basis --contact $beam"
succeed "stress" $with_contact --body upper --weights "$folder/two" --truth "$folder/beams_upper.h5" --trajectories 0
expect 2 "belong together" $with_contact --weights "$folder/two"
expect 2 "belong together" $with_contact --body upper
expect 6 "nowhere/lower_upper.h5" $with_contact --body upper --weights "$folder/nowhere"
expect 2 'places no "middle"' $with_contact --body middle --weights "$folder/two"
succeed "in 1 of 1 trajectory" contact "$beam" --basis "$basis" --data "$fields" --trajectories 0 --score "$folder/two/modes.h5" --weights "$folder/two"
succeed "touch in none of 1 trajectory" contact "$beam" --basis "$basis" --data "$fields" --trajectories 1 --score "$folder/two/modes.h5" --weights "$folder/two"
expect 5 'no column "middle_a0"' reconstruct "$folder/two/modes.h5" --body middle --basis "$basis"
expect 2 "trajectories: 1 of modes, 2 of the fields" contact "$beam" --basis "$basis" --data "$fields" --score "$folder/two/modes.h5" --weights "$folder/two"
expect 2 "--stiffness: expected a number > 0, found \"1e6N\"" contact "$beam" --basis "$basis" --stiffness 1e6N -o "$folder/two"
expect 2 "--score needs --data" contact "$beam" --basis "$basis" --score "$folder/two/modes.h5"
expect 2 "needs the --weights of the recording" contact "$beam" --basis "$basis" --data "$fields" --score "$folder/two/modes.h5"
expect 2 "--output needs --stiffness" contact "$beam" --basis "$basis" -o "$folder/two"
expect 2 "and need --output" contact "$beam" --basis "$basis" --stiffness 1e6 --data "$fields" --score "$folder/two/modes.h5"
succeed "in 1 of 2 trajectories" contact "$beam" --basis "$basis" --stiffness 1e6 --data "$fields" -o "$folder/three" --score "$folder/three/modes.h5"
expect 2 "--creep: expected a number > 0, found \"-1\"" contact "$beam" --basis "$basis" --stiffness 1e6 --creep -1 -o "$folder/two"
expect 4 "$new: cannot make or write this folder" contact "$beam" --basis "$basis" --stiffness 1e6 -o "$new"
# The same body in other coordinates: a different basis.
with_modes 's/inertia_time: .*/inertia_time: 0.003/'
succeed "modes.h5: 16" reduce "$modes" --data "$folder/beam.h5" -o "$folder/other"
other=$folder/other/basis.h5
expect 5 "two/modes.h5: made with basis " reconstruct "$folder/two/modes.h5" --body upper --basis "$other"
expect 5 "two/modes.h5: made with basis " contact "$beam" --basis "$other" --data "$fields" --trajectories 0 --score "$folder/two/modes.h5" --weights "$folder/two"
expect 2 "nothing to do" contact "$beam" --stiffness 1e6 --basis "$basis" --data "$fields"
expect 2 "expected upper=FILE" contact "$beam" --stiffness 1e6 --basis "$basis" --data "lower=$folder/beams_lower.h5" -o "$folder/two"
expect 5 "the field of upper has 2 trajectories of 5 states" contact "$beam" --basis "$basis" \
    --data "lower=$folder/beams_lower.h5,upper=$folder/beam.h5" --trajectories 0 --score "$folder/two/modes.h5" --weights "$folder/two"
expect 5 "no columns from" contact "$beam" --basis "$basis" --data "$fields" --score "$folder/one/modes.h5" --weights "$folder/two"
with_beams 's/+y, -x, +z/+y, +x, +z/'
expect 3 "right-handed" contact "$beam" --stiffness 1e6 --basis "$basis" -o "$folder/two"
with_beams 's/, 11\]/]/'
expect 3 "origin: expected three numbers" contact "$beam" --stiffness 1e6 --basis "$basis" -o "$folder/two"
with_modes 's/0.2, 0.5/0.2, -0.5/'
expect 3 "relaxation: expected times > 0" reduce "$modes" --data "$folder/beam.h5" -o "$folder/one"
with_modes 's/symmetry: square/symmetry: round/'
expect 3 "symmetry: expected one of any, square" reduce "$modes" --data "$folder/beam.h5" -o "$folder/one"
with_modes 's/state: 3/state: 7/'
expect 3 "state: expected a whole number" reduce "$modes" --data "$folder/beam.h5" -o "$folder/one"
with_modes 's/state: 3/state: 3\nturned: 2/'
expect 3 "turned: expected a whole number" reduce "$modes" --data "$folder/beam.h5" -o "$folder/one"

# --- fit ---
sed "s|^scene: |scene: $PWD/configs/train/|; /scale:/s/3.4, 3.4/3.4, -3.4/" configs/train/public_beam.yaml >"$folder/bad.yaml"
expect 3 "expected numbers >= 0, found -3.4" fit "$folder/bad.yaml" -o "$folder/none"
"$train" propose "$scene" --data "$data" -o "$folder/first.yaml" --budget 0 >"$folder/out" 2>"$folder/err" || fail "propose"
sed 's/unit: J\/K/unit: furlongs/' "$scene" >"$folder/odd.yaml"
succeed 'the unit "furlongs" is not known' propose "$folder/odd.yaml" --data "$data" -o "$folder/odd_first.yaml" --budget 0
sed -i 's/^data: {/data: {seconds: 1.0e-9, /' "$folder/first.yaml"
expect 5 "seconds: 1e-09 s are shorter than a step" fit "$folder/first.yaml" --data "$data" -o "$folder/none"
sed -i 's/seconds: 1.0e-9/pieces: 2/' "$folder/first.yaml"
expect 3 "only measurements are divided" fit "$folder/first.yaml" --data "$data" -o "$folder/none"

# --- evaluate ---
succeed "Both laws" evaluate "$scene" --data "$data"
succeed '"nonfinite": 0' evaluate "$scene" --data "$data" --json --trajectories 0:
succeed '"trajectories": 1' evaluate "$scene" --json --data "$data" --record "$new"
# What was recorded is a dataset that the same rollouts fit.
succeed '"trained_groups": {' evaluate "$scene" --json --data "$data" --trained 0
succeed '"high": 0, "mean": 0, "max": 0}' evaluate "$scene" --json --data "$new"
succeed '"kind": "production", "name": "", "median": 0, "mean": 0, "max": 0, "bias": 0' evaluate "$scene" --json --data "$new"
succeed "Reference: the model in the true states; their entropies are given" evaluate "$scene" --data "$data"
# Many ports have two lines for each kind of quantity.
succeed "power       of 9 ports" evaluate configs/chain_10.yaml --data configs/reference/chain_10.h5
[ "$(grep -c '^  power' "$folder/out")" -eq 2 ] || fail "evaluate: expected two lines for the powers of nine ports"
grep -q '^  power       worst: joint2 ' "$folder/out" || fail "evaluate: expected the port with the largest error"
[ "$(grep -c '^  energy ' "$folder/out")" -eq 2 ] || fail "evaluate: expected two lines for ten energies"
expect 5 "nan.h5" evaluate "$scene" --data "$folder/nan.h5"
expect 5 "scene.yaml:7:30: subsystem left: column \"q1\" is not in the dataset" evaluate "$scene" \
    --data configs/reference/double_pendulum.h5
sed 's/dt: 0.05/dt: 0.03/' "$scene" >"$folder/bad.yaml"
expect 5 "no multiple" evaluate "$folder/bad.yaml" --data "$data"
expect 6 "scene.yaml:5:14: subsystem left: weights $folder/nowhere/left.h5: " evaluate "$scene" --data "$data" --weights "$folder/nowhere"
expect 4 "/nowhere/new.h5" evaluate "$scene" --data "$data" --record /nowhere/new.h5
expect 4 "/nowhere/plots" evaluate "$scene" --data "$data" --plot /nowhere/plots
if command -v gnuplot >/dev/null; then
    timeout 200 "$train" evaluate "$scene" --data "$data" --trained 0 --plot "$folder/plots" \
        >"$folder/out" 2>"$folder/err" || fail "--plot"
    grep -q '^Trajectories that training saw: 0 to 0' "$folder/out" || fail "--trained"
    grep -q trained_snapshots.txt "$folder/plots/errors.gp" || fail "errors.gp without training"
    for picture in errors trajectory growth laws; do
        [ -s "$folder/plots/$picture.png" ] || fail "no $picture.png"
    done
fi
program=$folder/without_gnuplot/portmet-train
mkdir "$folder/without_gnuplot"
printf '#!/bin/sh\nPATH=/nowhere exec "%s" "$@"\n' "$train" >"$program"
chmod +x "$program"
expect 4 "gnuplot is not installed" evaluate "$scene" --data "$data" --plot "$folder/plots"

finish
