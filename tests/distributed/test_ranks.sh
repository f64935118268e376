#!/bin/sh
# test_ranks.sh PORTMETD MAKE_SCENE SAME_RECORDING PORTMET_TRAIN: a training on 1, 2 and 4 ranks gives the same bits
# of weights, with every optimiser and with the choice of first weights, also when it is resumed on another number of
# ranks; rank 0 alone prints and writes. What does not work with ranks is an error.
if ! command -v mpirun >/dev/null; then
    echo "skipped: mpirun is missing (openmpi-bin)"
    exit 77
fi
. "$(dirname "$0")/network.sh"
train=$4
configs=$(realpath "$(dirname "$0")/../../configs")
# Open MPI refuses root, and more ranks than cores, unless it is told otherwise.
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1

# ranks COUNT DIR NAME ARGUMENT...: a fit by the training file NAME into DIR; its exit code in $code.
ranks() {
    count=$1 out=$2 name=$3
    shift 3
    timeout 500 mpirun -n "$count" "$train" fit "$folder/$name.yaml" --data "$folder/data.h5" -o "$folder/$out" \
        "$@" >"$folder/$out.out" 2>"$folder/$out.err" </dev/null
    code=$?
}

# trained DIR: the fit has ended well, or with weights that are not good yet.
trained() {
    [ $code -eq 0 ] || [ $code -eq 13 ] || fail "$1: exit code $code: $(cat "$folder/$1.out" "$folder/$1.err")"
    [ "$(grep -c '^wrote .*upper.h5' "$folder/$1.out")" -eq 1 ] || fail "$1: expected one rank to print"
}

# digests DIR
digests() {
    "$portmetd" check "$folder/scene.yaml" --weights "$folder/$1" | sed -n 's/.* numbers, digest \(.*\)/\1/p'
}

# same DIR DIR
same() {
    [ "$(digests "$1" | wc -w)" -eq 3 ] && [ "$(digests "$1")" = "$(digests "$2")" ] ||
        fail "$2: other weights than $1:" "$(digests "$1")" "$(digests "$2")"
}

sed -e 's/^trajectories: .*/trajectories: 3/' -e 's/^states: .*/states: 40/' \
    "$configs/truth/double_pendulum.yaml" >"$folder/truth.yaml"
"$train" truth "$folder/truth.yaml" -o "$folder/data.h5" >/dev/null || fail truth
sed "s|file: reference|file: $configs/reference|" "$configs/double_pendulum.yaml" >"$folder/scene.yaml"
cat >"$folder/all.yaml" <<'END'
scene: scene.yaml
seed: 1
start: {tries: 3, iterations: 2}
models:
  link:
    form: hard
    energy:
      - {given: {s: 300.0}}
      - {features: ["|p|^2"], skip: linear}
      - {features: ["ln|q|", s], hidden: [8], skip: quadratic}
    entropy: {given: s}
    reversible: {given: [[q, p, 1.0]]}
  joint:
    law: bracket
    form: hard
    reversible: {given: [[a.p, b.q, 1.0]]}
    irreversible: {learned: {acts_on: [a.s, b.s], rank: 1}}
subsystems: {upper: link, lower: link}
ports: {joint: joint}
loss: {residual: step, robust: 3, substeps: 1}
stages:
  - {optimiser: adam, iterations: 2, batch: 16, rate: [1.0e-2, 1.0e-3]}
  - {optimiser: lbfgs, iterations: 4}
  - {optimiser: gauss_newton, iterations: 3, batch: 64}
  - {optimiser: gauss_newton_cg, iterations: 3, batch: 64}
END
ranks 1 one all
if grep -q "was built without MPI" "$folder/one.err"; then
    echo "skipped: portmet-train is built without MPI"
    exit 77
fi
trained one
for count in 2 4; do
    ranks $count "by$count" all
    trained "by$count"
    same one "by$count"
done

# Another seed gives other weights, so that the comparison above can fail.
ranks 2 other all --seed 2
trained other
[ "$(digests one)" != "$(digests other)" ] || fail "another seed gives the same weights"

# Half of it on two ranks, and the rest on four.
sed '/gauss_newton/d' "$folder/all.yaml" >"$folder/half.yaml"
ranks 2 resumed half
trained resumed
cp "$folder/all.yaml" "$folder/half.yaml"
ranks 4 resumed half --resume
trained resumed
same one resumed

ranks 3 three all
[ $code -eq 2 ] && grep -q 'expected 1, 2, 4 or 8 ranks (mpirun -n), found 3' "$folder/three.err" || fail "three: exit code $code"
ranks 2 box all --black-box
[ $code -eq 2 ] && [ "$(grep -c '^portmet-train: --black-box' "$folder/box.err")" -eq 1 ] || fail "box: exit code $code"
finish
