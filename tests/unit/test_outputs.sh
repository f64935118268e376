#!/bin/sh
# test_outputs.sh PORTMETD MAKE_SCENE PORTMET_TRAIN TRUTH: no command overwrites a file that it reads, nor replaces a
# device. TRUTH is a truth file.
. "$(dirname "$0")/../support/setting.sh"
portmetd=$1 make_scene=$2 train=$3 truth=$4
"$make_scene" "$folder" || fail "make_scene"
sed 's/^trajectories:.*/trajectories: 1/; s/^states:.*/states: 3/' "$truth" >"$folder/truth.yaml"
scene=$folder/scene.yaml data=$folder/reference.h5

# refuse FILE ARGUMENT...: $program does not overwrite FILE, and says so.
refuse() {
    input=$1
    shift
    cp "$input" "$folder/before"
    expect 2 "$input: the program reads this file, and does not overwrite it" "$@"
    cmp -s "$input" "$folder/before" || fail "${program##*/} $* has changed $input"
}

program=$train
refuse "$folder/truth.yaml" truth "$folder/truth.yaml" -o "$folder/truth.yaml"
refuse "$scene" propose "$scene" --data "$data" -o "$scene"
refuse "$data" propose "$scene" --data "$data" -o "$data"
refuse "$data" evaluate "$scene" --data "$data" --record "$data"
[ ! -s "$folder/out" ] || fail "evaluate has begun before it refuses its output"
cp "$data" "$folder/others.h5"
refuse "$data" evaluate "$scene" --data "$folder/others.h5" --record "$data" # the reference of the scene
program=$portmetd
refuse "$scene" export "$scene" -o "$scene"
refuse "$folder/left.h5" export "$scene" -o "$folder/left.h5"
refuse "$data" run "$scene" --in-process --record "$data" --overwrite

# A link to an input is the input.
ln "$scene" "$folder/link.yaml"
expect 2 "link.yaml: the program reads this file" export "$scene" -o "$folder/link.yaml"

# A dataset takes the place of its file, and must not do so with a device.
mkfifo "$folder/pipe"
program=$train
expect 4 "pipe: this is not a regular file" truth "$folder/truth.yaml" -o "$folder/pipe"

# A reader does not wait for what somebody might write to a pipe.
expect 4 "pipe: this is not a regular file" truth "$folder/pipe" -o "$folder/new.h5"
expect 4 "pipe: this is not a regular file" import "$folder/pipe" -o "$folder/new.h5"
expect 4 "pipe: this is not a regular file" picture "$folder/pipe" -o "$folder/new.png"

# A table is an input, too, whichever program reads it.
printf 't,q\n0,1\n1,2\n2,3\n' >"$folder/table.csv"
refuse "$folder/table.csv" import "$folder/table.csv" -o "$folder/table.csv"
mkdir "$folder/tables"
cp "$data" "$folder/tables/table.mat" # a file of MATLAB may be of HDF5, as a dataset is
refuse "$folder/tables/table.mat" import "$folder/tables" -o "$folder/tables/table.mat"

# keep ARGUMENT...: $program keeps a letter, which is of another kind than what it writes.
keep() {
    expect 4 "letter: this file exists and is of another kind" "$@" "$folder/letter"
    grep -qx "a letter" "$folder/letter" || fail "${program##*/} $* has replaced a letter"
}
echo "a letter" >"$folder/letter"
keep import "$folder/table.csv" -o
keep truth "$folder/truth.yaml" -o
keep propose "$scene" --data "$data" -o
program=$portmetd
keep export "$scene" -o
keep emit procman "$scene" -o
keep bench "$scene" --write
keep stress "$scene" --write
keep bench "$scene" --processes --write
cp "$scene" "$folder/own.yaml"
expect 4 "own.yaml: this file exists and is of another kind" bench "$scene" --write "$folder/own.yaml"
cmp -s "$scene" "$folder/own.yaml" || fail "bench has replaced a scene that was written by hand"
echo "my notes" >"$folder/notes.txt"
for study in bench stress; do
    expect 4 "notes.txt: this file exists and is of another kind" $study "$scene" --steps 2 --picture "$folder/notes"
done
mkdir "$folder/code"
cp "$folder/letter" "$folder/code/pair.h"
expect 4 "pair.h: this file exists and is of another kind" export "$scene" --c "$folder/code"
program=$train

