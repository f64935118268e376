#!/bin/sh
# test_many.sh PORTMETD MAKE_SCENE SAME_RECORDING [KILLS [STEPS [SEED]]]: 1,000 links in eight processes record the
# bits that they have in one process, while one datagram in fifty gets lost, and processes and the coordinator are
# killed at random, in turn on their way to a gate and held there.
. "$(dirname "$0")/network.sh"
kills=${4:-4}
steps=${5:-60}
seed=${6:-$(date +%s)}
cat >"$folder/scene_many.yaml" <<EOF
scene: many
time: {dt: 1.0e-3, steps: $steps, integrator: heun}
lockstep: {window: 4, patience: 1000, checkpoint: 10}
laws: {entropy: 1.0e-13}
$(links 1000)
processes: {p0: "link[0:125]", p1: "link[125:250]", p2: "link[250:375]", p3: "link[375:500]",
            p4: "link[500:625]", p5: "link[625:750]", p6: "link[750:875]", p7: "link[875:1000]"}
EOF
"$portmetd" run "$folder/scene_many.yaml" --in-process --quiet --record "$folder/plain.h5" || fail "in process"

if ! nft add table ip loss 2>/dev/null || ! nft add chain ip loss input '{ type filter hook input priority 0; }' ||
    ! nft add rule ip loss input udp dport 7667 numgen random mod 50 == 0 counter drop; then
    echo "no nft here: nothing gets lost"
fi

# has_lost COUNT: whether the run has told of as many deaths.
has_lost() {
    [ "$(grep -c 'killed by signal 9 (Killed), started again$' "$folder/many.err")" -eq "$1" ]
}

# choices: gates at random steps, one in each of as many equal parts of the run, and when and who is killed.
choices() {
    awk -v seed="$seed" -v kills="$kills" -v steps="$steps" 'BEGIN {
        srand(seed)
        for (i = 0; i < kills; i++) {
            who = int(9 * rand())
            printf "%d:%s:%s ", int(steps * (i + rand()) / (kills + 1)), i % 2 ? "held" : "moving",
                who == 8 ? "coordinator" : "p" who
        }
    }'
}

open_gate many 0
start many run "$folder/scene_many.yaml" --checkpoint "$folder/many" --record "$folder/many.h5" \
    --gate "$folder/many.gate"
run=$pid
deaths=0
for choice in $(choices); do
    step=${choice%%:*}
    open_gate many "$step"
    find_child $run "${choice##*:}"
    case $choice in *:held:*) held many "$step" ;; esac
    kill -KILL "$victim" || fail "many: ${choice##*:} was gone before it was killed"
    deaths=$((deaths + 1))
    wait_until 60 has_lost $deaths || fail "many: expected $deaths deaths"
    [ $failures -eq 0 ] || finish
done
open_gate many "$steps"
wait $run || fail "many: exit code $?"
has_lost "$kills" || fail "many: expected $kills deaths"
"$same_recording" "$folder/plain.h5" "$folder/many.h5" || fail "many: other bits"
[ -z "$(ls "$folder/many")" ] || fail "many: left $(ls "$folder/many")"
echo "many, seed $seed: $deaths of $kills kills, $(nft list table ip loss 2>/dev/null | sed -n 's/.*packets \([0-9]*\).*/\1/p') datagrams lost"
no_orphans "at the end" ""
finish
