#!/bin/sh
# test_measured_cli.sh PORTMET_TRAIN PORTMETD [short]: from tables of angles to a prediction with bands, by the commands of
# the trainer's page; and mistakes in tables are told with their place. `short` leaves out a network that stays, outliers,
# and a pendulum with a brake: how well such fits go, and no code of their own.
. "$(dirname "$0")/../support/setting.sh"
train=$1 portmetd=$2 program=$1
short=${3:-}

# A damped pendulum whose angle is measured at uneven times; every ninth place is empty.
for i in 1 2 3 4 5 6 7 8 9 10 11 12; do
    awk -v seed=$i 'BEGIN {
        srand(seed); q = 0.3 + rand(); k = 9
        print "# a logger\nt [s]; \"angle (rad)\""
        for (i = 0; i < 250; i++) {
            noise = 0.005*sqrt(-2*log(1 - rand()))*cos(6.2831853*rand())
            if (i % 9 == 5) printf "%.4f;\n", t; else printf "%.4f; %.5f\n", t, q + 0.02 + noise
            wait = 0.025 + 0.01*rand()
            for (j = 0; j < 20; j++) { v += wait/20*(-k*sin(q) - 0.2*v); q += wait/20*v }
            t += wait
        }
    }' >"$folder/$([ $i -le 4 ] && echo swing || echo more)_$i.csv"
done
cat >"$folder/pendulum.yaml" <<'END'
scene: pendulum
time: {dt: 0.04, steps: 100, integrator: rk4}
subsystems:
  arm:
    weights: arm.h5
    state:
      q: {unit: rad, size: 1, hidden: {deviation: 2.0}}
      p: {unit: kg m^2/s, hidden: {deviation: 5.0}}
      s: {unit: J/K, hidden: true}
observations: {angle: "arm.q + 0.02"}
END
cat >"$folder/training.yaml" <<'END'
scene: pendulum.yaml
noise: {angle: 0.005}
data: {validation: none, trajectories: "0:3"}
models:
  arm:
    constants:
      stiffness: {learned: 5.0, positive: true}
      viscous: {learned: 0.1, positive: true}
      useless: {learned: 1.0, positive: true}
    energy: ["p^2/2 - stiffness*cos(q) + useless", "300*s"]
    entropy: {given: s}
    reversible: {given: [[q, p, 1.0]]}
    irreversible: {given: [[p, s, "viscous*dE.s"]]}
subsystems: {arm: arm}
END
succeed "4 trajectories of at most 250 samples, columns angle" import "$folder"/swing_?.csv -o "$folder/swing.h5"
succeed "uneven" inspect "$folder/swing.h5"
grep -qE "^angle +rad +888 +112 " "$folder/out" || fail "inspect: expected 888 samples, 112 missing"
succeed "arm: the data do not fix useless" fit "$folder/training.yaml" --data "$folder/swing.h5" -o "$folder/weights"
grep -qE "^  arm.stiffness = (8.9[89]|9.0[01])" "$folder/out" || fail "fit: expected a stiffness of 9"
grep -qE "^  arm.viscous = 0.(19[5-9]|20[0-5])" "$folder/out" || fail "fit: expected a friction of 0.2"
grep -q "arm.s: the data do not fix its start" "$folder/out" || fail "fit: the entropy is fixed by nothing"
grep -q "Energies of" "$folder/out" && fail "fit: its mass is known, so that its energy is"
# On a terminal bars show the progress within a line of the report, and leave nothing behind.
script -qec "$train fit $folder/training.yaml --data $folder/swing.h5 -o $folder/shown" /dev/null >"$folder/out" 2>"$folder/err" </dev/null ||
    fail "fit on a terminal"
tr '\r' '\n' <"$folder/out" | grep -qE '^windows of [0-9]+ +\[[# ]*\] [0-9]+/[0-9]+' || fail "fit: expected a bar of progress on a terminal"
tr '\r' '\n' <"$folder/out" | grep -qE '^bands, fit 1 of [0-9] \[' || fail "fit: expected a bar while bands are calibrated"
sed 's|p^2/2 - stiffness\*cos(q) + useless|scale*(p^2/2 - stiffness*cos(q))|; s/useless:/scale:/' "$folder/training.yaml" >"$folder/scale.yaml"
succeed "Energies of arm, and the powers through its ports, are known to" fit "$folder/scale.yaml" --data "$folder/swing.h5" \
    -o "$folder/scaled"