# Data, weights and recordings are HDF5 files, and no kind replaces another one.
cp "$folder/left.h5" "$folder/unused.h5"
expect 4 "unused.h5: this file exists and is of another kind" truth "$folder/truth.yaml" -o "$folder/unused.h5"
expect 4 "unused.h5: this file exists and is of another kind" import "$folder/table.csv" -o "$folder/unused.h5"
cmp -s "$folder/left.h5" "$folder/unused.h5" || fail "weights have been replaced"

# A link is no output, wherever it leads.
: >"$folder/empty.h5"
for end in /dev/null "$folder/pipe" "$folder/empty.h5" "$folder/nothing.h5"; do
    ln -s "$end" "$folder/symbolic.h5"
    expect 4 "symbolic.h5: this is a symbolic link, and is not replaced" truth "$folder/truth.yaml" -o "$folder/symbolic.h5"
    [ -L "$folder/symbolic.h5" ] || fail "a link to $end has been replaced"
    rm "$folder/symbolic.h5"
done
[ ! -e "$folder/nothing.h5" ] && [ ! -s "$folder/empty.h5" ] || fail "the end of a link has been written"

# kept FILE ARGUMENT...: FILE, which is a letter, is none of the files that the command replaces beside its output.
kept() {
    taken=$1
    shift
    cp "$folder/letter" "$taken"
    expect 4 "$taken: this file exists and is of another kind" "$@"
    cmp -s "$folder/letter" "$taken" || fail "${program##*/} $* has replaced $taken"
    [ ! -s "$folder/out" ] || fail "${program##*/} $* has begun before it refuses $taken"
    rm "$taken"
}

# Neither the scripts and tables of pictures nor the pictures replace what is not theirs, or an input.
mkdir "$folder/drawn" "$folder/bands"
for name in trajectories.txt trained_snapshots.txt states.txt errors.png errors.gp growth.txt laws.txt laws.png; do
    kept "$folder/drawn/$name" evaluate "$scene" --data "$data" --plot "$folder/drawn"
done
for name in predictions.h5 coverage.txt prediction_3.png; do
    kept "$folder/bands/$name" evaluate "$scene" --data "$data" --estimate 1 --plot "$folder/bands"
done
cp "$folder/table.csv" "$folder/drawn/measured.txt"
refuse "$folder/drawn/measured.txt" inspect "$folder/drawn/measured.txt" --plot "$folder/drawn"
expect 4 "measured.txt: this file exists and is of another kind" inspect "$folder/table.csv" --plot "$folder/drawn"
cmp -s "$folder/table.csv" "$folder/drawn/measured.txt" || fail "inspect has replaced measurements"
rm "$folder/drawn/measured.txt"
for name in growth laws; do # even if it has the mark of a table of a picture
    (echo "#: of a picture by portmet" && cat "$folder/table.csv") >"$folder/drawn/$name.txt"
    refuse "$folder/drawn/$name.txt" evaluate "$scene" --data "$folder/drawn/$name.txt" --plot "$folder/drawn"
done
if command -v gnuplot >/dev/null; then
    for again in 1 2; do # the program knows its own files again
        succeed "samples" inspect "$folder/table.csv" --plot "$folder/drawn"
        "$train" evaluate "$scene" --data "$data" --plot "$folder/drawn" >"$folder/out" 2>"$folder/err" || fail "evaluate --plot"
        program=$portmetd
        succeed "" stress "$scene" --steps 2 --picture "$folder/map"
        program=$train
    done
    gnuplot -e "set terminal pngcairo; set output '$folder/drawn/growth.png'; plot x"
    cp "$folder/drawn/growth.png" "$folder/own.png"
    expect 4 "growth.png: this file exists and is of another kind" evaluate "$scene" --data "$data" --plot "$folder/drawn"
    cmp -s "$folder/own.png" "$folder/drawn/growth.png" || fail "evaluate has replaced a picture"
fi
for ending in gp png svg; do
    program=$portmetd
    kept "$folder/place.$ending" bench "$scene" --picture "$folder/place"
    program=$train
done

# Fields have a description beside them, and pictures of them a script.
configs=$(dirname "$truth")/..
sed -e 's/elements: .*/elements: [4, 1, 1]/; s/states: .*/states: 4/' "$configs/truth/beam.yaml" >"$folder/beam.yaml"
sed -e 's/elements: .*/elements: [4, 1, 1]/; s/states: .*/states: 4/' "$configs/truth/crossed_beams.yaml" >"$folder/beams.yaml"
for name in beam.xdmf beams_lower.xdmf beams_upper.xdmf beams_upper.h5; do
    kept "$folder/$name" truth "$folder/${name%%[_.]*}.yaml" -o "$folder/${name%%[_.]*}.h5" --trajectories 0:1
