#!/bin/sh
# test_scenes.sh PORTMETD MAKE_SCENE SAME_RECORDING [whole]: scenes assembled from the shipped weights run, stay
# close to their references and keep both laws: parts used many times (chains), a circle of three
# subsystems and ports (gas containers), known parts, contact, parts with boundary inputs.
# In processes over LCM the bits are the same. Without `whole` a beam and a solid touch in fewer substeps, and in one
# process.
. "$(dirname "$0")/network.sh"
configs=$(dirname "$0")/../../configs

# keeps NAME STEPS [LIMIT]: a run in this process; every error of its table at most LIMIT (default: 0.1) %.
keeps() {
    "$portmetd" run "$configs/$1.yaml" --steps "$2" --in-process --record "$folder/$1.h5" \
        >"$folder/$1.out" 2>"$folder/$1.err" || fail "$1: does not run"
    grep -q "steps in violation: 0;" "$folder/$1.out" || fail "$1: a law is violated"
    awk '$3 == "%" { n++; if (!($2 <= limit)) bad = 1 } END { exit n < 3 || bad }' limit="${3:-0.1}" "$folder/$1.out" ||
        fail "$1: errors above ${3:-0.1} %: $(grep '%$' "$folder/$1.out" | tr -s ' \n' ' ')"
}

# same_bits NAME STEPS [FOLDER]: like the run before, but one process per subsystem.
same_bits() {
    start "${1}_lcm" run "${3:-$configs}/$1.yaml" --steps "$2" --quiet --record "$folder/$1_lcm.h5"
    ends "${1}_lcm" $pid 0 ""
    "$same_recording" "$folder/$1.h5" "$folder/$1_lcm.h5" || fail "$1: other bits over LCM"
}

keeps chain_3 100
keeps chain_5 100
keeps chain_10 20
same_bits chain_10 20
keeps analytic_double_pendulum 200
keeps half_analytic_double_pendulum 200
same_bits half_analytic_double_pendulum 200
keeps gas_containers 400
same_bits gas_containers 400

# Substeps that follow the error: the coordinator chooses as one process does.
sed -e "s,reference/,$(realpath "$configs")/reference/," -e 's/rk4, substeps: 16/rk4_balanced, tolerance: 3.0e-5/' \
    "$configs/analytic_double_pendulum.yaml" >"$folder/adaptive.yaml"
"$portmetd" run "$folder/adaptive.yaml" --in-process --record "$folder/adaptive.h5" >"$folder/adaptive.out" ||
    fail "adaptive: does not run"
grep -q "substeps for a tolerance of 3e-05" "$folder/adaptive.out" || fail "adaptive: says nothing of it"
grep -q "steps in violation: 0;" "$folder/adaptive.out" || fail "adaptive: a law is violated"
same_bits adaptive 200 "$folder"
start kept run "$folder/adaptive.yaml" --checkpoint "$folder/kept"
ends kept $pid 3 "has a tolerance, and --checkpoint needs fixed substeps"

# said PATTERN: a line of what `check` printed last.
said() {
    grep -Eq "$1" "$folder/check.out" || fail "check: expected \"$1\""
}
"$portmetd" check "$configs/driven_lower.yaml" >"$folder/check.out" || fail "driven_lower: check"
said '^boundary input pivot: '
said '^  p +2 x kg m/s +dE vx vy$'
said '^  s +1 x J/K +dE T  dS 1$'
said '^  end a +pivot exposes p s$'
! grep -q FLUX "$folder/check.out" || fail "check: nobody sends fluxes in driven_lower"

keeps driven_upper 100
keeps driven_lower 100
same_bits driven_lower 100
keeps driven_double_pendulum 200

# The same with a pivot that moves steadily beside a bath of 295 K: a part with a load and a neighbour.
sed -e "s,weights/,$(realpath "$configs")/weights/,; s,reference/,$(realpath "$configs")/reference/," \
    -e '/^ports:/i boundary_inputs: {pivot: {p: {unit: kg m/s, dE: [0.1, 0]}, s: {unit: J/K, dE: 295, dS: 1}}}' \
    "$configs/driven_double_pendulum.yaml" >"$folder/pulled.yaml"
