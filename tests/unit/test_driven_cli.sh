#!/bin/sh
# test_driven_cli.sh PORTMET_TRAIN PORTMETD: each way in which something acts from outside, from tables to a served run. A
# force, a voltage, a heater, a flow, the air and a valve, held between samples or not; and a voltage whose steps come
# at times of their own, with a hidden state and a measured voltage that depends on the input.
. "$(dirname "$0")/../support/setting.sh"
train=$1 portmetd=$2 program=$1
PATH=$(dirname "$train"):$PATH # where portmetd looks for the program that estimates starts

# Runs a scene in one process and, where a private network can be made, over LCM: the same numbers.
both_ways() {
    program=$portmetd succeed "in one process" run "$1" --weights "$2" --in-process --record "$folder/one.h5"
    cp "$folder/out" "$folder/one"
    if [ "$(id -u)" = 0 ] && unshare -n sh daemon/loopback.sh true 2>/dev/null; then
        unshare -n sh daemon/loopback.sh "$portmetd" run "$1" --weights "$2" --record "$folder/many.h5" >"$folder/many" 2>&1 ||
            fail "run over LCM: $(cat "$folder/many")"
        grep -E "^  [a-z]+ +[a-z]+ +[-+]|^  (energy|entropy), " "$folder/one" >"$folder/one.fluxes"
        grep -E "^  [a-z]+ +[a-z]+ +[-+]|^  (energy|entropy), " "$folder/many" | cmp - "$folder/one.fluxes" ||
            fail "a run over LCM has other fluxes than one process"
        [ -s "$folder/one.fluxes" ] || fail "no fluxes were printed"
    fi
}

# --- six inputs, states at even times ---

cat >"$folder/drive.awk" <<'END'
function rate(z, d) {
    d[1] = z[2]/2; d[2] = -3*z[1] + F - 0.4*z[2]/2
    d[3] = U - 1.5*z[3]/0.5
    T = 300*exp(z[4]/50); d[4] = (P + 2*(Ta - T))/T
    d[5] = Q - 0.3*u*z[5]
}
BEGIN {
    srand(seed); n = 5; dt = 0.05; fine = 4
    for (c = 1; c <= n; c++) z[c] = 2*rand() - 1
    z[4] = 3*rand(); z[5] = 1 + rand()
    print "t,q,p,phi,s,V,F,U,P,Ta,Q,u"
    for (i = 0; i < 40 + (seed == 7 ? -8 : 0); i++) {
        if (i % 5 == 0) { F = 4*rand() - 2; U = 2*rand() - 1; P = 200*rand() }
        if (i % 7 == 0) { Q = rand(); u = 0.5 + rand() }
        Ta = 290 + 10*sin(0.3*i*dt)
        printf "%.10g,%.15g,%.15g,%.15g,%.15g,%.15g,%.15g,%.15g,%.15g,%.15g,%.15g,%.15g\n",
            i*dt, z[1], z[2], z[3], z[4], z[5], F, U, P, Ta, Q, u
        for (j = 0; j < fine; j++) {
            h = dt/fine
            for (k = 0; k < 4; k++) {
                w = k == 0 ? 0 : k == 3 ? h : h/2
                for (c = 1; c <= n; c++) x[c] = z[c] + (k > 0 ? w*K[k-1, c] : 0)
                Ta = 290 + 10*sin(0.3*(i*dt + j*h + w))
                rate(x, d); for (c = 1; c <= n; c++) K[k, c] = d[c]
            }
            for (c = 1; c <= n; c++) z[c] += h/6*(K[0,c] + 2*K[1,c] + 2*K[2,c] + K[3,c])
        }
    }
}
END
for i in 1 2 3 4 5 6 7; do awk -v seed=$i -f "$folder/drive.awk" >"$folder/drive_$i.csv"; done
succeed "7 trajectories of at most 40 samples" import "$folder"/drive_?.csv -o "$folder/drive.h5"
cat >"$folder/drive.yaml" <<'END'
scene: drive
time: {dt: 0.05, steps: 31, integrator: rk4, substeps: 4}
subsystems:
  cart: {weights: w/cart.h5, state: {q: {unit: m, columns: [q]}, p: {unit: kg m/s, columns: [p]}}}
  coil: {weights: w/coil.h5, state: {phi: {unit: Wb, columns: [phi]}}}
  body: {weights: w/body.h5, state: {s: {unit: J/K, columns: [s]}}}
  tank: {weights: w/tank.h5, state: {V: {unit: m^3, columns: [V]}}}
