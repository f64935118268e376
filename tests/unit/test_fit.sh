#!/bin/sh
# test_fit.sh PORTMET_TRAIN PORTMETD [short]: short fits of a few trajectories lower the loss; the same
# command gives the same bits of weights, also when it was interrupted and resumed; and bad training
# files end with one line that has file, line and column. `short` makes fits that are interrupted
# shorter, and leaves out substeps that are doubled five times, a second fit of more iterations, and a needless coupling.
set -u
train=$1
portmetd=$2
short=${3:-}
less=1 # by which numbers of iterations are divided
[ "$short" = short ] && less=6
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
failures=0
data=$folder/data.h5

fail() {
    failures=$((failures + 1))
    echo "FAILED: $*"
    sed 's/^/    /' "$folder/out" "$folder/err"
}

# The shipped scene, and a training file of our own whose models stay as they are written, so that
# every stage has something left to learn.
sed "s|file: reference|file: $PWD/configs/reference|" configs/double_pendulum.yaml >"$folder/scene.yaml"
cat >"$folder/base.yaml" <<'END'
scene: scene.yaml
seed: 1
defaults: plain

models:
  link:
    form: hard
    energy:
      - {given: {s: 300.0}}
      - {features: ["|p|^2"], skip: linear}
      - {features: ["ln|q|", s], hidden: [8, 8], skip: quadratic}
    entropy: {given: s}
    reversible: {given: [[q, p, 1.0]]}
  joint:
    law: bracket
    form: hard
    reversible: {given: [[a.p, b.q, 1.0]]}
    irreversible: {learned: {acts_on: [a.s, b.s], rank: 1}}

subsystems: {upper: link, lower: link}
ports: {joint: joint}

loss: {residual: step}
END
# config NAME STAGE...
config() {
    name=$1
    shift
    cp "$folder/base.yaml" "$folder/$name.yaml"
    echo "stages:" >>"$folder/$name.yaml"
    for stage in "$@"; do
        echo "  - $stage" >>"$folder/$name.yaml"
    done
}

# fit NAME DIR ARGUMENT...: code is its exit code; short fits may well be unfit (13), and test_advice tries what they lack
fit() {
    name=$1 out=$2
    shift 2
    timeout 900 "$train" fit "$folder/$name.yaml" --data "$data" -o "$folder/$out" --budget 0 "$@" \
        >"$folder/out" 2>"$folder/err" </dev/null
    code=$?
    [ $code -eq 0 ] || [ $code -eq 13 ]
}

# The digests of all weights in a folder.
digests() {
    "$portmetd" check "$folder/scene.yaml" --weights "$folder/$1" |
        sed -n 's/.* numbers, digest \(.*\)/\1/p'
}

# same_weights WHAT DIR DIR
same_weights() {
    a=$(digests "$2")
    b=$(digests "$3")
    [ "$(echo "$a" | wc -w)" -eq 3 ] && [ "$a" = "$b" ] || fail "$1: other weights:" $a, $b
}

# The mean squared residual after the last stage.
residual() {
    sed -n 's/.* mean \([^ ]*\)$/\1/p' "$folder/out" | tail -1
}

# at_most A B: A <= B, numbers as C prints them
at_most() {
    awk -v a="$1" -v b="$2" 'BEGIN { exit !(a != "" && b != "" && a + 0 <= b + 0) }'
}

sed -e 's/^trajectories: .*/trajectories: 3/' -e 's/^states: .*/states: 24/' \
    configs/truth/double_pendulum.yaml >"$folder/truth.yaml"
"$train" truth "$folder/truth.yaml" -o "$data" >"$folder/out" 2>"$folder/err" || fail truth

# --- every optimiser lowers the loss ---
config untrained '{optimiser: adam, iterations: 1, rate: 1.0e-12}'
fit untrained untrained || fail "fit untrained"
start=$(residual)
# optimiser, residual at most this part of the start's
while read -r optimiser part stage; do
    config "$optimiser" "$stage"
    fit "$optimiser" "$optimiser" || fail "fit $optimiser"
    at_most "$(residual)" "$(awk -v x="$start" -v p="$part" 'BEGIN { print x * p }')" ||
        fail "$optimiser: residual $(residual) from $start, expected at most $part of it"