succeed "3 trajectories that the weights were trained or validated on are left out" evaluate "$folder/pendulum.yaml" \
    --weights "$folder/weights" --data "$folder/swing.h5" --estimate 1.5 --record "$folder/y.h5"
inside=$(awk '$1 == "angle" { print int($6) }' "$folder/out")
[ "${inside:-0}" -ge 80 ] && [ "$inside" -le 97 ] || fail "evaluate: expected about 90 % inside the bands"
grep -q "arm.s: predictions depend on the guess" "$folder/out" || fail "evaluate: nothing measures the entropy"
grep -q "arm.p: predictions depend" "$folder/out" && fail "evaluate: the angle determines the momentum"
h5dump -H -d /y "$folder/y.h5" | grep -q "( 1, 250, 1 )" || fail "record: expected /y [trajectory][time][column]"
h5dump -H -d /deviation "$folder/y.h5" >/dev/null || fail "record: expected standard deviations"
h5dump -H -d /state_deviation "$folder/y.h5" | grep -q "( 1, 250, 3 )" || fail "record: expected deviations of all states"

# --- the same data have the same black box, however long the fit takes ---
for substeps in 1 6; do
    (sed 's/"0:3"/"0:11"/' "$folder/training.yaml" && echo "loss: {substeps: $substeps}") >"$folder/many.yaml"
    succeed "Black box: " fit "$folder/many.yaml" --data "$folder"/swing_?.csv "$folder"/more_*.csv -o "$folder/many_$substeps"
    grep "^Black box" "$folder/out" | sed 's/, in .*//' >"$folder/box_$substeps"
done
cmp -s "$folder/box_1" "$folder/box_6" || fail "fit: another black box: $(cat "$folder/box_1" "$folder/box_6")"

# --- the same from tables, without a dataset of ours; in degrees, predictions are in degrees ---
numbers() {
    h5dump -y -w 1 -d /y "$1" | awk '/^ *DATA [{]/ { inside = 1; next } inside && /}/ { exit } inside && NF { gsub(/[ ,]/, ""); print }'
}
succeed "arm: the data do not fix useless" fit "$folder/training.yaml" --data "$folder"/swing_?.csv -o "$folder/tables"
h5diff "$folder/weights/arm.h5" "$folder/tables/arm.h5" /parameters || fail "fit to tables: other weights"
succeed "unseen" evaluate "$folder/pendulum.yaml" --weights "$folder/tables" --data "$folder/swing_4.csv" --estimate 1.5 \
    --record "$folder/t.h5"
numbers "$folder/y.h5" >"$folder/y.txt"
numbers "$folder/t.h5" | cmp -s - "$folder/y.txt" || fail "evaluate of a table: other predictions"
sed -e 's/size: 1, hidden: {deviation: 2.0}/columns: [angle]/' -e '/^observations/d' "$folder/pendulum.yaml" >"$folder/direct.yaml"
# A refusal names the table, not the dataset that it was read into.
expect 5 "$folder/swing_4.csv: the times of trajectory 0 are not" evaluate "$folder/direct.yaml" --weights "$folder/tables" \
    --data "$folder/swing_4.csv"
# A trajectory that no start follows spoils no other.
awk -F'; ' -v OFS='; ' 'NR > 2 && $2 != "" { $2 = $2 "e200" } { print }' "$folder/swing_4.csv" >"$folder/huge.csv"
succeed "unseen" evaluate "$folder/direct.yaml" --weights "$folder/tables" --data "$folder/swing_4.csv" "$folder/huge.csv" --estimate 1.5
grep -qE "trajectory 0 +angle [0-9.]+$" "$folder/out" || fail "evaluate: the first trajectory can be followed"
grep -qE "trajectory 1 +angle inf" "$folder/out" || fail "evaluate: nothing follows the second trajectory"
awk -F'; ' -v OFS='; ' 'NR == 2 { sub("rad", "deg") } NR > 2 && $2 != "" { $2 = sprintf("%.12g", $2*57.295779513082323) } { print }' \
    "$folder/swing_4.csv" >"$folder/degrees.csv"
