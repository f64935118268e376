#!/bin/sh
# test_replay.sh PORTMETD MAKE_SCENE SAME_RECORDING REPLAYER: with a key, messages of an earlier run that somebody
# sends again within seconds end no run, and let no process join a run that is over.
. "$(dirname "$0")/network.sh"
replayer=$4
steps=400
keyed=$folder/keyed.yaml
sed -e '1a key_file: pair.key' -e '/^time:/i lockstep: {patience: 60, checkpoint: 50}' "$scene" >"$keyed"
(umask 077 && head -c 32 /dev/urandom >"$folder/pair.key")
"$portmetd" run "$keyed" --in-process --quiet --steps $steps --record "$folder/plain.h5" || fail "in process"

# hears WORD: records what is sent on such channels from now on, in WORD.bytes.
hears() {
    "$replayer" record "$folder/$1.bytes" "$1" >"$folder/$1.out" &
    ear=$!
    started="$started $ear"
    wait_until grep -q listening "$folder/$1.out" || fail "$1: nobody listens"
}

# repeats WORD SECONDS: ends the recording once it has something, and sends that again; begins before this
# returns.
repeats() {
    wait_until test -s "$folder/$1.bytes" || fail "$1: nothing was sent"
    kill $ear
    "$replayer" replay "$folder/$1.bytes" "$2" >"$folder/$1.sent" &
    mouth=$!
    started="$started $mouth"
}

# The ABORT of a run that was interrupted does not end the run that continues it, in the same session.
hears COMMAND
start first run "$keyed" --steps $steps --checkpoint "$folder/saved" --held \
    --record "$folder/run.h5"
first=$pid
goes_on "$keyed" 100
held first 100
kill -INT $first
wait $first
[ $? -eq 12 ] || fail "first: expected an interrupted run"
repeats COMMAND 6
start again run "$keyed" --steps $steps --checkpoint "$folder/saved" --held \
    --record "$folder/run.h5"
again=$pid
goes_on "$keyed" 200
held again 200
wait $mouth
cat "$folder/COMMAND.sent"
goes_on "$keyed"
wait $again || fail "again: an old command ended it"
"$same_recording" "$folder/plain.h5" "$folder/run.h5" || fail "again: other bits"

# The ticks of a run by hand do not let the nodes of the next one join it.
by_hand() {
    start coordinator coordinator "$keyed" --quiet --steps $steps --record "$folder/$1.h5"
    coordinator=$pid
}
nodes() {
    for name in left right; do
        start $name node "$keyed" $name
        eval "$name=$pid"
    done
}
all_end() {
    for name in coordinator left right; do
        eval "wait \$$name" || fail "$1: $name ended with $?"
    done
    "$same_recording" "$folder/plain.h5" "$folder/$1.h5" || fail "$1: other bits"
}
hears TICK
by_hand before
nodes
all_end before
nodes
repeats TICK 4
sleep 2
by_hand after
all_end after
wait $mouth
cat "$folder/TICK.sent"
no_orphans "at the end" ""
finish