cat >"$folder/base.yaml" <<END
  base:
    law: bracket
    between: [pivot, upper]
    expose: {pivot: [p, s], upper: [q, s]}
    weights: $(realpath "$configs")/weights/driven_upper/base.h5
END
sed -i "/^ports:/r $folder/base.yaml" "$folder/pulled.yaml"
"$portmetd" run "$folder/pulled.yaml" --steps 50 --in-process --record "$folder/pulled.h5" \
    >"$folder/pulled.out" || fail "pulled: does not run"
grep -q "steps in violation: 0;" "$folder/pulled.out" || fail "pulled: a law is violated"
grep -Eq 'upper +base +[+-][1-9]' "$folder/pulled.out" || fail "pulled: nothing flows at the load"
same_bits pulled 50 "$folder"

# Contact, until both gaps have closed.
"$portmetd" run "$configs/bouncing_masses.yaml" --steps 480 --in-process \
    --record "$folder/bouncing_masses.h5" >"$folder/bouncing.out" || fail "bouncing_masses: does not run"
grep -q "steps in violation: 0;" "$folder/bouncing.out" || fail "bouncing_masses: a law is violated"
grep -Eq 'light +upward +[+][1-9]' "$folder/bouncing.out" || fail "bouncing_masses: nothing touches"
same_bits bouncing_masses 480

# Two beams that touch from step 7 on; what they are made of was learned from one alone.
"$portmetd" run "$configs/crossed_beams.yaml" --steps 10 --in-process \
    --record "$folder/crossed_beams.h5" >"$folder/crossed.out" || fail "crossed_beams: does not run"
grep -q "steps in violation: 0;" "$folder/crossed.out" || fail "crossed_beams: a law is violated"
grep -Eq 'lower +below +[+][1-9]' "$folder/crossed.out" || fail "crossed_beams: nothing touches"
awk '$1 == "a" && $3 == "%" { n++; if (!($2 <= 2)) bad = 1 } END { exit n != 1 || bad }' "$folder/crossed.out" ||
    fail "crossed_beams: errors above 2 %: $(grep '%$' "$folder/crossed.out" | tr -s ' \n' ' ')"
same_bits crossed_beams 10

# A beam in modes and a solid, which touch from step 12 on.
substeps=16
[ "${4-}" != whole ] || substeps=64
sed -e "s,weights/,$(realpath "$configs")/weights/,; s,reference/,$(realpath "$configs")/reference/," \
    -e "s/substeps: 64/substeps: $substeps/" "$configs/crossed_mixed.yaml" >"$folder/crossed_mixed.yaml"
"$portmetd" run "$folder/crossed_mixed.yaml" --steps 13 --in-process \
    --record "$folder/crossed_mixed.h5" >"$folder/mixed.out" || fail "crossed_mixed: does not run"
grep -q "steps in violation: 0;" "$folder/mixed.out" || fail "crossed_mixed: a law is violated"
grep -Eq 'lower +below +[+][1-9]' "$folder/mixed.out" || fail "crossed_mixed: nothing touches"
if [ "${4-}" = whole ]; then
    same_bits crossed_mixed 13 "$folder"
else
    "$portmetd" run "$folder/crossed_mixed.yaml" --steps 2 --in-process --quiet --record "$folder/crossed_mixed.h5" ||
        fail "crossed_mixed: does not run"
    same_bits crossed_mixed 2 "$folder"
fi

# A solid on an unstructured mesh from a file, of a material that was learned from another body.
keeps l_body 20 0.4
same_bits l_body 20

# A node under another load is refused.
sed 's/dE: 295/dE: 296/' "$folder/pulled.yaml" >"$folder/other.yaml"
start other_node node "$folder/other.yaml" upper
other=$pid
start other_run coordinator "$folder/pulled.yaml" --quiet
ends other_run $pid 7 "node upper holds another scene, weights or initial state"
kill "$other" 2>/dev/null
wait "$other" 2>/dev/null
finish