succeed "unseen" evaluate "$folder/direct.yaml" --weights "$folder/weights" --data "$folder/swing_4.csv" --estimate 1.5 --record "$folder/y.h5"
succeed "converts angle from deg to rad" evaluate "$folder/direct.yaml" --weights "$folder/weights" --data "$folder/degrees.csv" \
    --estimate 1.5 --record "$folder/t.h5"
numbers "$folder/y.h5" >"$folder/y.txt"
numbers "$folder/t.h5" | paste "$folder/y.txt" - | awk '{ d = $1*57.295779513082323 - $2; if (d > 1e-3 || -d > 1e-3) exit 1; ++n }
    END { exit n != 250 }' || fail "evaluate in degrees: expected the same predictions in degrees"

# --- pictures of predictions with bands ---
if command -v gnuplot >/dev/null; then
    succeed "3 trajectories that the weights were trained or validated on are left out" evaluate "$folder/pendulum.yaml" \
        --weights "$folder/weights" --data "$folder/swing.h5" --estimate 1.5 --plot "$folder/pictures"
    for name in prediction_3 coverage; do
        [ -s "$folder/pictures/$name.png" ] || fail "evaluate --plot: expected $name.png"
    done
    # Columns are the time, measured, predicted, half the band, measured minus predicted.
    awk '$2 != "nan" && ($2 - $3)/$4 < 1 && ($3 - $2)/$4 < 1 { ++inside } $2 != "nan" { ++all }
        END { exit !(inside > 0.8*all && inside < 0.97*all) }' "$folder/pictures/prediction_3.txt" ||
        fail "evaluate --plot: expected about 90 % inside the bands that are drawn"
fi

# --- constants that only appear together are named together ---
sed -e 's/useless: .*/mass: {learned: 2.0, positive: true}/' -e 's/p^2\/2 - stiffness\*cos(q) + useless/p^2\/(2*mass) - stiffness*cos(q)/' \
    "$folder/training.yaml" >"$folder/scale.yaml"
succeed "cannot be identified" fit "$folder/scale.yaml" --data "$folder/swing.h5" -o "$folder/scale"
for name in mass stiffness viscous; do
    grep "cannot be identified" "$folder/out" | grep -q " arm.$name x " || fail "fit: expected arm.$name to be named"
done

awk '/: note: / { note = NR } /^windows/ { exit !(note > 0 && note < NR) }' "$folder/out" ||
    fail "fit: expected a note before the weights are fitted"
grep -E "scale.yaml:[0-9]+:[0-9]+: note: arm.stiffness, .*arm.mass" "$folder/out" >/dev/null ||
    fail "fit: expected the note to name the place, the stiffness and the mass"

# --- a hidden start has a deviation of its own, and what happens later needs none ---
# A cup cools in a room, whose entropy nobody measures: it rises by 50 to 120 J/K, its start is known to 2 J/K.
for i in 1 2 3 4; do
    awk -v seed=$i 'BEGIN {
        srand(seed); a = 320 + 45*rand(); b = 293
        print "t,T"
        for (k = 0; k < 300; k++) {
            printf "%d,%.4f\n", 5*k, a + 0.1*sqrt(-2*log(1 - rand()))*cos(6.2831853*rand())
            for (j = 0; j < 50; j++) { q = 0.1*2*(a - b); a -= q/800; b += q/1500 }
        }
    }' >"$folder/tea_$i.csv"
done
cat >"$folder/tea.yaml" <<'END'
scene: tea
time: {dt: 5.0, steps: 299, integrator: rk4}
subsystems:
  cup:
    weights: cup.h5
    state: {s: {unit: J/K, size: 1, hidden: {guess: 120.0, deviation: 80.0}}}
  room:
    weights: room.h5
    state: {s: {unit: J/K, size: 1, hidden: {deviation: 2.0}}}
