#!/bin/sh
# test_key.sh PORTMETD MAKE_SCENE SAME_RECORDING HEARS_THE_SAME STRANGER CLOCK_AHEAD: a scene among
# strangers. What crashes LCM's decoders is dropped and counted; with a key, so is all that is forged, cut
# or replayed, and what comes from a host whose clock is wrong.
. "$(dirname "$0")/network.sh"
stranger=$5
clock_ahead=$6
steps=300
"$portmetd" run "$scene" --in-process --quiet --steps $steps --record "$folder/plain.h5" ||
    fail "in process"

# sent ROUNDS ECHOES: whether the stranger has sent at least as much.
sent() {
    read -r rounds echoes <<END
$(tail -n 1 "$folder/stranger.out")
END
    [ "${rounds:-0}" -ge "$1" ] && [ "${echoes:-0}" -ge "$2" ]
}

# beside MODE NAME SCENE: a run beside a stranger, which has sent much before it, and while it is held;
# ends well, and warns.
beside() {
    : >"$folder/stranger.out"
    "$stranger" "$1" 1000 >"$folder/stranger.out" &
    evil=$!
    started="$started $evil"
    wait_until sent 1 0 || fail "no stranger"
    start "$2" run "$3" --steps $steps --held --record "$folder/$2.h5"
    goes_on "$3" 100
    held "$2" 100
    sent 0 0
    more=$((echoes + 10))
    [ "$1" = echo ] || more=0
    wait_until sent $((rounds + 10)) $more || fail "$2: a silent stranger"
    goes_on "$3"
    wait $pid || fail "$2: among strangers"
    kill $evil
    "$same_recording" "$folder/plain.h5" "$folder/$2.h5" || fail "$2: other bits"
}

# counted NAME WORDS...: some line of warning has each of them.
counted() {
    name=$1
    shift
    for words in "$@"; do
        grep -q "warning: messages dropped:.* [1-9][0-9]* $words" "$folder/$name.err" ||
            fail "$name: not counted: $words"
    done
}

keyed=$folder/keyed.yaml
sed '1a key_file: pair.key' "$scene" >"$keyed"
(umask 077 && head -c 32 /dev/urandom >"$folder/pair.key")

# Who lacks the key is not heard. That takes as long as the patience; more is tested meanwhile, on another port.
sed '1a lockstep: {patience: 6}' "$scene" >"$folder/hasty.yaml"
sed '1a key_file: pair.key' "$folder/hasty.yaml" >"$folder/hasty_keyed.yaml"
aside='udpm://239.255.76.67:7668?ttl=0'
start left node "$folder/hasty.yaml" left --url "$aside"
left=$pid
start right node "$folder/hasty_keyed.yaml" right --url "$aside"
right=$pid
start coordinator coordinator "$folder/hasty_keyed.yaml" --quiet --url "$aside"
coordinator=$pid

beside plain open "$scene"
counted open "wrong size" "foreign type"

start alone run "$keyed" --quiet --steps $steps --record "$folder/alone.h5"
ends alone $pid 0 ""
"$same_recording" "$folder/plain.h5" "$folder/alone.h5" || fail "with a key"

beside echo sealed "$keyed"
counted sealed "not authentic"
"$portmetd" check "$keyed" | grep -q 'key .*pair.key' || fail "check: the key"

# A holder of the key whose clock is an hour fast is named, once, and does no harm.
start clocks run "$keyed" --steps $steps --held --record "$folder/clocks.h5"
clocks=$pid
goes_on "$keyed" 100
held clocks 100
export LD_PRELOAD=$clock_ahead
start surplus node "$keyed" left
unset LD_PRELOAD
surplus=$pid
awaits clocks "warning: clock of left@.* differs by 3600 s"
goes_on "$keyed"
wait $clocks || fail "clocks: beside a fast clock"
[ "$(grep -c '^portmetd: warning: clock of left@' "$folder/clocks.err")" -eq 1 ] || fail "clocks: told often"
counted clocks "ahead of the clock"
"$same_recording" "$folder/plain.h5" "$folder/clocks.h5" || fail "clocks: other bits"
kill $surplus
wait $surplus
counted surplus "replayed"

# Received by liblcm, too.
sed "2a url: 'udpm://239.255.76.67:7667?ttl=0&receive=lcm'" "$keyed" >"$folder/lcm.yaml"
beside echo lcm "$folder/lcm.yaml"
counted lcm "not authentic"

# Who was not heard.
wait $coordinator
[ $? -eq 8 ] || fail "coordinator: expected a silent node"
grep -q 'nodes missing after [0-9.]* s: left (with ttl=0' "$folder/coordinator.err" || fail "coordinator: names left"
counted coordinator "not authentic"
wait $left $right
counted left "wrong length"

# A key that is no key, or not secret.
chmod 644 "$folder/pair.key"
start shared run "$keyed"
ends shared $pid 4 'keyed.yaml:2:.*pair.key: others may use this key'
start shared check "$keyed"
ends shared $pid 4 'others may use this key'
chmod 600 "$folder/pair.key"
printf x >>"$folder/pair.key"
start long run "$keyed"
ends long $pid 4 '33 bytes, expected a key of 32'
no_orphans "at the end" ""
finish