done <<'LIST'
adam 0.9 {optimiser: adam, iterations: 30, batch: 16, rate: [1.0e-2, 1.0e-3], substeps: 1}
lbfgs 0.1 {optimiser: lbfgs, iterations: 60, substeps: 2}
gauss_newton 0.05 {optimiser: gauss_newton, iterations: 15, batch: 66, substeps: 2}
gauss_newton_cg 0.05 {optimiser: gauss_newton_cg, iterations: 15, batch: 66, substeps: 2}
LIST
[ -e "$folder/adam/fit.checkpoint" ] || fail "a finished fit left no checkpoint to go on from"

# --- weights say by what steps they were made, if by any ---
# say DIR COUNT TEXT: so many of the weights in a folder say TEXT
say() {
    "$portmetd" check "$folder/scene.yaml" --weights "$folder/$1" >"$folder/out" 2>"$folder/err" || fail "check $1"
    [ "$(grep -c "$3" "$folder/out")" -eq "$2" ] || fail "$1: expected \"$3\" $2 times"
}
config derivative '{optimiser: adam, iterations: 1, residual: derivative}'
fit derivative derivative || fail "fit derivative"
say lbfgs 3 'by steps of 0.15 s of rk4'
say derivative 0 'by steps of'

# --- a part that the scene knows stays as it is, and the others are learned beside it ---
sed -e "s|file: reference|file: $PWD/configs/reference|" configs/half_analytic_double_pendulum.yaml \
    >"$folder/half.yaml"
config twice '{optimiser: gauss_newton, iterations: 15, batch: 66, substeps: 2}'
sed -i 's|^scene: .*|scene: half.yaml|' "$folder/twice.yaml"
sed 's|^subsystems: .*|subsystems: {lower: link}|' "$folder/twice.yaml" >"$folder/half_known.yaml"
fit twice twice && fail "twice: a known part was given another model"
grep -q "twice.yaml:[0-9]*:21: upper: the scene itself has a model of upper" "$folder/err" ||
    fail "twice: expected the place of the second model"
fit half_known half_known || fail "fit half_known"
at_most "$(residual)" "$(awk -v x="$start" 'BEGIN { print x * 0.05 }')" ||
    fail "half_known: residual $(residual) from $start, expected at most 0.05 of it"
[ "$(cd "$folder/half_known" && echo *.h5)" = "base.h5 link.h5" ] || fail "half_known: other files"

# --- the same command, the same bits; interrupted and resumed too ---
# interrupt NAME DIR: SIGINT as soon as the fit has begun; once more if it was over before that.
interrupt() {
    code=0
    tries=0
    while [ $code -eq 0 ] && [ $tries -lt 20 ]; do
        tries=$((tries + 1))
        rm -rf "${folder:?}/$2"
        begin_and_interrupt "$1" "$2"
    done
    [ $code -eq 12 ] || fail "$1 interrupted: expected exit code 12, found $code"
    cp "$folder/err" "$folder/interrupted"
    grep -q -e "--resume" "$folder/err" || fail "$1 interrupted: expected --resume to be named"
    [ -e "$folder/$2/fit.checkpoint" ] || fail "$1 interrupted: no checkpoint"
    "$train" evaluate "$folder/scene.yaml" --weights "$folder/$2" --data "$data" --json \
        >"$folder/out" 2>"$folder/err"
    case $? in 0 | 10) ;; *) fail "$1 interrupted: weights that cannot be evaluated" ;; esac
}

