#!/bin/sh
# test_end.sh PORTMETD MAKE_SCENE SAME_RECORDING: however a run ends, every process ends, with an exit
# code and one line that name the cause.
. "$(dirname "$0")/network.sh"
forever=1000000000

# with_patience NAME SECONDS: a scene of which several runs may go on beside others, each with a session.
with_patience() {
    sed "/^time:/i lockstep: {patience: $2}" "$scene" >"$folder/$1.yaml"
}
with_patience hasty 6
with_patience patient 1000 # longer than any test takes

# datagrams: how many this network has carried.
datagrams() {
    awk '/^Udp:/ { count = $5 } END { print count }' /proc/net/snmp
}
more_datagrams_than() {
    [ "$(datagrams)" -gt "$1" ]
}

# by_hand NAME SCENE SESSION STEP: two nodes and a coordinator, whose process ids are then in $NAME_left,
# $NAME_right and $NAME_coordinator; held after step GATE.
by_hand() {
    for node in left right; do
        start "$1_$node" node "$2" $node --session "$3"
        eval "$1_$node=$pid"
    done
    start "$1" coordinator "$2" --steps $forever --session "$3" --held
    eval "$1_coordinator=$pid"
    goes_on "$2" "$4" --session "$3"
    held "$1" "$4"
}

# A second node, another one in the middle of a run, and a second coordinator: refused, and the run goes on.
# The first node is there as soon as it has said hello.
before=$(datagrams)
start left node "$scene" left
left=$pid
wait_until more_datagrams_than "$before" || fail "left: no hello"
start second_left node "$scene" left
ends second_left $pid 7 "there is a node left of scene pair already"
start right node "$scene" right
right=$pid
start coordinator coordinator "$scene" --steps $forever --held
coordinator=$pid
goes_on "$scene" 5
held coordinator 5
for hold in 5 $forever; do
    goes_on "$scene" $hold
    start third_left node "$scene" left
    ends third_left $pid 7 "node left"
    start second_coordinator coordinator "$scene" --quiet
    ends second_coordinator $pid 7 "there is a coordinator of scene pair already"
done
kill -INT $coordinator
ends coordinator $coordinator 12 "interrupted"
ends left $left 12 "interrupted"
ends right $right 12 "interrupted"

