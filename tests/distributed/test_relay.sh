#!/bin/sh
# test_relay.sh PORTMETD MAKE_SCENE SAME_RECORDING RELAY: between two hosts, each a network of its own, lies
# a cable that repeats messages and lets them overtake each other. The bits stay the same, also when a
# node dies behind it and returns.
. "$(dirname "$0")/network.sh"
relay=$4
steps=200
seed=$(date +%s)
echo "seed $seed"

unshare -n sleep 100 &
host=$!
started="$started $host"
sleep 0.2
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
"$relay" $host 90 "$seed" >"$folder/relay.out" &
cable=$!
started="$started $cable"

# kept NAME CHECKPOINTS: a run, left here and right there; CHECKPOINTS: options for all, in words.
kept() {
    start left node "$scene" left $2
    left=$pid
    start_there right node "$scene" right $2
    right=$pid
    start coordinator coordinator "$scene" --quiet --steps $steps --record "$folder/$1.h5" $2
    coordinator=$pid
    if [ -n "$2" ]; then
        sleep 0.5
        kill -KILL $right || fail "the run was over too early"
        start_there right node "$scene" right $2
        right=$pid
    fi
    ends coordinator $coordinator 0 ""
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
no_orphans "at the end"
finish