# begin_and_interrupt NAME DIR: its exit code in $code.
begin_and_interrupt() {
    : >"$folder/out"
    "$train" fit "$folder/$1.yaml" --data "$data" -o "$folder/$2" >"$folder/out" 2>"$folder/err" \
        </dev/null &
    pid=$!
    looks=0
    while ! grep -q "weights, trajectories" "$folder/out" && [ $looks -lt 6000 ] &&
        kill -0 $pid 2>/dev/null; do
        looks=$((looks + 1))
        sleep 0.005
    done
    kill -INT $pid 2>/dev/null
    wait $pid
    code=$?
}

config slow_adam '{optimiser: adam, iterations: 4, batch: 16}' \
    "{optimiser: adam, iterations: $((40 / less)), batch: 8, rate: [3.0e-3, 1.0e-4], robust: 3}"
config slow_gauss_newton "{optimiser: gauss_newton, iterations: $((100 / less)), batch: 50, substeps: 2, robust: 3}"
config slow_lbfgs "{optimiser: lbfgs, iterations: $((250 / less)), substeps: 8}"
for name in slow_adam slow_gauss_newton slow_lbfgs; do
    fit $name $name || fail "fit $name"
    whole=$(residual)
    interrupt $name resumed_$name
    fit $name resumed_$name --resume || fail "fit $name --resume"
    if [ $name = slow_lbfgs ]; then # its memory starts anew
        at_most "$(residual)" "$(awk -v x="$whole" 'BEGIN { print 10 * x }')" ||
            fail "$name: residual $(residual) after resuming, $whole without interruption"
    else
        same_weights "$name resumed" $name resumed_$name
    fi
done
config again '{optimiser: gauss_newton, iterations: 15, batch: 66, substeps: 2}'
fit again again || fail "fit again"
same_weights "the same fit twice" gauss_newton again
# It may be interrupted while the initial weights are chosen, too.
config starting '{optimiser: gauss_newton, iterations: 2, batch: 50, substeps: 2}'
sed -i "1i start: {tries: $((6 + 4 / less))}" "$folder/starting.yaml"
fit starting starting || fail "fit starting"
interrupt starting resumed_starting
grep -q "while choosing the initial weights; continue with --resume" "$folder/interrupted" ||
    fail "starting: interrupted too late: $(cat "$folder/interrupted")"
fit starting resumed_starting --resume || fail "fit starting --resume"
same_weights "starting resumed" starting resumed_starting
# Two fits into one folder: the second one is refused.
if command -v flock >/dev/null; then
    mkdir "$folder/locked"
    flock "$folder/locked" "$train" fit "$folder/again.yaml" --data "$data" -o "$folder/locked" >"$folder/out" 2>"$folder/err"
    [ $? -eq 4 ] && grep -q "locked: another fit writes into this folder" "$folder/err" || fail "two fits into one folder"
fi
# A checkpoint of another training is refused.
interrupt slow_adam foreign
fit slow_gauss_newton foreign --resume && fail "a checkpoint of another training was taken"
grep -q "fit.checkpoint" "$folder/err" || fail "foreign checkpoint: expected its name"

# --- a fit tells the truth ---
sed -e 's/^trajectories: .*/trajectories: 10/' -e 's/^states: .*/states: 24/' -e 's/^seed: .*/seed: 5/' \
    configs/truth/double_pendulum.yaml >"$folder/truth.yaml"
"$train" truth "$folder/truth.yaml" -o "$folder/ten.h5" >"$folder/out" 2>"$folder/err" || fail "truth of ten"
# says TEXT: on standard output
says() {
    grep -qE -e "$1" "$folder/out" || fail "expected \"$1\""
}
three=$data
data=$folder/ten.h5
config honest '{optimiser: gauss_newton, iterations: 12, batch: 200, substeps: 2}'
fit honest honest || fail "fit honest"
[ $code -eq 0 ] || fail "honest: exit code $code"
says 'trajectories 0:4,5:9 of 24 states; validation on 4,9$'
says '^Verdict: (good|fair|poor)\. .*; the black box has [0-9.e+-]+ %\.$'
says '^Black box: .*, lag 1, a regression without structure'
says '^Entropy produced over a run, validation: '
says '^Laws: largest energy residual [0-9.]*e-1[0-9], steps in violation 0'
grep -qE '^1,gauss_newton,12,[0-9.]+,[0-9.e+-]+,[0-9.e+-]+$' "$folder/honest/fit.csv" ||
    fail "fit.csv: no validation at the end"