ports:
  heat: {law: bracket, between: [cup, room], expose: {cup: s, room: s}, weights: heat.h5}
observations: {T: "cup.dE.s"}
END
cat >"$folder/cooling.yaml" <<'END'
scene: tea.yaml
noise: estimated
data: {validation: none}
models:
  cup: {constants: {C: 800.0}, energy: ["293*C*(exp(s/C) - 1)"], entropy: {given: s}}
  room:
    constants: {C: {learned: 800.0, positive: true}}
    energy: ["293*C*(exp(s/C) - 1)"]
    entropy: {given: s}
  heat:
    law: bracket
    constants: {K: {learned: 0.5, positive: true}}
    irreversible: {given: [[a.s, b.s, "K*b.dE.s/a.dE.s"]]}
subsystems: {cup: cup, room: room}
ports: {heat: heat}
END
succeed "4 trajectories" import "$folder"/tea_?.csv -o "$folder/tea.h5"
succeed "residual 0.1" fit "$folder/cooling.yaml" --data "$folder/tea.h5" -o "$folder/tea"
awk '/^windows of 4 / { sub(/.*residual /, ""); exit !($1 < 1.2) }' "$folder/out" ||
    fail "fit: the deviation of a start holds back what happens later"
grep -qE "room.C = 1[45][0-9][0-9]" "$folder/out" || fail "fit: expected a room of 1500 J/K"

# --- a network beside a formula stays only if it helps: not where the formula is right, but where it lacks something ---
sed -e '/useless:/d' -e 's/stiffness\*cos(q) + useless"/stiffness*cos(q)", {features: [q], hidden: [4]}/' "$folder/training.yaml" \
    >"$folder/beside.yaml"
succeed "without: they are left out" fit "$folder/beside.yaml" --data "$folder/swing.h5" -o "$folder/beside"
grep -qE "^  arm.stiffness = (8.9[89]|9.0[01])" "$folder/out" || fail "fit beside a network: expected a stiffness of 9"
sed -e 's/cos(q)/(1 - q^2\/2)/' "$folder/beside.yaml" >"$folder/lacks.yaml"
[ "$short" = short ] || succeed "without: they stay" fit "$folder/lacks.yaml" --data "$folder/swing.h5" -o "$folder/lacks"

# --- scales of networks follow the fitted trajectories, not the deviation of a start ---
sed 's/deviation: 5.0/deviation: 0.1/' "$folder/pendulum.yaml" >"$folder/still.yaml"
sed -e 's/scene: pendulum/scene: still/' -e '/useless:/d' -e '/viscous:/d' -e 's/ + useless//' \
    -e 's/irreversible: .*/irreversible: {learned: {acts_on: [p], features: ["|p|"], hidden: [4], heats: [s]}}/' \
    "$folder/training.yaml" >"$folder/moves.yaml"
succeed "arm.p moves by" fit "$folder/moves.yaml" --data "$folder/swing.h5" -o "$folder/moves"
grep -qE "^Verdict: (good|fair)" "$folder/out" || fail "fit: scales should follow the fitted trajectories"

# --- a model that cannot follow is called unfit, after other starts, and a black box that can is named ---
sed -e 's/stiffness\*cos(q)/0.1*cos(q)/' -e '/stiffness:/d' "$folder/training.yaml" >"$folder/poor.yaml"
expect 13 "worse than the mean of the measurements" fit "$folder/poor.yaml" --data "$folder/swing.h5" -o "$folder/poor"
for text in "another start is tried" "Verdict: UNFIT" "^Black box: "; do
    grep -q "$text" "$folder/out" || fail "fit: expected \"$text\""
done

# --- outliers neither spoil a fit nor its verdict ---
for i in 1 2 3 4; do
    awk -v OFS='; ' -F'; ' 'NR > 2 && NR % 40 == 7 && NF == 2 && $2 != "" { $2 = $2 + 4 } { print }' "$folder/swing_$i.csv" >"$folder/jump_$i.csv"