boundary_inputs:
  hand: {x: {unit: m, dE: [F], hold: previous}}
  source: {q: {unit: C, dE: [U], hold: previous}}
  heater:
    h: {unit: s, dE: [P], hold: previous}
    s: {unit: J/K, dE: [0], dS: [1]}
  air: {s: {unit: J/K, dE: [Ta], dS: [1]}}
  pump: {m: {unit: Pa s, dE: [Q], hold: previous}}
  valve: {u: {unit: "1", dE: [0], value: [u], hold: previous}, s: {unit: J/K, dE: [293.15], dS: [1]}}
  room: {s: {unit: J/K, dE: [293.15], dS: [1]}}
ports:
  push: {law: bracket, between: [cart, hand], expose: {cart: [p], hand: [x]}, weights: w/push.h5}
  rub: {law: bracket, between: [cart, room], expose: {cart: [p], room: [s]}, weights: w/rub.h5}
  drive: {law: bracket, between: [coil, source], expose: {coil: [phi], source: [q]}, weights: w/drive.h5}
  warm: {law: bracket, between: [coil, room], expose: {coil: [phi], room: [s]}, weights: w/warm.h5}
  heat: {law: bracket, between: [body, heater], expose: {body: [s], heater: [h, s]}, weights: w/heat.h5}
  cool: {law: bracket, between: [body, air], expose: {body: [s], air: [s]}, weights: w/cool.h5}
  fill: {law: bracket, between: [tank, pump], expose: {tank: [V], pump: [m]}, weights: w/fill.h5}
  drain: {law: bracket, between: [tank, valve], expose: {tank: [V], valve: [u, s]}, weights: w/drain.h5}
reference: {file: drive.h5, trajectory: 6}
END
cat >"$folder/drive_train.yaml" <<'END'
scene: drive.yaml
data: {file: drive.h5, trajectories: "0:5"}
models:
  cart:
    constants: {k: {learned: 1.0, positive: true}, m: {learned: 1.0, positive: true}}
    energy: "p^2/(2*m) + k*q^2/2"
    reversible: {given: [[q, p, 1.0]]}
  coil: {constants: {L: {learned: 1.0, positive: true}}, energy: "phi^2/(2*L)"}
  body: {constants: {c: {learned: 80.0, positive: true}}, energy: "300*c*exp(s/c)", entropy: {given: s}}
  tank: {energy: "V^2/2"}
  push: {law: bracket, constants: {gain: {learned: 0.5}}, reversible: {given: [[a.p, b.x, gain]]}}
  rub: {law: bracket, irreversible: {learned: {acts_on: [a.p], heats: [b.s]}}}
  drive: {law: bracket, reversible: {given: [[a.phi, b.q, 1.0]]}}
  warm: {law: bracket, irreversible: {learned: {acts_on: [a.phi], heats: [b.s]}}}
  heat: {law: bracket, reversible: {given: [[a.s, b.h, "1/a.dE.s"], [b.s, b.h, "-1/a.dE.s"]]}}
  cool:
    law: bracket
    constants: {K: {learned: 1.0, positive: true}}
    irreversible: {given: [[a.s, b.s, "K*b.dE.s/a.dE.s"]]}
  fill: {law: bracket, reversible: {given: [[a.V, b.m, 1.0]]}}
  drain:
    law: bracket
    irreversible: {learned: {acts_on: [a.V], heats: [b.s], strength: {features: [b.u], hidden: [4]}}}
subsystems: {cart: cart, coil: coil, body: body, tank: tank}
ports: {push: push, rub: rub, drive: drive, warm: warm, heat: heat, cool: cool, fill: fill, drain: drain}
END
succeed "Verdict: good" fit "$folder/drive_train.yaml" -o "$folder/w"
succeed "steps in violation                    0 of" evaluate "$folder/drive.yaml" --weights "$folder/w" --data "$folder/drive.h5"
awk '$2 == "trajectory" { if (!($5 < 0.01)) exit 1; n++ } END { exit n == 5 ? 0 : 1 }' "$folder/out" ||
    fail "evaluate: expected errors below 0.01 %: $(cat "$folder/out")"
both_ways "$folder/drive.yaml" "$folder/w"
# The heater books its power, and as entropy its power over the temperature of the body.
awk '$1 == "body" && $2 == "heat" { T = $3/$4; exit T > 290 && T < 330 ? 0 : 1 }' "$folder/one" ||
    fail "run: the heater gives no entropy at the temperature of the body"

