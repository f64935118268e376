#!/bin/sh
# test_many.sh PORTMETD MAKE_SCENE SAME_RECORDING [KILLS [STEPS [SEED]]]: 1,000 links in eight processes record the
# bits that they have in one process, while one datagram in fifty gets lost, and processes and the coordinator are
# killed at random, in turn on their way to a step and held there. 1,600 links, whose processes report sums, print the
# tables of one process under the same kills and losses.
. "$(dirname "$0")/network.sh"
kills=${4:-4}
steps=${5:-60}
seed=${6:-$(date +%s)}

# chain NAME EACH: the scene NAME of eight processes with EACH links.
chain() {
    cat >"$folder/scene_$1.yaml" <<EOF
scene: $1
time: {dt: 1.0e-3, steps: $steps, integrator: heun}
lockstep: {window: 4, patience: 1000, checkpoint: 10}
laws: {entropy: 1.0e-13}
$(links $((8 * $2)))
processes:
$(for i in 0 1 2 3 4 5 6 7; do echo "  p$i: \"link[$((i * $2)):$((i * $2 + $2))]\""; done)
EOF
}

# tables FILE: what a run has printed, without the transport and the speed.
tables() {
    sed -e '1s/; [^;]*$//' -e '/^Speed/s/.*terms/terms/' "$1"
}

chain many 125
chain sums 200
"$portmetd" run "$folder/scene_many.yaml" --in-process --quiet --record "$folder/plain.h5" || fail "in process"
"$portmetd" run "$folder/scene_sums.yaml" --in-process >"$folder/plain.out" || fail "in process"

if ! nft add table ip loss 2>/dev/null || ! nft add chain ip loss input '{ type filter hook input priority 0; }' ||
    ! nft add rule ip loss input udp dport 7667 numgen random mod 50 == 0 counter drop; then
    echo "no nft here: nothing gets lost"
fi

# has_lost NAME COUNT: whether the run has told of as many deaths.
has_lost() {
    [ "$(grep -c 'killed by signal 9 (Killed), started again$' "$folder/$1.err")" -eq "$2" ]
}

# choices: holds at random steps, one in each of as many equal parts of the run, and when and who is killed.
choices() {
    awk -v seed="$seed" -v kills="$kills" -v steps="$steps" 'BEGIN {
        srand(seed)
        for (i = 0; i < kills; i++) {
            who = int(9 * rand())
            printf "%d:%s:%s ", 1 + int((steps - 1) * (i + rand()) / (kills + 1)), i % 2 ? "held" : "moving",
                who == 8 ? "coordinator" : "p" who
        }
    }'
}

# survives NAME ARGUMENT...: a run of the scene NAME under all kills.
survives() {
    scene_name=$1
    shift
    start "$scene_name" run "$folder/scene_$scene_name.yaml" --checkpoint "$folder/$scene_name" \
        --held "$@"
    run=$pid
    deaths=0
    for choice in $(choices); do
        step=${choice%%:*}
        goes_on "$folder/scene_$scene_name.yaml" "$step"
        find_child $run "${choice##*:}"
        case $choice in *:held:*) held "$scene_name" "$step" ;; esac
        kill -KILL "$victim" || fail "$scene_name: ${choice##*:} was gone before it was killed"
        deaths=$((deaths + 1))
        wait_until has_lost "$scene_name" $deaths || fail "$scene_name: expected $deaths deaths"
        [ $failures -eq 0 ] || finish
    done
    goes_on "$folder/scene_$scene_name.yaml"
    wait $run || fail "$scene_name: exit code $?"
    has_lost "$scene_name" "$kills" || fail "$scene_name: expected $kills deaths"
    [ -z "$(ls "$folder/$scene_name")" ] || fail "$scene_name: left $(ls "$folder/$scene_name")"
}

survives many --record "$folder/many.h5"
"$same_recording" "$folder/plain.h5" "$folder/many.h5" || fail "many: other bits"
survives sums
tables "$folder/plain.out" >"$folder/plain.tables"
tables "$folder/sums.out" | cmp -s - "$folder/plain.tables" || fail "sums: other tables"
echo "many, seed $seed: twice $deaths of $kills kills, $(nft list table ip loss 2>/dev/null | sed -n 's/.*packets \([0-9]*\).*/\1/p') datagrams lost"
no_orphans "at the end" ""
finish