done
succeed "4 trajectories" import "$folder"/jump_?.csv -o "$folder/jump.h5"
if [ "$short" != short ]; then
    succeed "wrote" fit "$folder/training.yaml" --data "$folder/jump.h5" -o "$folder/jump"
    grep -qE "^  arm.stiffness = (8.9[89]|9.0[01])" "$folder/out" || fail "fit with outliers: expected a stiffness of 9"
    grep -q "Verdict: good" "$folder/out" || fail "fit with outliers: the model is right"
fi

# --- interrupted and resumed: the same bits ---
# The signal comes as soon as the program catches it.
for wait in 0.05 0.1 0.15 0.2 0.3 0.4 0.6 0.8 1.2 1.6 2.5 4 8 16; do
    rm -rf "$folder/again"
    timeout -s INT $wait "$train" fit "$folder/training.yaml" --data "$folder/swing.h5" -o "$folder/again" >"$folder/out" 2>&1
    grep -q -e "continue with --resume" "$folder/out" && break
done
[ -s "$folder/again/arm.h5" ] || fail "fit, interrupted: expected weights"
succeed "res" fit "$folder/training.yaml" --data "$folder/swing.h5" -o "$folder/again" --resume
h5diff "$folder/weights/arm.h5" "$folder/again/arm.h5" /parameters || fail "fit --resume: other weights"
h5diff "$folder/weights/measured.h5" "$folder/again/measured.h5" || fail "fit --resume: other uncertainties"
succeed "resumes with windows" fit "$folder/training.yaml" --data "$folder/swing.h5" -o "$folder/again" --resume
h5diff "$folder/weights/arm.h5" "$folder/again/arm.h5" /parameters || fail "fit --resume after its end: other weights"

# --- a run from an estimated start ---
succeed "Laws" evaluate "$folder/pendulum.yaml" --weights "$folder/weights" --data "$folder/swing.h5" --estimate 1.5 \
    --states "$folder/states.h5"
states=$(h5dump -H -d /z "$folder/states.h5" | sed -n 's/.*SIMPLE { ( 1, \([0-9]*\), 3 ).*/\1/p')
[ "${states:-0}" -ge 180 ] || fail "states: expected some 185 steps of 0.04 s, found ${states:-none}"
h5dump -a /state_layout "$folder/states.h5" | grep -q '"arm.q arm.p arm.s"' || fail "states: expected hidden columns"

sed -e '/^observations/i reference: {file: swing.h5, trajectory: 3, estimate: 1.5}' "$folder/pendulum.yaml" >"$folder/from_record.yaml"
PATH="$(dirname "$train"):$PATH" timeout 300 "$portmetd" run "$folder/from_record.yaml" --weights "$folder/weights" --in-process \
    --steps 20 --record "$folder/run.h5" >"$folder/out" 2>&1 || fail "run: expected a start from an estimate"
h5dump -d /subsystems/arm/z -s 0,0 -c 1,3 "$folder/run.h5" | grep '(0,' | sed 's/.*: //' >"$folder/start_run"
h5dump -d /z -s 0,0,0 -c 1,1,3 "$folder/states.h5" | grep '(0,' | sed 's/.*: //' >"$folder/start_states"
cmp -s "$folder/start_run" "$folder/start_states" || fail "run: expected the start that evaluate --states writes"
sed 's/estimate: 1.5/estimate: 1000/' "$folder/from_record.yaml" >"$folder/too_long.yaml"
PATH="$(dirname "$train"):$PATH" timeout 300 "$portmetd" run "$folder/too_long.yaml" --weights "$folder/weights" --in-process \
    >"$folder/out" 2>&1 && fail "run: expected a record that is too short to be refused"
grep -qF "nothing is left to predict after 1000 s" "$folder/out" || fail "run: expected the reason"

# --- synthetic measurements ---
succeed "wrote" truth configs/truth/double_pendulum.yaml --trajectories 0:3 --noise 0.01 --missing 0.5 --seed 3 \
    -o "$folder/noisy.h5"