# Rollouts of what was just drawn are worse than a state that stays as it is.
config dishonest '{optimiser: adam, iterations: 1, rate: 1.0e-12}'
fit dishonest dishonest
[ $code -eq 13 ] || fail "dishonest: expected exit code 13, found $code"
says '^Verdict: UNFIT\.'
[ "$(wc -l <"$folder/err")" -eq 1 ] || fail "dishonest: expected one line"
# The weights say so wherever they are used.
"$portmetd" check "$folder/scene.yaml" --weights "$folder/dishonest" >"$folder/out" 2>"$folder/err"
says "the fit's verdict: UNFIT: on the validation part"
says 'of the system [a-z]'
"$portmetd" run "$folder/scene.yaml" --in-process --steps 2 --weights "$folder/dishonest" \
    >"$folder/err" 2>"$folder/out"
says 'the verdict on the fit of .*/dishonest/[a-z]*\.h5: UNFIT: on the validation part'
"$portmetd" check "$folder/scene.yaml" --weights "$folder/honest" >"$folder/out" 2>"$folder/err"
says "the fit's verdict: (good|fair|poor)"
# The best weights are kept, not the last: a stage that ruins them is of no account.
config ruined '{optimiser: gauss_newton, iterations: 12, batch: 200, substeps: 2}' \
    '{optimiser: adam, iterations: 2, batch: 8, rate: 3.0, substeps: 1}'
fit ruined ruined || fail "fit ruined"
says 'those of stage 1 after'
[ $code -eq 0 ] || fail "ruined: exit code $code"
# A stage whose loss is not finite ends, and the fit goes on from the best weights.
config broken '{optimiser: gauss_newton, iterations: 12, batch: 200, substeps: 2}' \
    '{optimiser: adam, iterations: 2, batch: 8, rate: 1.0e+300, substeps: 1}'
fit broken broken || fail "fit broken"
says '^stage 2/2 ends after .* goes on from the best weights\.'
says 'those of stage 1 after'
[ $code -eq 0 ] || fail "broken: exit code $code"
# Conduction that is too fast for the substeps: the first loss is not finite, and more substeps are taken.
sed '/^seed/,$d' "$folder/base.yaml" >"$folder/stiff.yaml"
cat >>"$folder/stiff.yaml" <<'END'
models:
  link:
    form: hard
    constants: {m: {learned: 1.0, positive: true}, C: 0.1, b: 0.0869, c: 5.08, Tr: 300.0}
    energy:
      - "|p|^2/(2*m)"
      - "C/2*ln(|q|)^2 + b*Tr*ln(|q|)"
      - "c*Tr*(exp((s - b*ln(|q|))/c) - 1)"
    entropy: {given: s}
    reversible: {given: [[q, p, 1.0]]}
  joint:
    law: bracket
    form: hard
    constants: {K: 3000.0}
    reversible: {given: [[a.p, b.q, 1.0]]}
    irreversible: {given: [[a.s, b.s, "K*b.dE.s/a.dE.s"]]}
subsystems: {upper: link, lower: link}
ports: {joint: joint}
loss: {residual: step}
stages:
  - {optimiser: gauss_newton, iterations: 2, batch: 50, substeps: 4}
END
if [ "$short" != short ]; then
    fit stiff stiff
    says '^stage 1/1: .*The stage begins again with 8 substeps\.'
    says 'begins again with 128 substeps\.'
    says '^stage 1/1 gauss_newton *2 iterations'