# Held inputs are no smooth ones: without the key the same model is far off.
sed 's/, hold: previous//' "$folder/drive.yaml" >"$folder/smooth.yaml"
succeed "cart" evaluate "$folder/smooth.yaml" --weights "$folder/w" --data "$folder/drive.h5"
awk '$1 == "p" && $2 == "trajectory" { exit $5 > 0.5 ? 0 : 1 }' "$folder/out" ||
    fail "evaluate: smooth inputs fit jumps: $(cat "$folder/out")"

# A port that names what it heats and has given pairs alone; a subsystem without entropy whose energy is a constant.
sed -e 's/rub: {law: bracket, irreversible: .*/rub: {law: bracket, irreversible: {heats: [b.s], given: [[a.p, b.s, "0.4*b.dE.s"]]}}/' \
    -e 's/tank: {energy: "V^2\/2"}/tank: {energy: {features: [V]}}/' "$folder/drive_train.yaml" |
    sed '$a stages: [{optimiser: gauss_newton, iterations: 1, residual: derivative}]' >"$folder/given.yaml"
expect 13 "worse than a state that stays as it is, in V of tank" fit "$folder/given.yaml" -o "$folder/given"
cat >"$folder/closed.yaml" <<'END'
scene: closed
time: {dt: 0.05, steps: 31, integrator: rk4}
subsystems:
  cart: {weights: w/cart.h5, state: {q: {unit: m, columns: [q]}, p: {unit: kg m/s, columns: [p]}}}
  body: {weights: w/body.h5, state: {s: {unit: J/K, columns: [s]}}}
ports: {rub: {law: bracket, between: [cart, body], expose: {cart: [p], body: [s]}, weights: w/rub.h5}}
END
for port in 'heats: [b.s], given: [[a.p, b.s, "0.4*b.dE.s"]]' 'given: [[a.p, b.s, "0.4*b.dE.s"]]'; do
    for body in 'energy: {features: [s]}, entropy: {given: s}' 'energy: {features: [s]}'; do
        cat >"$folder/closed_train.yaml" <<END
scene: closed.yaml
data: {file: drive.h5}
models:
  cart: {energy: ["p^2/4", {features: [q], hidden: [4]}], reversible: {given: [[q, p, 1.0]]}}
  body: {$body}
  rub: {law: bracket, irreversible: {$port}}
subsystems: {cart: cart, body: body}
ports: {rub: rub}
start: {tries: 1}
stages: [{optimiser: gauss_newton, iterations: 1, residual: derivative}]
END
        "$train" fit "$folder/closed_train.yaml" -o "$folder/closed" >"$folder/out" 2>&1
        grep -q "Verdict:" "$folder/out" || fail "fit with $port and $body: $(cat "$folder/out")"
    done
done

# A proposal reads the shorter trajectory, too.
succeed "wrote" propose "$folder/drive.yaml" --data "$folder/drive.h5" -o "$folder/proposed.yaml"
grep -v "^#" "$folder/proposed.yaml" | grep -q nan && fail "propose: a number is missing"

# Without structure: one subsystem with one port to what the inputs follow.
succeed "wrote" propose "$folder/drive.yaml" --data "$folder/drive.h5" --form free -o "$folder/free.yaml"
sed -i -e 's/iterations: [0-9]*, batch: 2048/iterations: 6, batch: 2048/' -e '/optimiser: .*robust/d' -e 's/hidden: \[32\]/hidden: [4]/' \
    "$folder/free.yaml"
succeed "Verdict: " fit "$folder/free.yaml" -o "$folder/free"

# --- an input at times of its own ---

cat >"$folder/uneven.awk" <<'END'
function advance(to) { i = U/R + (i - U/R)*exp(-(to - t)*R/L); t = to }
BEGIN {
    srand(seed); L = 0.5; R = 1.5; t = 0; U = 2*rand() - 1; i = rand()
    nextU = 0.1 + 0.2*rand(); n = 60 + 5*seed
    print "t [s],i [A],v [V],U [mV]"
    printf "0,%.12g,%.12g,%.12g\n", i, U - 0.4*i, 1000*U
    for (k = 1; k < n; k++) {
        to = t0 + 0.04 + 0.03*rand(); t0 = to
        while (nextU < to) { advance(nextU); U = 2*rand() - 1; printf "%.12g,,,%.12g\n", t, 1000*U; nextU += 0.1 + 0.3*rand() }
        advance(to)
        printf "%.12g,%.12g,%.12g,\n", t, i + 0.002*(rand() - 0.5), U - 0.4*i + 0.002*(rand() - 0.5)
    }
}
END
for i in 1 2 3 4 5 6; do awk -v seed=$i -f "$folder/uneven.awk" >"$folder/uneven_$i.csv"; done
succeed "6 trajectories" import "$folder"/uneven_?.csv -o "$folder/uneven.h5"
cat >"$folder/uneven.yaml" <<'END'
scene: uneven
time: {dt: 0.05, steps: 60, integrator: rk4}
subsystems:
  coil: {weights: w/coil.h5, state: {phi: {unit: Wb, hidden: {deviation: 1.0}}}}
