#!/bin/sh
# test_relay.sh PORTMETD MAKE_SCENE SAME_RECORDING RELAY: between two hosts, each a network of its own, lies
# a cable that repeats messages and lets them overtake each other. The bits stay the same, also when a
# node dies behind it and returns.
. "$(dirname "$0")/network.sh"
relay=$4
steps=60
seed=$(date +%s)
echo "seed $seed"

unshare -n sleep 1000 &
host=$!
started="$started $host"
wait_until has_own_network $host || fail "no other host"
there() {
    nsenter --net="/proc/$host/ns/net" "$@"
}
there ip link set lo up
there ip link set lo multicast on
there ip route add 224.0.0.0/4 dev lo

# start_there NAME ARGUMENT...: as start, on the other host.
start_there() {
    name=$1
    shift
    nsenter --net="/proc/$host/ns/net" "$portmetd" "$@" >"$folder/$name.out" \
        2>"$folder/$name.err" </dev/null &
    pid=$!
    started="$started $pid"
}

"$portmetd" run "$scene" --in-process --quiet --steps $steps --record "$folder/plain.h5" ||
    fail "in process"
"$relay" $host 1000 "$seed" >"$folder/relay.out" &
cable=$!
started="$started $cable"
wait_until grep -q "^carries" "$folder/relay.out" || fail "no cable"

# kept NAME CHECKPOINTS: a run, left here and right there; CHECKPOINTS: options for all, in words, with which
# right is killed twice: while the run is held, and on its way.
kept() {
    open_gate "$1" 20
    start left node "$scene" left $2
    left=$pid
    start_there right node "$scene" right $2
    right=$pid
    start "$1" coordinator "$scene" --steps $steps --record "$folder/$1.h5" --gate "$folder/$1.gate" $2
    coordinator=$pid
    for gate in 20 40; do
        held "$1" $gate
        [ $gate -eq 20 ] || open_gate "$1" 50
        if [ -n "$2" ]; then
            kill -KILL $right || fail "$1: the run was over too early"
            start_there right node "$scene" right $2
            right=$pid
        fi
        [ $gate -eq 40 ] || open_gate "$1" 40
    done
    held "$1" 50
    open_gate "$1" $steps
    ends "$1" $coordinator 0 ""
    ends left $left 0 ""
    ends right $right 0 ""
    "$same_recording" "$folder/plain.h5" "$folder/$1.h5" || fail "$1: other bits"
}
kept calm ""
kept killed "--checkpoint $folder/killed"

kill -TERM $cable
wait $cable
cat "$folder/relay.out"
grep -Eq 'repeated [1-9][0-9]+, delayed [1-9][0-9]+' "$folder/relay.out" ||
    fail "the cable did nothing"
no_orphans "at the end" ""
finish