fi
# Learned constants are printed in their own unit, though weights files hold logarithms of positive ones.
sed 's/K: 3000.0/K: {learned: 0.01, positive: true}/' "$folder/stiff.yaml" >"$folder/constants.yaml"
fit constants constants
says '^Learned constants:'
says '^  upper\.m = [0-9.]+$'
says '^  joint\.K = [0-9.e-]+$'
# A bad start makes it draw other initial weights, and bad rollouts make it begin again: at most three draws.
config unlucky '{optimiser: adam, iterations: 1, rate: 1.0e-12}'
sed -i -e '/^defaults: plain/d' -e 's/\[a.p, b.q, 1.0\]/[a.p, b.q, 0.5]/' -e '$a start: {tries: 2, iterations: 1}' "$folder/unlucky.yaml"
fit unlucky unlucky || fail "fit unlucky"
[ "$(grep -c '^this start is bad: ' "$folder/out")" -eq 1 ] || fail "unlucky: expected a further draw"
[ "$(grep -c '^rollouts on the validation part are bad: ' "$folder/out")" -eq 1 ] || fail "unlucky"
[ "$(grep -c '^stage 1/1 ' "$folder/out")" -eq 2 ] || fail "unlucky: expected two attempts"
# Longer stages go on where shorter ones ended.
config longer '{optimiser: gauss_newton, iterations: 20, batch: 200, substeps: 2}'
cp -r "$folder/honest" "$folder/longer"
fit longer longer --resume || fail "longer --resume"
says '^resumes stage 1 after 12 iterations'
if [ "$short" != short ]; then
    fit longer at_once || fail "fit longer"
    same_weights "longer" longer at_once
fi
# Weights know what they were trained on; validation kept none back here.
fit honest all --validation none || fail "--validation none"
says '; no validation$'
evaluate() {
    "$train" evaluate "$folder/scene.yaml" --data "$1" --weights "$folder/$2" >"$folder/out" 2>"$folder/err"
}
evaluate "$data" all && says '^10 of these 10 trajectories are ones that the weights were trained or validated on'
evaluate "$three" all && says '^unseen: the weights were trained on none of these 3 trajectories'
fit honest some --trajectories 0:5 || fail "--trajectories 0:5"
evaluate "$data" some && says '^5 trajectories that the weights were trained or validated on are left out'
says '^Groups of one name in several subsystems are one row'
# Exchanged weights, and a position that is no longer measured from its neighbour.
mkdir "$folder/exchanged"
cp "$folder/honest/joint.h5" "$folder/exchanged"
cp "$folder/honest/upper.h5" "$folder/exchanged/lower.h5"
cp "$folder/honest/lower.h5" "$folder/exchanged/upper.h5"
evaluate "$data" exchanged
[ $? -eq 6 ] || fail "exchanged weights were taken"
grep -q 'subsystem upper: the weights .* were trained on the columns of subsystem lower' "$folder/err" ||
    fail "exchanged: expected the columns"
# A file of another fit in the place of one of this fit, and data in another unit.
cp -r "$folder/honest" "$folder/mixed"
cp "$folder/some/upper.h5" "$folder/mixed"
evaluate "$data" mixed
[ $? -eq 6 ] && grep -q 'lower.h5 were not learned together with .*mixed/upper.h5: a file of another fit' "$folder/err" ||
    fail "mixed: $(cat "$folder/err")"
"$portmetd" test "$folder/scene.yaml" --weights "$folder/mixed" >"$folder/out" 2>"$folder/err"
[ $? -eq 6 ] && grep -q 'a file of another fit' "$folder/err" || fail "a test of a port whose ends are of two fits"
if /usr/bin/python3 -c 'import h5py' 2>/dev/null; then
    /usr/bin/python3 - "$data" "$folder/milli.h5" <<'END'
import h5py, shutil, sys
shutil.copy(*sys.argv[1:])
with h5py.File(sys.argv[2], "r+") as f:
    f.attrs.pop("units", None)
    f["z"][:] = 1000*f["z"][:]
END
    evaluate "$folder/milli.h5" honest
    [ $? -eq 5 ] && grep -q 'milli.h5: .* were trained on .*: are they of another system, or is the unit another' "$folder/err" ||
        fail "milli: $(cat "$folder/err")"
