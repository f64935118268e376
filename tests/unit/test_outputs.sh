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
"$train" fit "$folder/moved/drafts/pendulum/training.yaml" -o "$folder/weights" >"$folder/fitted" 2>&1 ||
    fail "fit of a moved proposal: $(tail -n 3 "$folder/fitted")"
finish