succeed "uneven" inspect "$folder/noisy.h5"
kept=$(awk '$1 == "q1x" { print $2 + $3 }' "$folder/out")
[ "${kept:-0}" -ge 240 ] && [ "$kept" -le 360 ] || fail "truth --missing: $kept of 600 states are left"

# --- times that are not exactly dt apart are all used, and of a fast recording those that are about dt apart ---
for step in 0.04 0.01; do
    awk -v step=$step 'BEGIN {
        srand(7); q = 1
        print "Time (ms);angle;status"
        for (i = 0; i < 8/step; i++) {
            printf "%.2f;%.5f;ok\n", 1000*t, q + 0.02
            wait = step*(0.8 + 0.4*rand())
            for (j = 0; j < 20; j++) { v += wait/20*(-9*sin(q) - 0.2*v); q += wait/20*v }
            t += wait
        }
    }' >"$folder/jitter_$step.csv"
    succeed 'leaves out column "status", which holds no number but "ok"' import "$folder/jitter_$step.csv" -o "$folder/jitter_$step.h5"
done
sed -e 's/angle: 0.005/angle: 0.001/' -e 's/0:3/0:1/' -e '/useless:/d' -e 's/ + useless//' "$folder/training.yaml" >"$folder/jitter.yaml"
succeed "trajectories 0 of at most 200 samples; no" fit "$folder/jitter.yaml" --data "$folder/jitter_0.04.h5" -o "$folder/jitter"
succeed "of at most 800 samples, of which 2" fit "$folder/jitter.yaml" --data "$folder/jitter_0.01.h5" -o "$folder/jitter"
grep -qE "^  arm.stiffness = (8.9[89]|9.0[01])" "$folder/out" || fail "fit: expected a stiffness of 9"

# --- mistakes ---
sed '/^noise/a stages: [{optimiser: adam, iterations: 3}]' "$folder/training.yaml" >"$folder/stages.yaml"
sed 's/data: {validation: none, trajectories: "0:3"}/data: {pieces: 1000}/' "$folder/training.yaml" >"$folder/pieces.yaml"
expect 5 "samples: too few for 1000 pieces" fit "$folder/pieces.yaml" --data "$folder/swing.h5" -o "$folder/no"
sed -i 's/pieces: 1000/pieces: 2, trajectories: "0:4", validation: "4:8"/' "$folder/pieces.yaml"
succeed "trajectories 0:4 of at most 125 samples" fit "$folder/pieces.yaml" --data "$folder/swing.h5" -o "$folder/pieces"
expect 3 'a fit to measurements has no stages' fit "$folder/stages.yaml" --data "$folder/swing.h5" -o "$folder/no"
expect 5 'which only those of measurements may be' evaluate "$folder/pendulum.yaml" --weights "$folder/weights" --data "$folder/swing.h5"
expect 2 'nothing is left to predict after 100 s' evaluate "$folder/pendulum.yaml" --weights "$folder/weights" --data "$folder/swing.h5" --estimate 100
expect 4 'there is no folder' import "$folder/swing_1.csv" -o "$folder/none/swing.h5"
sed 's/(rad)/(deg)/' "$folder/swing_2.csv" >"$folder/other.csv"
expect 5 'in the same units' import "$folder/swing_1.csv" "$folder/other.csv" -o "$folder/no.h5"
printf 'when,a\n0,1\n1,2\n' >"$folder/bad.csv"
expect 5 'the columns are: when a' import "$folder/bad.csv" -o "$folder/no.h5"
printf 't [m],a\n0,1\n1,2\n' >"$folder/bad.csv"
expect 5 '"m" is no unit of time' import "$folder/bad.csv" -o "$folder/no.h5"
sed 's/hidden: true/hidden: {gues: 1}/' "$folder/pendulum.yaml" >"$folder/wrong.yaml"
expect 3 'gues' evaluate "$folder/wrong.yaml" --weights "$folder/weights" --data "$folder/swing.h5" --estimate 1
sed 's/hidden: true/columns: [entropy]/' "$folder/pendulum.yaml" >"$folder/wrong.yaml"
expect 5 'column "entropy" is not in the measurements' evaluate "$folder/wrong.yaml" --weights "$folder/weights" \
    --data "$folder/swing.h5" --estimate 1