fi
cp "$folder/scene.yaml" "$folder/kept.yaml"
sed -i 's/, relative_to: upper.q}/}/' "$folder/scene.yaml"
evaluate "$data" honest
[ $? -eq 6 ] || fail "a lost relative_to was not noticed"
grep -q 'subsystem lower: the weights .* relative_to for "q", the scene has relative_to for ""' "$folder/err" ||
    fail "lost: expected relative_to"
mv "$folder/kept.yaml" "$folder/scene.yaml"

# --- no coefficient of L is known: the scale of all energies and temperatures is free ---
cat >"$folder/scaled.yaml" <<'END'
scene: scene.yaml
data: {validation: none}
start: {tries: 1}
models:
  link:
    energy:
      - {features: ["|p|^2"], skip: linear}
      - {features: ["ln|q|"], thermal: [s], exponentials: 1, skip: quadratic}
    entropy: {given: s}
    reversible: {learned: {acts_on: [q], against: [p]}}
  joint:
    law: bracket
    reversible: {learned: {acts_on: [a.p], against: [b.q]}}
    irreversible: {learned: {acts_on: [a.s, b.s]}}
subsystems: {upper: link, lower: link}
ports: {joint: joint}
stages: [{optimiser: gauss_newton, iterations: 2, batch: 50, substeps: 4}]
END
fit scaled scaled
grep -q "temperatures are hardly determined" "$folder/out" || fail "fit: expected the scale of energy to be free"
grep -q "scale of energies and powers is then not fixed either.*\`temperature:\`" "$folder/out" ||
    fail "fit: expected how to set the scale"
grep -q "do not need" "$folder/out" && fail "fit: the joint needs its coupling"
sed 's/learned: {acts_on: \[q\], against: \[p\]}/given: [[q, p, 1.0]]/' "$folder/scaled.yaml" >"$folder/known.yaml"
fit known known
grep -q "temperatures: all higher" "$folder/out" || fail "fit: expected a line about temperatures"
grep -q "temperatures are hardly determined" "$folder/out" && fail "fit: the given pair fixes the scale of energy"
# A coupling that the motion does not have is named.
sed -e 's/learned: {acts_on: \[a.p\], against: \[b.q\]}/given: [[a.p, b.q, 1.0]], learned: {acts_on: [a.p], against: [a.s, b.s]}/' \
    -e 's/iterations: 2/iterations: 40/' "$folder/known.yaml" >"$folder/needless.yaml"
if [ "$short" != short ]; then
    fit needless needless || fail "fit needless"
    grep -q "joint: the data do not need its learned reversible coupling" "$folder/out" || fail "fit: expected a needless coupling"
fi

# --- what is not examined is said ---
sed -e 's/exponentials: 1,/exponentials: 1, hidden: [24, 24],/' -e 's/iterations: 2, batch: 50/iterations: 1, batch: 5/' \
    "$folder/known.yaml" >"$folder/large.yaml"
fit large large
grep -q "flat directions: not examined, since .* weights are more than 500" "$folder/out" ||
    fail "fit: expected a word on what was not examined"
sed -e 's/^trajectories: .*/trajectories: 4/' -e 's/^states: .*/states: 20/' "$PWD/configs/truth/driven_lower.yaml" \
    >"$folder/driven_truth.yaml"
"$train" truth "$folder/driven_truth.yaml" -o "$folder/driven.h5" >"$folder/out" 2>"$folder/err" || fail "truth of a driven link"
sed -e "s|^scene: \.\./|scene: $PWD/configs/|" -e 's/iterations: [0-9]*/iterations: 1/' -e '/^data:/d' \
    "$PWD/configs/train/driven_lower.yaml" >"$folder/driven.yaml"
"$train" fit "$folder/driven.yaml" --data "$folder/driven.h5" -o "$folder/driven" >"$folder/out" 2>"$folder/err"
grep -q "Errors of one step are not measured where boundary inputs act" "$folder/out" ||
    fail "fit: expected a word on errors of one step"

