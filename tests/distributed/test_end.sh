#!/bin/sh
# test_end.sh PORTMETD MAKE_SCENE SAME_RECORDING: however a run ends, every process ends, with an exit
# code and one line that name the cause.
. "$(dirname "$0")/network.sh"
forever=1000000000
sed '/^time:/i lockstep: {patience: 1}' "$scene" >"$folder/scene_hasty.yaml"
hasty=$folder/scene_hasty.yaml

# SIGINT and SIGTERM to the run. No process has threads, so that nothing is shared that could race
# (OpenBLAS would keep workers that it is told not to use).
export OPENBLAS_NUM_THREADS=1
for signal in INT TERM; do
    start run run "$scene" --quiet --steps $forever
    wait_for $pid left right
    for process in $pid "$(child $pid left)" "$(child $pid right)"; do
        [ "$(ls "/proc/$process/task" | wc -l)" -eq 1 ] || fail "process $process has threads"
    done
    kill -$signal $pid
    ends run $pid 12 "interrupted"
    no_orphans "run after SIG$signal"
done

# A node killed, and a node interrupted.
start run run "$scene" --quiet --steps $forever
wait_for $pid left right
kill -KILL "$(child $pid right)" || fail "no node to kill"
ends run $pid 7 "right"
no_orphans "run with a killed node"

start run run "$scene" --quiet --steps $forever
wait_for $pid left right
kill -TERM "$(child $pid left)" || fail "no node to interrupt"
ends run $pid 12 "left"
no_orphans "run with an interrupted node"

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

# By hand, where nobody watches the processes: a node killed, then a coordinator killed.
start left node "$hasty" left
left=$pid
start right node "$hasty" right
right=$pid
start coordinator coordinator "$hasty" --quiet --steps $forever --record "$folder/first.h5"
coordinator=$pid
wait_for_file "$folder/first.h5"
kill -KILL $right
ends coordinator $coordinator 8 "right"
ends left $left 8 "right"

start left node "$hasty" left
left=$pid
start right node "$hasty" right
right=$pid
start coordinator coordinator "$hasty" --quiet --steps $forever --record "$folder/second.h5"
wait_for_file "$folder/second.h5"
kill -KILL $pid
ends left $left 8 "no word from the coordinator"
ends right $right 8 "no word from the coordinator"

# A node that is paused: the coordinator says who is missing, and goes on with it.
start left node "$hasty" left
left=$pid
start right node "$hasty" right
right=$pid
start coordinator coordinator "$hasty" --steps 4000 --record "$folder/third.h5"
coordinator=$pid
wait_for_file "$folder/third.h5"
kill -STOP $right
sleep 0.8
kill -CONT $right
wait $coordinator || fail "coordinator of a paused node: does not end well"
grep -q "^portmetd: the run pauses after step [0-9]*: no word from right" "$folder/coordinator.err" ||
    fail "coordinator: does not tell of a pause"
tail -n 1 "$folder/coordinator.err" | grep -q "the run goes on" || fail "coordinator: does not go on"
ends left $left 0 ""
ends right $right 0 ""

# A node that was never started; one with other weights; one with another step.
start left node "$hasty" left
left=$pid
start coordinator coordinator "$hasty" --quiet
ends coordinator $pid 8 "nodes missing after 1.* s: right"
ends left $left 8 "nodes missing after 1.* s: right"

mkdir "$folder/other"
cp "$folder"/*.h5 "$folder/other"
cp "$folder/left.h5" "$folder/other/right.h5"
start left node "$scene" left
left=$pid
start right node "$scene" right --weights "$folder/other"
right=$pid
start coordinator coordinator "$scene" --quiet
ends coordinator $pid 7 "node right holds another scene"
ends left $left 7 "node right holds another scene"
ends right $right 7 "node right holds another scene"

# A second node, another one in the middle of a run, and a second coordinator: refused, and the run goes on.
start left node "$scene" left
left=$pid
for _ in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20; do
    grep -q ":1DF3 " /proc/net/udp && break # port 7667: it listens
    sleep 0.1
done
sleep 0.2
start second_left node "$scene" left
ends second_left $pid 7 "there is a node left of scene pair already"
start right node "$scene" right
right=$pid
start coordinator coordinator "$scene" --quiet --steps $forever --record "$folder/fourth.h5"
coordinator=$pid
wait_for_file "$folder/fourth.h5"
start third_left node "$scene" left
ends third_left $pid 7 "node left"
start second_coordinator coordinator "$scene" --quiet
ends second_coordinator $pid 7 "there is a coordinator of scene pair already"
kill -INT $coordinator
ends coordinator $coordinator 12 "interrupted"
ends left $left 12 "interrupted"
ends right $right 12 "interrupted"

# Without a route for multicast: the commands that mend it.
ip route del 224.0.0.0/4 dev lo
for command in run coordinator; do
    start $command $command "$scene"
    ends $command $pid 7 'run "ip link set lo multicast on" and "ip route add 224.0.0.0/4 dev lo"'
done

# Such a run leaves an older recording alone, and begins none.
echo old >"$folder/old.h5"
for name in old new; do
    start run run "$scene" --record "$folder/$name.h5"
    ends run $pid 7 'cannot'
done
[ "$(cat "$folder/old.h5")" = old ] || fail "a recording was overwritten by a run that never began"
[ ! -e "$folder/new.h5" ] || fail "a run that never began left a recording"

no_orphans "at the end"
finish
