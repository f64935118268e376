#!/bin/sh
# test_fit_sensitive.sh PORTMET_TRAIN: a fit that is told to begin with whole trajectories begins with short
# windows where trajectories depart too fast from each other, and its windows need not reach the end of a
# trajectory to show that they are one solution.
. "$(dirname "$0")/../support/setting.sh"
train=$1

# A pendulum under a torque that is held, over the top now and then: g/l is 9.81, the friction 0.05, sensors have
# noise.
for run in 0 1 2 3 4 5 6 7 8 9 10 11; do
    awk -v run=$run "$(cat "$(dirname "$0")/../support/runge_kutta.awk")"'
        function rates(y, d) {
            d[1] = y[2]
            d[2] = -9.81 * sin(y[1]) - 0.05 * y[2] + F
        }
        function draw() {
            seed = seed * 16807 % 2147483647
            return seed / 2147483647 - 0.5
        }
        BEGIN {
            seed = 100 + 7919 * run
            for (i = 0; i < 10; ++i) draw()
            z[1] = 4 * draw(); z[2] = 10 * draw()
            print "t [s],q [rad],v [rad/s],F [N*m]"
            for (n = 0; n <= 500; ++n) {
                F = n % 10 == 0 ? 20 * draw() : F
                printf "%.17g,%.17g,%.17g,%.17g\n", 0.05 * n, z[1] + 0.03 * draw(), z[2] + 0.06 * draw(), F
                for (k = 0; k < 10; ++k) advance(2, 0.005)
            }
        }' >"$folder/run_$run.csv"
done
cat >"$folder/scene.yaml" <<'END'
scene: over_the_top
time: {dt: 0.05, steps: 500, integrator: rk4, substeps: 4}
subsystems:
  arm:
    weights: weights/arm.h5
    state:
      q: {unit: rad, columns: [q]}
      v: {unit: rad/s, coenergy: true, columns: [v]}
boundary_inputs:
  surroundings: {s: {unit: J/K, dE: [293.15], dS: [1]}}
  motor: {x: {unit: rad, dE: [F], hold: previous}}
ports:
  bearing: {law: bracket, between: [arm, surroundings], expose: {arm: [v], surroundings: [s]}, weights: weights/bearing.h5}
  torque: {law: bracket, between: [arm, motor], expose: {arm: [v], motor: [x]}, weights: weights/torque.h5}
reference: {file: data.h5, trajectory: 0}
END
cat >"$folder/training.yaml" <<'END'
scene: scene.yaml
noise: estimated
models:
  arm:
    constants: {weight: {learned: 9.4, positive: true}}
    coenergy: ["v^2/2"]
    energy: ["-weight*cos(q)"]
    reversible: {given: [[q, v, 1.0]]}
  bearing:
    constants: {friction: {learned: 0.08, positive: true}}
    law: bracket
    irreversible: {given: [[a.v, b.s, "friction*b.dE.s"]]}
  torque:
    law: bracket
    reversible: {given: [[a.v, b.x, 1.0]]}
subsystems: {arm: arm}
ports: {bearing: bearing, torque: torque}
start: {tries: 2, whole: true}
END
"$train" import "$folder"/run_?.csv "$folder"/run_??.csv -o "$folder/data.h5" >"$folder/out" 2>"$folder/err" ||
    fail "import"
"$train" fit "$folder/training.yaml" --data "$folder/data.h5" -o "$folder/weights" >"$folder/out" 2>"$folder/err" ||
    fail "fit"
# A fit to whole trajectories ends at 9.4, where it began.
awk '$1 == "arm.weight" { n += $3 > 9.80 && $3 < 9.82 }
     $1 == "bearing.friction" { n += $3 > 0.0499 && $3 < 0.0501 }
     END { exit n != 2 }' "$folder/out" || fail "constants"
grep -q "stopped at windows" "$folder/out" && fail "windows whose gaps are closed count as short"
finish