# --- a scene alone: propose, and a black box beside ---
"$train" propose "$folder/scene.yaml" --data "$data" -o "$folder/proposed.yaml" --budget 0 >"$folder/out" 2>"$folder/err" ||
    fail propose
for text in 'reversible:' 'given: \[\[q, p, 1.0\]\]' 'given: \[\[a.p, b.q, 1.0\]\]' 'stages:'; do
    grep -q -e "$text" "$folder/proposed.yaml" || fail "proposed.yaml: expected $text"
done
PORTMET_PROGRESS=1 "$train" propose "$folder/scene.yaml" --data "$data" -o "$folder/tried.yaml" --budget 1 >"$folder/out" 2>"$folder/err" ||
    fail "propose --budget 1"
grep -q 'proposal, s \[' "$folder/err" || fail "propose: expected a bar of progress"
"$train" propose "$folder/scene.yaml" --data "$data" -o "$folder/box.yaml" --form free >"$folder/out" 2>"$folder/err" ||
    fail "propose --form free"
grep -q 'upper_q: {unit: "m", columns: \["q1x", "q1y"\]}' "$folder/box_scene.yaml" ||
    fail "box_scene.yaml: expected one subsystem with all groups"
"$train" propose "$folder/scene.yaml" --data "$data" -o "$folder/soft.yaml" --form soft --budget 0 >"$folder/out" 2>"$folder/err" ||
    fail "propose --form soft"
for text in 'form: soft' 'law: bracket' 'hidden: \[8\], skip: linear'; do
    grep -q -e "$text" "$folder/soft.yaml" || fail "soft.yaml: expected $text"
done
timeout 1200 "$train" fit "$folder/honest.yaml" --data "$data" -o "$folder/beside" --black-box --seed 5 \
    >"$folder/out" 2>"$folder/err" || fail "fit --black-box"
says '^Verdict: .*; the black box has [0-9.e+-]+ %\.$'
grep -q '^Black box: ' "$folder/out" && fail "--black-box: a regression was trained as well"
[ "$(grep -n 'Best weights' "$folder/out" | head -n 1 | cut -d: -f1)" -lt \
    "$(grep -n 'A black box for comparison' "$folder/out" | cut -d: -f1)" ] ||
    fail "--black-box: the best weights are named behind the black box"
[ -s "$folder/beside/black_box/training.yaml" ] || fail "--black-box: no training file"
for box in "$folder"/beside/black_box/*.h5; do
    h5dump -a /seed "$box" | grep -q '(0): 5$' || fail "--black-box: $box does not have the seed 5 of --seed"
done
data=$three

# --- an energy becomes thermal by the defaults, from the temperature that it names; another seed ---
config warm '{optimiser: gauss_newton, iterations: 1, batch: 64, residual: derivative}'
sed -i '/^defaults/s/.*/start: {tries: 1}/; /given: {s: 300.0}/d; s/skip: quadratic}/skip: quadratic, temperature: 290.0}/' \
    "$folder/warm.yaml"
for seed in 1 2; do
    "$train" fit "$folder/warm.yaml" --data "$data" -o "$folder/warm$seed" --seed $seed >"$folder/out" 2>"$folder/err"
    code=$?
    [ $code -eq 0 ] || [ $code -eq 13 ] || fail "temperature without thermal, seed $seed"
done
grep -qa 'thermal: \["\{0,1\}s"\{0,1\}\], exponentials: 2, temperature: 290' "$folder/warm1/upper.h5" ||
    fail "expected a thermal energy of 290 K"
cmp -s "$folder/warm1/upper.h5" "$folder/warm2/upper.h5" && fail "--seed has no effect"

