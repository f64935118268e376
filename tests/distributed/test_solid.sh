#!/bin/sh
# test_solid.sh PORTMETD MAKE_SCENE SAME_RECORDING PORTMET_TRAIN: a solid in a scene keeps both laws and
# follows the finite elements; over LCM, and after its process was killed, it has the bits of a single
# process.
. "$(dirname "$0")/network.sh"
train=$4
configs=$(realpath "$(dirname "$0")/../../configs")

# does ARGUMENT...: a command of the trainer.
does() {
    "$train" "$@" >"$folder/train.out" 2>"$folder/train.err" </dev/null || fail "portmet-train $*"
}

sed 's/size: .40, 10, 10./size: [24, 8, 12]/; s/elements: .*/elements: [5, 2, 3]/; s/states: .*/states: 21/' \
    "$configs/truth/beam.yaml" >"$folder/truth.yaml"
does truth "$folder/truth.yaml" -o "$folder/beam.h5" --trajectories 0:1
does nodes "$folder/beam.h5" --mesh "$folder/mesh.h5" -o "$folder/nodes.h5"

# 72 nodes, 30 bricks
sed -e "s,weights/solid_beam/material,$configs/&,; s,weights/solid_beam/mesh.h5,mesh.h5," \
    -e 's/0:2268/0:216/; s/0:4536/0:432/; s/size: 2268/size: 216/; s/size: 48000/size: 2880/' \
    -e 's,reference/beam_solid.h5,nodes.h5,; s/steps: .*,/steps: 20,/' "$configs/beam_solid.yaml" >"$folder/solid.yaml"

"$portmetd" run "$folder/solid.yaml" --in-process >"$folder/plain.out" || fail "in process"
grep -q "steps in violation: 0;" "$folder/plain.out" || fail "a law is violated"
awk '$3 == "%" { n++; if (!($2 <= 0.5)) bad = 1 } END { exit n != 3 || bad }' "$folder/plain.out" ||
    fail "errors above 0.5 %: $(grep '%$' "$folder/plain.out" | tr -s ' \n' ' ')"

# same_bits SCENE STEPS: also after each process was killed some steps after a checkpoint, when the stiffness may belong to
# a state of long before.
same_bits() {
    "$portmetd" test "$1" --steps "$2" >"$folder/test.out" 2>"$folder/test.err" || fail "$1: $(cat "$folder/test.out")"
}
same_bits "$folder/solid.yaml" 20

# Two crossed solids in processes of their own. The upper one is pressed onto the lower one within a few
# steps; a body that dies in contact goes on with the same bits.
sed 's/elements: .*/elements: [10, 2, 2]/; s/states: .*/states: 17/; s/force: .*/force: [9.0e4, 1.0e5]/; s/36, -26, 11/36, -26, 10.2/' \
    "$configs/truth/crossed_beams.yaml" >"$folder/crossed.yaml"
does truth "$folder/crossed.yaml" -o "$folder/crossed.h5" --trajectories 0:1
does contact "$folder/crossed.yaml" --solid lower,upper --stiffness 2e6 -o "$folder/crossed" \
    --data "lower=$folder/crossed_lower.h5,upper=$folder/crossed_upper.h5"
nodes=$(sed -n 's/.*lower.h5: [0-9]* nodes, \([0-9]*\) of them.*/\1/p' "$folder/train.out")
pairs=$(sed -n 's/.*lower_upper.h5: \([0-9]*\) contact pairs.*/\1/p' "$folder/train.out")
# 99 nodes, 40 bricks
sed -e "s,weights/solid_beam,$configs/&,; s,weights/crossed_solids,crossed,; s,reference/crossed_solids.h5,crossed/modes.h5," \
    -e 's/0:2268/0:297/; s/0:4536/0:594/; s/size: 2268/size: 297/; s/size: 48000/size: 3840/' \
    -e "s/144/$((3 * nodes))/; s/creep\[0:36/creep[0:$pairs/; s/steps: .*,/steps: 16,/" "$configs/crossed_solids.yaml" >"$folder/pair.yaml"
"$portmetd" run "$folder/pair.yaml" --in-process >"$folder/pair.out" || fail "pair: in process"
grep -q "steps in violation: 0;" "$folder/pair.out" || fail "pair: a law is violated"
grep -Eq 'lower +below +[+][1-9]' "$folder/pair.out" || fail "pair: nothing touches"
awk '$1 == "u" && $3 == "%" { n++; if (!($2 <= 5)) bad = 1 } END { exit n != 1 || bad }' "$folder/pair.out" ||
    fail "pair: errors above 5 %: $(grep '%$' "$folder/pair.out" | tr -s ' \n' ' ')"
same_bits "$folder/pair.yaml" 15

# refuses CODE PATTERN SED-COMMAND: a scene that `check` does not accept.
refuses() {
    sed "$3" "$folder/solid.yaml" >"$folder/bad.yaml"
    "$portmetd" check "$folder/bad.yaml" >"$folder/bad.out" 2>&1
    code=$?
    [ $code -eq "$1" ] && grep -q -e "$2" "$folder/bad.out" || fail "$2: code $code: $(cat "$folder/bad.out")"
}
refuses 6 "the solid body needs a mesh" '/mesh:/d'
refuses 6 "u of the solid body has 216 components in mm, and its mesh demands 216 in m" 's/u: {unit: m/&m/'
refuses 6 "needs a group inner, in 1, of size 2880" '/inner:/d'
refuses 4 "nowhere.h5" 's/mesh.h5/nowhere.h5/'
refuses 5 "node_position_reference is missing" 's/mesh: mesh.h5/mesh: nodes.h5/'
sed 's/discrete_gradient/rk4/' "$folder/solid.yaml" >"$folder/bad.yaml"
"$portmetd" run "$folder/bad.yaml" --in-process >"$folder/bad.out" 2>&1
[ $? -eq 3 ] && grep -q "needs the integrator discrete_gradient" "$folder/bad.out" || fail "rk4: $(cat "$folder/bad.out")"
no_orphans "at the end"
finish
