#!/bin/sh
# test_fit_coenergies.sh PORTMET_TRAIN PORTMETD: a fit to what sensors show, the angle, the velocity and the
# temperature of a pendulum that its friction heats, finds the heat of the friction and both laws hold.
. "$(dirname "$0")/../support/setting.sh"
train=$1
portmetd=$2

# The truth: mass and length are 1, the friction is 0.4, the heat capacity is 0.2 + 0.002 T/K J/K.
for run in 0 1 2 3 4 5; do
    awk -v run=$run "$(cat "$(dirname "$0")/../support/runge_kutta.awk")"'
        function rates(y, d) {
            d[1] = y[2]
            d[2] = -9.81 * sin(y[1]) - 0.4 * y[2]
            d[3] = 0.4 * y[2] * y[2] / (0.2 + 0.002 * y[3])
        }
        BEGIN {
            z[1] = 0.4 * run - 1; z[2] = 2 - 0.7 * run; z[3] = 280 + 7 * run
            print "t [s],q [rad],v [rad/s],T [K]"
            for (n = 0; n <= 100; ++n) {
                printf "%.17g,%.17g,%.17g,%.17g\n", 0.05 * n, z[1], z[2], z[3]
                for (k = 0; k < 10; ++k) advance(3, 0.005)
            }
        }' >"$folder/run_$run.csv"
done
cat >"$folder/scene.yaml" <<'END'
scene: pendulum
time: {dt: 0.05, steps: 100, integrator: rk4, substeps: 4}
subsystems:
  arm:
    weights: weights/arm.h5
    state:
      q: {unit: rad, columns: [q]}
      v: {unit: rad/s, coenergy: true, columns: [v]}
      T: {unit: K, coenergy: true, columns: [T]}
reference: {file: data.h5, trajectory: 4}
END
cat >"$folder/training.yaml" <<'END'
scene: scene.yaml
models:
  arm:
    coenergy: ["v^2/2", {capacity: {of: T, terms: 2}}]
    energy: {features: ["sin(q)", "cos(q)"], skip: linear}
    entropy: {given: T}
    reversible: {given: [[q, v, 1.0]]}
    irreversible: {learned: {acts_on: [v, T]}}
subsystems: {arm: arm}
start: {tries: 2}
END
"$train" import "$folder"/run_*.csv -o "$folder/data.h5" >"$folder/out" 2>"$folder/err" || fail "import"
"$train" fit "$folder/training.yaml" --data "$folder/data.h5" -o "$folder/weights" >"$folder/out" 2>"$folder/err" ||
    fail "fit"
# Run from the start of the trajectory that the fit did not see, the model stays within 0.001 %.
"$portmetd" run "$folder/scene.yaml" --in-process >"$folder/out" 2>"$folder/err" || fail "run"
awk '$3 == "%" { n++; if (!($2 <= 1e-3)) bad = 1 } END { exit n != 3 || bad }' "$folder/out" || fail "errors"
grep -q "steps in violation: 0;" "$folder/out" || fail "a law is violated"
"$train" evaluate "$folder/scene.yaml" --weights "$folder/weights" --data "$folder/data.h5" --trajectories 4:5 \
    >"$folder/out" 2>"$folder/err" || fail "evaluate"
awk '$1 == "production" { n++; if (!($4 <= 1e-3)) bad = 1 } END { exit n != 1 || bad }' "$folder/out" ||
    fail "entropy production"
grep -q "Temperatures at true states: 308 to 310" "$folder/out" || fail "temperatures"

# An integrator that cannot step co-energies is refused where it is named.
program=$train
sed '$a loss: {integrator: discrete_gradient}' "$folder/training.yaml" >"$folder/discrete.yaml"
expect 3 "discrete.yaml:11:20: integrator discrete_gradient cannot step co-energies" fit "$folder/discrete.yaml" \
    --data "$folder/data.h5" -o "$folder/none"
expect 3 "arm.v holds a co-energy" propose "$folder/scene.yaml" --data "$folder/data.h5" -o "$folder/proposed.yaml"
finish