# --- bad training files: file, line, column ---
# bad LINE:COLUMN TEXT SED-EXPRESSION
bad() {
    sed "$3" "$folder/adam.yaml" >"$folder/bad.yaml"
    "$train" fit "$folder/bad.yaml" --data "$data" -o "$folder/bad" >"$folder/out" 2>"$folder/err"
    found=$?
    [ $found -eq 3 ] || fail "$3: expected exit code 3, found $found"
    [ "$(wc -l <"$folder/err")" -eq 1 ] || fail "$3: expected one line"
    grep -qE "bad.yaml:$1: .*$2" "$folder/err" || fail "$3: expected bad.yaml:$1: and \"$2\""
    [ ! -e "$folder/bad" ] || fail "$3: left a folder"
}
stage=$(grep -n 'optimiser' "$folder/adam.yaml" | cut -d: -f1)
link=$(grep -n '^  link:' "$folder/adam.yaml" | cut -d: -f1)
bad "$stage:17" 'adam, lbfgs, gauss_newton|expected one of' 's/optimiser: adam/optimiser: sgd/'
bad "$stage:[0-9]*" iterations 's/iterations: 30/iterations: 0/'
bad "$stage:[0-9]*" rate 's/rate: \[1.0e-2, 1.0e-3\]/rate: [-1]/'
bad "$stage:[0-9]*" wrong 's/batch: 16/wrong: 16/'
parts=$(grep -n '^subsystems:' "$folder/adam.yaml" | cut -d: -f1)
energy=$(grep -n '^    energy:' "$folder/adam.yaml" | cut -d: -f1)
joint=$(grep -n '^  joint:' "$folder/adam.yaml" | cut -d: -f1)
features=$(grep -n '"ln|q|", s' "$folder/adam.yaml" | cut -d: -f1)
bad "$parts:21" 'there is no model "spring"' 's/upper: link/upper: spring/'
bad "$parts:14" 'no subsystem "middle"' 's/{upper: link/{middle: link, upper: link/'
bad "$features:20" '"v".* \(model of upper\)' 's/"ln|q|", s/"ln|v|", s/'
bad "$features:20" 'feature "\|w\|\^2"' 's/\["ln|q|", s\]/["|w|^2"]/'
bad "$((energy + 1)):7" '"w"' 's/{given: {s: 300.0}}/{given: {w: 300.0}}/'
bad "$((link + 7)):17" 'given pair \[q, v\]' 's/\[\[q, p, 1.0\]\]/[[q, v, 1.0]]/'
bad "$((link + 1)):5" 'form: free has a rate and nothing else' \
    "$((link + 1))s/form: hard/form: free\n    rate: {features: [q, p, s]}/"
bad "$((joint + 1)):5" 'law exchange.*joint' 's/law: bracket/law: exchange/'
bad "$((joint + 1)):5" 'bracket cannot be free.* \(model of joint\)' \
    "$((joint + 2))s/form: hard/form: free\n    rate: {}/"
bad "1:22" 'trajectories "0:400": expected A:B with 0 <= A < B <= 3' \
    '1s/^/data: {trajectories: "0:400"}\n/'

# bad_file LINE:COLUMN FILE SED-EXPRESSION: a file that the training file names is missing
bad_file() {
    sed "$3" "$folder/adam.yaml" >"$folder/bad.yaml"
    "$train" fit "$folder/bad.yaml" -o "$folder/bad" >"$folder/out" 2>"$folder/err"
    found=$?
    [ $found -eq 4 ] || fail "$3: expected exit code 4, found $found"
    [ "$(wc -l <"$folder/err")" -eq 1 ] || fail "$3: expected one line"
    grep -qF "bad.yaml:$1: $folder/$2: " "$folder/err" || fail "$3: expected bad.yaml:$1 and $2"
}
bad_file 1:14 nowhere.h5 '1s/^/data: {file: nowhere.h5}\n/'
bad_file "$(grep -n '^scene:' "$folder/adam.yaml" | cut -d: -f1):8" middle.yaml \
    's/^scene: scene.yaml/scene: middle.yaml/'
# On the command line the same range is a usage error.
fit adam bad --trajectories 0:400
[ $code -eq 2 ] || fail "--trajectories 0:400: expected exit code 2"

[ $failures -eq 0 ] && echo "all well"
exit $((failures > 0))