boundary_inputs:
  source: {q: {unit: C, dE: [U], hold: previous}}
  room: {s: {unit: J/K, dE: [293.15], dS: [1]}}
ports:
  drive: {law: bracket, between: [coil, source], expose: {coil: [phi], source: [q]}, weights: w/drive.h5}
  warm: {law: bracket, between: [coil, room], expose: {coil: [phi], room: [s]}, weights: w/warm.h5}
observations:
  i: coil.dE.phi
  v: "U - coil.inner*coil.dE.phi"
reference: {file: uneven.h5, trajectory: 5, estimate: 0.5}
END
cat >"$folder/uneven_train.yaml" <<'END'
scene: uneven.yaml
noise: estimated
data: {file: uneven.h5, trajectories: "0:4", validation: none}
models:
  coil: {constants: {L: {learned: 1.0, positive: true}, inner: {learned: 0.1}}, energy: "phi^2/(2*L)"}
  drive: {law: bracket, reversible: {given: [[a.phi, b.q, 1.0]]}}
  warm:
    law: bracket
    constants: {R: {learned: 1.0, positive: true}}
    irreversible: {given: [[a.phi, b.s, "R*b.dE.s"]]}
subsystems: {coil: coil}
ports: {drive: drive, warm: warm}
END
succeed "What the measurements fix" fit "$folder/uneven_train.yaml" -o "$folder/u"
grep -qE "^  coil.L = 0.(499|500)" "$folder/out" || fail "fit: expected L = 0.5: $(cat "$folder/out")"
grep -qE "^  coil.inner = 0.(399|400)" "$folder/out" || fail "fit: expected an inner resistance of 0.4: $(cat "$folder/out")"
grep -qE "^  warm.R = 1.(499|500|5,)" "$folder/out" || fail "fit: expected R = 1.5: $(cat "$folder/out")"
succeed "steps in violation 0" evaluate "$folder/uneven.yaml" --weights "$folder/u" --data "$folder/uneven.h5" --estimate 0.5 \
    --states "$folder/states.h5" --record "$folder/y.h5"
awk '$1 == "i" || $1 == "v" { if (!($3 < 1)) exit 1; n++ } END { exit n == 2 ? 0 : 1 }' "$folder/out" ||
    fail "evaluate: expected errors below 1 %: $(cat "$folder/out")"
both_ways "$folder/uneven.yaml" "$folder/u"
program=$portmetd succeed "uneven.h5, trajectory 5: measurements, whose first 0.5 s tell the start" check "$folder/uneven.yaml" \
    --weights "$folder/u"
grep -q "the reference holds measurements, with which .* compares: no error table" "$folder/out" ||
    fail "check: expected a reason why there is no error table"
grep -q "no reference" "$folder/out" && fail "check: there is a reference"
awk '$1 == "coil" && $2 == "warm" { exit $3 < -0.01 && $3 > -1 ? 0 : 1 }' "$folder/one" ||
    fail "run: the voltage in mV was not converted: $(cat "$folder/one")"
sed 's/U - coil.inner/W - coil.outer/' "$folder/uneven.yaml" >"$folder/unknown.yaml"
expect 3 'coil.inner' evaluate "$folder/unknown.yaml" --weights "$folder/u" --data "$folder/uneven.h5" --estimate 0.5
program=$portmetd
sed -e 's/, estimate: 0.5//' -e 's/uneven.h5/drive.h5/' "$folder/uneven.yaml" >"$folder/unestimated.yaml"
expect 5 'nobody measures coil.phi, so that its start must be estimated' run "$folder/unestimated.yaml" --weights "$folder/u" --in-process
# More steps than an input has samples for are refused before the start, whoever would take them.
for how in "run --in-process" "run" "run --copies 2" "coordinator" "test"; do
    # shellcheck disable=SC2086
    expect 5 'scene drive: expected a run of at most 31 steps, found 2000: boundary input hand follows trajectory 6 of ' \
        $how "$folder/drive.yaml" --weights "$folder/w" --steps 2000
done
expect 5 'ends after 9' run "$folder/uneven.yaml" --weights "$folder/u" --in-process --steps 2000
finish
