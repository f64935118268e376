#!/bin/sh
# test_mesh.sh PORTMETD MAKE_SCENE SAME_RECORDING PORTMET_TRAIN: two bodies that are networks on a mesh,
# one of them with a boundary input, run over LCM with the bits of a single process.
. "$(dirname "$0")/network.sh"
train=$4
configs=$(dirname "$0")/../../configs

# does ARGUMENT...: a command of the trainer.
does() {
    "$train" "$@" >"$folder/train.out" 2>"$folder/train.err" </dev/null || fail "portmet-train $*"
}

sed 's/elements: .*/elements: [3, 1, 1]/; s/states: .*/states: 5/' "$configs/truth/beam.yaml" >"$folder/truth.yaml"
does truth "$folder/truth.yaml" -o "$folder/beam.h5" --trajectories 0:1
does nodes "$folder/beam.h5" --relaxation 0.1,0.2,0.4 -o "$folder/nodes.h5"

cat >"$folder/mesh.yaml" <<EOF
scene: mesh
time: {dt: 0.05, steps: 4, integrator: heun, substeps: 2}
subsystems:
  left:
    weights: weights/left.h5
    state: {u: {unit: m, columns: "m0_[0:36]"}, m: {unit: m, columns: "m1_[0:36]"}}
  right:
    weights: weights/right.h5
    state: {u: {unit: m, columns: "u[0:36]"}, m: {unit: m, columns: "m2_[0:36]"}, s: {unit: J/K, columns: [s]}}
boundary_inputs:
  hand: {f: {unit: m, dE: "f[0:36]"}}
ports:
  joint: {law: exchange, between: [left, right], expose: {left: [u, m], right: [u]}, weights: weights/joint.h5}
  grip: {law: exchange, between: [right, hand], expose: {right: [u], hand: [f]}, weights: weights/grip.h5}
reference: {file: nodes.h5, trajectory: 0}
EOF
mesh='mesh: {size: [40, 10, 10], elements: [3, 1, 1]}'
cat >"$folder/train.yaml" <<EOF
scene: mesh.yaml
seed: 1
models:
  elastic:
    $mesh
    energy: ["|u|^2/2 + |m|^2/2", {nodes: [u, m], width: 4, passes: 1, patterns: 2, hidden: [3]}]
    reversible: {learned: {acts_on: [u, m], nodes: [u], width: 3, passes: 1}}
  viscous:
    $mesh
    energy: [{given: {s: 300.0}}, "|u|^2/2", {nodes: [u, m], width: 4, passes: 1, patterns: 2, hidden: [3]}]
    entropy: {given: s}
    reversible: {learned: {acts_on: [u, m], nodes: [u], width: 3, passes: 1}}
    irreversible: {given: [[u, s, 10.0]], learned: {acts_on: [u, m], rank: 2, nodes: [m], width: 3, passes: 1}}
  joint:
    law: exchange
    form: free
    $mesh
    rate: {nodes: [own.u], driven_by: other.dE.u, width: 4, passes: 1, patterns: 2}
  grip:
    law: exchange
    form: free
    $mesh
    rate: {nodes: [own.u], driven_by: other.dE.f, width: 4, passes: 2, patterns: 2, hidden: [3], within: 0.05}
subsystems: {left: elastic, right: viscous}
ports: {joint: joint, grip: grip}
loss: {residual: step}
stages: [{optimiser: adam, iterations: 1, batch: 4, rate: 1.0e-3}]
EOF
# One iteration makes weights, though not good ones: the exit code 13 says so.
"$train" fit "$folder/train.yaml" --data "$folder/nodes.h5" -o "$folder/weights" >"$folder/fit.out" 2>&1
code=$?
[ $code -eq 0 ] || [ $code -eq 13 ] || fail "fit: exit code $code: $(cat "$folder/fit.out")"

"$portmetd" run "$folder/mesh.yaml" --in-process --quiet --record "$folder/plain.h5" || fail "in process"
start run run "$folder/mesh.yaml" --quiet --record "$folder/lcm.h5"
ends run $pid 0 ""
"$same_recording" "$folder/plain.h5" "$folder/lcm.h5" || fail "other bits over LCM"
no_orphans "at the end"
finish