done
for again in 1 2; do
    succeed "wrote" truth "$folder/beam.yaml" -o "$folder/beam.h5" --trajectories 0:1
done
weights=$configs/weights/solid_beam/material.h5
kept "$folder/keep.xdmf" respond "$folder/beam.h5" --weights "$weights" -o "$folder/keep.h5"
kept "$folder/drawn/errors.txt" respond "$folder/beam.h5" --weights "$weights" --plot "$folder/drawn"
kept "$folder/keep.xdmf" correct "$folder/beam.h5" --by "$folder/beam.h5" -o "$folder/keep.h5"
kept "$folder/keep.gp" picture "$folder/beam.h5" -o "$folder/keep.png"
kept "$folder/keep.png" picture "$folder/beam.h5" -o "$folder/keep.png"
cp "$folder/beam.h5" "$folder/beside.h5"
refuse "$folder/beside.h5" picture "$folder/beam.h5" --beside "$folder/beam.h5,$folder/beside.h5" -o "$folder/beside.h5"
refuse "$folder/beam.h5" solid "$folder/beam.h5" -o "$folder/beam.h5"
[ ! -s "$folder/out" ] || fail "solid has learned before it refuses its output"

# What the program has written it may read and write again.
succeed "wrote" truth "$folder/truth.yaml" -o "$folder/new.h5"
succeed "wrote" truth "$folder/truth.yaml" -o "$folder/new.h5"

# What is proposed moves with its folder, since its files name each other, and the data, as seen from where they are.
mkdir -p "$folder/study/drafts"
awk 'BEGIN { print "t,angle"; for (i = 0; i < 100; ++i) printf "%g,%g\n", i * 0.05, exp(-0.01 * i) * cos(0.1 * i) }' \
    >"$folder/study/angle.csv"
cp "$scene" "$data" "$folder/study"
(
    cd "$folder/study/drafts"
    "$train" propose --data ../angle.csv -o pendulum --budget 0 && "$train" propose ../scene.yaml --data ../reference.h5 -o pair.yaml --budget 0
) >"$folder/proposed" 2>&1 || fail "propose: $(cat "$folder/proposed")"
grep -h 'h5\|^scene: ".*yaml' "$folder/study/drafts/pair.yaml" "$folder"/study/drafts/pendulum/*.yaml | grep 'file:\|^scene' |
    sed 's/.*\(scene\|file\): "\([^"]*\)".*/\2/' | sort | uniq | tr '\n' ' ' >"$folder/named"
grep -qx '../reference.h5 ../scene.yaml data.h5 scene.yaml ' "$folder/named" || fail "propose names $(cat "$folder/named")"
mv "$folder/study" "$folder/moved"
mkdir "$folder/taken"
cp "$folder/letter" "$folder/taken/fit.csv"
"$train" fit "$folder/moved/drafts/pendulum/training.yaml" -o "$folder/taken" >"$folder/out" 2>&1
[ $? -eq 4 ] && cmp -s "$folder/letter" "$folder/taken/fit.csv" || fail "fit replaces a letter"
rm "$folder/taken/fit.csv"
for name in advice.yaml advice_scene.yaml fit.gp fit.png; do # neither written nor removed, and refused before the work
    cp "$folder/letter" "$folder/taken/$name"
    expect 4 "$name: this file exists and is of another kind" fit "$folder/moved/drafts/pendulum/training.yaml" -o "$folder/taken"
    cmp -s "$folder/letter" "$folder/taken/$name" || fail "fit replaces $name"
    [ ! -s "$folder/out" ] || fail "fit has begun before it refuses $name"
    rm "$folder/taken/$name"
done
cp "$folder/moved/drafts/pendulum/training.yaml" "$folder/moved/drafts/pendulum/advice.yaml"
refuse "$folder/moved/drafts/pendulum/advice.yaml" fit "$folder/moved/drafts/pendulum/advice.yaml" -o "$folder/moved/drafts/pendulum"
"$train" fit "$folder/moved/drafts/pendulum/training.yaml" -o "$folder/weights" >"$folder/fitted" 2>&1 ||
    fail "fit of a moved proposal: $(tail -n 3 "$folder/fitted")"
finish
