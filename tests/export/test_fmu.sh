#!/bin/sh
# test_fmu.sh BUILD IMPORTER: FMUs of scenes are well-formed archives whose sources compile and whose
# binaries simulate in an importer. Runs in the root.
. "$(dirname "$0")/scenes.sh"
importer=$2

# fmu NAME SUBSTEPS STEPS: the FMU of configs/NAME.yaml; SUBSTEPS of the scene it is compared with.
fmu() {
    scene=configs/$1.yaml
    "$portmetd" export "$scene" -o "$folder/$1.fmu" >"$folder/out" 2>&1 || fail "$1: $(cat "$folder/out")"
    grep -q "a binary for this machine" "$folder/out" || fail "$1 has no binary: $(cat "$folder/out")"
    mkdir -p "$folder/$1"
    (cd "$folder/$1" && cmake -E tar xf "../$1.fmu") || fail "$1.fmu is no archive"
    for file in modelDescription.xml sources/buildDescription.xml sources/fmi3.c sources/$1.c \
        terminalsAndIcons/terminalsAndIcons.xml documentation/index.html documentation/licenses/license.txt; do
        [ -s "$folder/$1/$file" ] || fail "$1.fmu lacks $file"
    done
    cc -std=c99 -Wall -Wextra -Werror -O1 -shared -fPIC -o "$folder/$1/again.so" "$folder/$1/sources/fmi3.c" \
        "$folder/$1/sources/$1.c" -lm || fail "$1: the sources do not compile"
    sed "s/substeps: [0-9]*/substeps: $2/; s|weights/|$PWD/configs/weights/|; s|reference/|$PWD/configs/reference/|" \
        "$scene" >"$folder/$1_fine.yaml"
    token=$(sed -n 's/.*instantiationToken="\([^"]*\)".*/\1/p' "$folder/$1/modelDescription.xml")
    for library in "$folder/$1/again.so" "$folder/$1/binaries"/*-linux/"$1.so"; do
        "$importer" "$library" "$token" "$scene" "$folder/$1_fine.yaml" "$3" || fail "$1: $library"
    done
    # The same scene gives the same sources and the same archive.
    "$portmetd" export "$scene" -o "$folder/again.fmu" --quiet
    cmp "$folder/$1.fmu" "$folder/again.fmu" || fail "$1: another archive"
}

fmu double_pendulum 400 200
fmu beam 800 200
fmu driven_lower 200 60
# A position that is measured from another one says so.
"$portmetd" check configs/double_pendulum.yaml | grep -q "^  q .*, measured from upper.q" || fail "check: measured from"
grep -q 'name="lower[.]q[[]0[]]".* description="state q of lower, measured from q of upper; length of ' \
    "$folder/double_pendulum/modelDescription.xml" || fail "double_pendulum: measured from"

# What arrives live in a run is an input of the FMU.
"$portmetd" export configs/live_double_pendulum.yaml -o "$folder/live.fmu" --quiet || fail "live"
(mkdir "$folder/live" && cd "$folder/live" && cmake -E tar xf ../live.fmu) || fail "live.fmu is no archive"
[ "$(grep -c 'name="pivot[.].dE/dp.[[]..*causality="input"' "$folder/live/modelDescription.xml")" -eq 2 ] ||
    fail "live values are no inputs"

# The same scenes under FMI 2.0.
for name in double_pendulum driven_lower; do
    "$portmetd" export "configs/$name.yaml" --fmi 2 -o "$folder/second.fmu" --quiet || fail "$name: FMI 2.0"
    rm -rf "$folder/second"
    (mkdir "$folder/second" && cd "$folder/second" && cmake -E tar xf ../second.fmu) || fail "second.fmu is no archive"
    cc -std=c99 -Wall -Wextra -Werror -fvisibility=hidden -O1 -shared -fPIC -o "$folder/second/again.so" \
        "$folder/second/sources/fmi2.c" "$folder/second/sources/$name.c" -lm || fail "$name: FMI 2.0 does not compile"
    python3 -B "$here/compare_versions.py" "$folder/second" "$folder/$name" || fail "$name: FMI 2.0"
done
# Guards of a scene, whose energy drifts with a poor integrator.
# guarded NAME GUARDS OPTION...: the FMU NAME of the scene with these guards.
guarded() {
    name=$1 guards=$2
    shift 2
    sed "s|weights/|$PWD/configs/weights/|; s|reference/|$PWD/configs/reference/|; s/rk4/euler/; s|^reference:|$guards\n&|" \
        configs/double_pendulum.yaml >"$folder/guarded.yaml"
    "$portmetd" export "$folder/guarded.yaml" "$@" -o "$folder/$name.fmu" --quiet || fail "$name"
    (mkdir "$folder/$name" && cd "$folder/$name" && cmake -E tar xf "../$name.fmu") || fail "$name.fmu is no archive"
}
guarded unguarded ""
guarded drift "guards: {energy_drift: 0.03}"
guarded drift2 "guards: {energy_drift: 0.03}" --fmi 2
guarded range "guards: {training_range: 0.2}"
python3 -B "$here/check_guard.py" "$folder/drift" "$folder/unguarded" inf 0.03 1 || fail "a guard of the energy"
python3 -B "$here/check_guard.py" "$folder/range" "$folder/unguarded" 0.2 inf 1.4 || fail "a guard of the range"
python3 -B "$here/compare_versions.py" "$folder/drift2" "$folder/drift" || fail "a guard: FMI 2.0"
"$portmetd" export configs/double_pendulum.yaml --fmi 1 -o "$folder/first.fmu" >"$folder/out" 2>&1
[ $? -eq 2 ] || fail "FMI 1"

# Inputs that a fit has seen have ranges.
train=$build/trainer/portmet-train
sed -e 's/^trajectories: .*/trajectories: 4/' -e 's/^states: .*/states: 20/' configs/truth/driven_lower.yaml >"$folder/truth.yaml"
sed -e "s|^scene: \.\./|scene: $PWD/configs/|" -e 's/iterations: [0-9]*/iterations: 1/' -e '/^data:/d' \
    configs/train/driven_lower.yaml >"$folder/train.yaml"
"$train" truth "$folder/truth.yaml" -o "$folder/driven.h5" >"$folder/out" 2>&1 || fail "truth of a driven link"
"$train" fit "$folder/train.yaml" --data "$folder/driven.h5" -o "$folder/weights" >"$folder/out" 2>&1
sed "s|weights/driven_lower|$folder/weights|; s|reference/driven_lower.h5|$folder/driven.h5|" configs/driven_lower.yaml \
    >"$folder/trained.yaml"
"$portmetd" export "$folder/trained.yaml" -o "$folder/trained.fmu" --quiet || fail "a trained link"
(mkdir "$folder/trained" && cd "$folder/trained" && cmake -E tar xf ../trained.fmu) || fail "trained.fmu is no archive"
python3 -B "$here/check_inputs.py" "$folder/trained" || fail "ranges of inputs"

# Two FMUs, each of one pendulum with the other one as its outside, are coupled by an importer.
# cut NAME OTHER: the scene with NAME alone.
cut() {
    cat <<EOF
scene: $1_alone
time: {dt: 0.3, steps: 200, integrator: rk4, substeps: 16}
subsystems:
  $1:
    weights: $PWD/configs/weights/double_pendulum/$1.h5
    state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}
    initial: {q: [0.0, 1.0], p: [0.0, 0.0], s: 0.0}
live_inputs: {OTHER: {values: ["x[0:5]", "dE[0:5]"], wait: true}}
boundary_inputs:
  $2:
    q: {unit: m, value: ["x[0:2]"], dE: ["dE[0:2]"]}
    p: {unit: kg m/s, value: ["x[2:4]"], dE: ["dE[2:4]"]}
    s: {unit: J/K, value: [x4], dE: [dE4], dS: [1]}
ports:
  joint:
    law: bracket
    between: [upper, lower]
    expose: {upper: [q, p, s], lower: [q, p, s]}
    weights: $PWD/configs/weights/double_pendulum/joint.h5
EOF
}
for pair in "upper lower" "lower upper"; do
    set -- $pair
    cut "$1" "$2" >"$folder/$1.yaml"
    "$portmetd" export "$folder/$1.yaml" -o "$folder/$1.fmu" --quiet || fail "$1 alone"
    (mkdir "$folder/$1" && cd "$folder/$1" && cmake -E tar xf "../$1.fmu") || fail "$1.fmu is no archive"
done
python3 -B "$here/couple_fmus.py" "$folder/double_pendulum" "$folder/upper" "$folder/lower" || fail "coupled FMUs"

# Without a compiler there are sources alone.
CC=/nowhere "$portmetd" export configs/double_pendulum.yaml -o "$folder/plain.fmu" >"$folder/out" 2>&1
grep -q "sources alone" "$folder/out" || fail "no compiler: $(cat "$folder/out")"
"$portmetd" export configs/double_pendulum.yaml -o /nowhere/x.fmu >"$folder/out" 2>&1
[ $? -eq 4 ] || fail "an FMU in a folder that is not there"
wide_scene >"$folder/wide.yaml"
"$portmetd" export "$folder/wide.yaml" -o "$folder/none.fmu" >"$folder/out" 2>&1
[ ! -e "$folder/none.fmu" ] || fail "half an FMU is left"
rm -f "$folder/out"

# What the standard asks of the descriptions.
for python in python3 /usr/bin/python3; do
    command -v "$python" >/dev/null || continue
    "$python" "$here/check_description.py" "$folder/double_pendulum" "$folder/beam" "$folder/driven_lower" \
        "$folder/range" "$folder/trained" ||
        fail "a description"
    break
done

finish