sed 's/arm.q + 0.02/arm.x/' "$folder/pendulum.yaml" >"$folder/wrong.yaml"
expect 3 'there is no "arm.x" here' evaluate "$folder/wrong.yaml" --weights "$folder/weights" \
    --data "$folder/swing.h5" --estimate 1
expect 5 'has 1 sample within 0.001 s' evaluate "$folder/pendulum.yaml" --weights "$folder/weights" \
    --data "$folder/swing.h5" --estimate 0.001
printf 't,a\n0,1\n1,x\n' >"$folder/bad.csv"
expect 5 'bad.csv:3: expected a number, found "x"' import "$folder/bad.csv" -o "$folder/no.h5"
printf 't,a\n0,1\n1,2,3\n' >"$folder/bad.csv"
expect 5 'bad.csv:3: expected 2 columns as in the other lines, found 3' import "$folder/bad.csv" -o "$folder/no.h5"
printf 'a,b\n0,1\n1,2\n' >"$folder/bad.csv"
expect 5 'there is no column "t"' import "$folder/bad.csv" -o "$folder/no.h5"
printf 't,a\n0,1\n0,2\n' >"$folder/bad.csv"
expect 5 'all rows have the time 0 s, expected rising times' import "$folder/bad.csv" -o "$folder/no.h5"
expect 4 'cannot be read' import "$folder/missing.csv" -o "$folder/no.h5"
[ ! -e "$folder/no.h5" ] || fail "a refused table left a file"
sed -i 's/{angle: 0.005}/{angel: 0.005}/' "$folder/training.yaml"
expect 3 'the scene measures no column "angel"' fit "$folder/training.yaml" --data "$folder/swing.h5" -o "$folder/weights"

[ "$short" = short ] && finish
# A pendulum with a cubic brake, whose momentum is guessed so large that no step from there can be integrated: other
# starts are drawn.
for i in 1 2 3 4 5; do
    awk -v seed=$i 'BEGIN {
        srand(seed); q = 0.5 + rand(); print "t [s],q [rad]"
        for (k = 0; k < 100; k++) {
            printf "%.3f,%.5f\n", 0.05*k, q + 0.003*sqrt(-2*log(1 - rand()))*cos(6.2831853*rand())
            for (j = 0; j < 100; j++) { v += 0.0005*(-9*sin(q) - 0.2*v^3); q += 0.0005*v }
        }
    }' >"$folder/brake_$i.csv"
done
succeed "wrote" import "$folder"/brake_?.csv -o "$folder/brake.h5"
cat >"$folder/brake.yaml" <<'END'
scene: brake
time: {dt: 0.05, steps: 100, integrator: rk4}
subsystems:
  arm:
    weights: arm.h5
    state:
      q: {unit: rad, columns: [q]}
      p: {unit: kg m^2/s, hidden: {guess: 40, deviation: 30.0}}
      s: {unit: J/K, hidden: {deviation: 0.1}}
END
cat >"$folder/braked.yaml" <<'END'
scene: brake.yaml
noise: estimated
models:
  arm:
    constants:
      stiffness: {learned: 5.0, positive: true}
      cubic: {learned: 0.3, positive: true}
    energy: ["p^2/2 - stiffness*cos(q)", "300*s"]
    entropy: {given: s}
    reversible: {given: [[q, p, 1.0]]}
    irreversible: {given: [[p, s, "cubic*p^2*dE.s"]]}
subsystems: {arm: arm}
END
succeed "Verdict: good" fit "$folder/braked.yaml" --data "$folder/brake.h5" -o "$folder/braked"
grep -qE "arm.cubic = 0.(19|20)" "$folder/out" || fail "fit: expected a brake of 0.2"
succeed "Laws: " evaluate "$folder/brake.yaml" --weights "$folder/braked" --data "$folder/brake.h5" --estimate 1

finish