# A node with other weights. The other node has joined by then, so that it hears how the run ends.
mkdir "$folder/other"
cp "$folder"/*.h5 "$folder/other"
cp "$folder/left.h5" "$folder/other/right.h5"
start left node "$scene" left
left=$pid
start coordinator coordinator "$scene" --quiet
coordinator=$pid
await_missing "$scene" right
start right node "$scene" right --weights "$folder/other"
ends right $pid 7 "node right holds another scene"
ends coordinator $coordinator 7 "node right holds another scene"
ends left $left 7 "node right holds another scene"

# By hand, where nobody watches the processes: a node killed, a coordinator killed, a node that is paused,
# and one that was never started. What ends them takes seconds; more is tested meanwhile.
hasty=$folder/hasty.yaml
by_hand widow "$hasty" 101 20
kill -KILL $widow_right
by_hand orphan "$hasty" 102 20
kill -KILL $orphan_coordinator
by_hand sleeper "$folder/patient.yaml" 103 20
kill -STOP $sleeper_right
start lonely_left node "$hasty" left --session 104
lonely_left=$pid
start lonely coordinator "$hasty" --quiet --session 104
lonely_coordinator=$pid
start far node "$hasty" left --session 105 --url 'udpm://239.255.76.67:7667?ttl=1'
far=$pid

# SIGINT, SIGTERM and SIGHUP to the run, held and on its way. No process has threads, so that nothing is shared that
# could race (OpenBLAS would keep workers that it is told not to use).
export OPENBLAS_NUM_THREADS=1
# begin: a run that is held after step 20; its process ids in $run, $left and $right.
begin() {
    start run run "$scene" --steps $forever --held
    run=$pid
    goes_on "$scene" 20
    held run 20
    find_child $run left
    left=$victim
    find_child $run right
    right=$victim
}
for hold in 20 $forever; do
    for signal in INT TERM HUP; do
        begin
        for process in $run $left $right; do
            [ "$(ls "/proc/$process/task" | wc -l)" -eq 1 ] || fail "process $process has threads"
        done
        goes_on "$scene" $hold
        kill -$signal $run
        ends run $run 12 "interrupted"
        no_orphans "run after SIG$signal"
    done
done

# A terminal that is closed: with checkpoints nothing starts again, and nohup protects from it.
start run run "$scene" --steps $forever --held --checkpoint "$folder/hung"
run=$pid
goes_on "$scene" 20
held run 20
find_child $run left
kill -HUP $victim
ends run $run 12 "left"
trap '' HUP
begin
trap - HUP
kill -HUP $run $left $right
goes_on "$scene" 40
held run 40
kill -TERM $run
ends run $run 12 "interrupted"
no_orphans "run after SIGHUP"

# A node killed, and a node interrupted.
for hold in 20 $forever; do
    begin
    goes_on "$scene" $hold
    kill -KILL $right || fail "no node to kill"
    ends run $run 7 "right"
    no_orphans "run with a killed node"

    begin
    goes_on "$scene" $hold
    kill -TERM $left || fail "no node to interrupt"
    ends run $run 12 "left"
    no_orphans "run with an interrupted node"
done

# A flux that is not finite: five steps are made before it, and told of.
cat >"$folder/scene_huge.yaml" <<END
scene: huge
time: {dt: 1.0e-153, steps: 40, integrator: euler}
models:
  part: {energy: "1.0e153*(x + x^2/2)"}
  joint: {law: bracket, reversible: {given: [[a.x, b.x, 1.0]]}}
subsystems:
  left: {model: part, state: {x: {unit: m, size: 1}}, initial: {x: 3.0}}
  right: {model: part, state: {x: {unit: m, size: 1}}, initial: {x: 0.0}}
ports:
  joint: {law: bracket, between: [left, right], expose: {left: x, right: x}, model: joint}
END
start huge run "$folder/scene_huge.yaml"
ends huge $pid 9 "a flux is not finite in step 6"
grep -q "terms evaluated 20, skipped 10" "$folder/huge.out" || fail "huge: steps before are not told of"
no_orphans "run with a flux that is not finite"

# What was begun above.
ends widow $widow_coordinator 8 "right"
ends widow_left $widow_left 8 "right"
ends orphan_left $orphan_left 8 "no word from the coordinator"
ends orphan_right $orphan_right 8 "no word from the coordinator"
ends lonely $lonely_coordinator 8 "nodes missing after [0-9.]* s: right"
ends lonely_left $lonely_left 8 "nodes missing after [0-9.]* s: right"
# The hint at ttl=0 is for those whose messages stay on this host.
says lonely "(with ttl=0 in the URL" || fail "lonely: no hint"
ends far $far 8 "no coordinator of scene .* answered within [0-9.]* s$"
# The coordinator says who is missing, and goes on with it.
awaits sleeper "^portmetd: the run pauses after step 20: no word from right"
kill -CONT $sleeper_right
goes_on "$folder/patient.yaml" 40 --session 103
held sleeper 40
awaits sleeper "^portmetd: the run goes on"
kill -INT $sleeper_coordinator
for name in coordinator left right; do
    eval "wait \$sleeper_$name"
    [ $? -eq 12 ] || fail "sleeper: $name: expected an interrupted run"
done

# Without a route for multicast: the commands that mend it.
ip route del 224.0.0.0/4 dev lo
remedy='run "ip link set lo up", "ip link set lo multicast on" and "ip route add 224.0.0.0/4 dev lo"'
for command in run coordinator; do
    start $command $command "$scene"
    ends $command $pid 7 "$remedy"
done

# Such a run leaves an older recording alone, and begins none.
echo old >"$folder/old.h5"
for name in old new; do
    start run run "$scene" --overwrite --record "$folder/$name.h5"
    ends run $pid 7 'cannot'
done
[ "$(cat "$folder/old.h5")" = old ] || fail "a recording was overwritten by a run that never began"
[ ! -e "$folder/new.h5" ] || fail "a run that never began left a recording"

no_orphans "at the end" ""
finish
