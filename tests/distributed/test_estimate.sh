#!/bin/sh
# test_estimate.sh PORTMETD MAKE_SCENE SAME_RECORDING PORTMET_TRAIN: a run that starts from a record of measurements has
# the same bits in one process, over LCM, and with processes that are started by hand, each of which estimates the start
# itself. A process that has another record is refused.
. "$(dirname "$0")/network.sh"
train=$4
PATH="$(dirname "$train"):$PATH"

# A cup cools in a room. The temperature of the cup alone is measured. Its record begins at KELVIN.
# record NAME KELVIN
record() {
    awk -v a="$2" 'BEGIN {
        srand(1); b = 293
        print "t,T"
        for (k = 0; k < 200; k++) {
            printf "%d,%.4f\n", 5*k, a + 0.1*(2*rand() - 1)
            for (j = 0; j < 50; j++) { q = 0.1*2*(a - b); a -= q/800; b += q/1500 }
        }
    }' >"$folder/$1.csv"
    "$train" import "$folder/$1.csv" -o "$folder/$1.h5" >"$folder/import.out" 2>&1 || fail "import: $(cat "$folder/import.out")"
}
record tea 350
record coffee 351

# The scene NAME starts from the record NAME.
for name in tea coffee; do
    cat >"$folder/scene_$name.yaml" <<END
scene: tea
time: {dt: 5.0, steps: 40, integrator: rk4}
models:
  cup: {constants: {C: 800.0}, energy: ["293*C*(exp(s/C) - 1)"], entropy: {given: s}}
  room: {constants: {C: 1500.0}, energy: ["293*C*(exp(s/C) - 1)"], entropy: {given: s}}
  heat:
    law: bracket
    constants: {K: 2.0}
    irreversible: {given: [[a.s, b.s, "K*b.dE.s/a.dE.s"]]}
subsystems:
  cup: {model: cup, state: {s: {unit: J/K, size: 1, hidden: {guess: 120.0, deviation: 80.0}}}}
  room: {model: room, state: {s: {unit: J/K, size: 1, hidden: {deviation: 2.0}}}}
ports:
  heat: {law: bracket, between: [cup, room], expose: {cup: s, room: s}, model: heat}
observations: {T: "cup.dE.s"}
reference: {file: $name.h5, trajectory: 0, estimate: 300}
lockstep: {patience: 60}
END
done
tea=$folder/scene_tea.yaml

"$portmetd" run "$tea" --in-process --quiet --record "$folder/plain.h5" || fail "in one process"

"$portmetd" test "$tea" >"$folder/test.out" || fail "over LCM: $(cat "$folder/test.out")"

# by_hand ROOM: a node for the cup, the coordinator, and a node for the room by the scene ROOM.
by_hand() {
    start cup node "$tea" cup
    cup=$pid
    start coordinator coordinator "$tea" --quiet --record "$folder/hand.h5"
    coordinator=$pid
    await_missing "$tea" room
    start room node "$1" room
    room=$pid
}
by_hand "$tea"
ends coordinator $coordinator 0 ""
ends cup $cup 0 ""
ends room $room 0 ""
"$same_recording" "$folder/plain.h5" "$folder/hand.h5" || fail "by hand: other bits than in one process"

rm "$folder/hand.h5"
by_hand "$folder/scene_coffee.yaml"
ends coordinator $coordinator 7 "node room holds another scene"
ends cup $cup 7 "node room holds another scene"
ends room $room 7 "node room holds another scene"

no_orphans "at the end"
finish
