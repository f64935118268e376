#!/bin/sh
# test_serve.sh PORTMETD MAKE_SCENE SAME_RECORDING ADVANCE ADVANCE_PY: a scene that is served over LCM. Runs that clients start have
# the bits of the plain run, also where a process is killed within them. The service outlives failed runs, clients that
# die and requests that are not sound, and ends in order.
. "$(dirname "$0")/network.sh"
advance=$4
advance_py=$5
records=$folder/records
long=200000

# asks CODE TEXT COMMAND ARGUMENT...: a client ends with this exit code, and says TEXT.
asks() {
    code=$1 text=$2
    shift 2
    timeout 60 "$portmetd" "$1" "$scene" $(shift; echo "$@") >"$folder/asks.out" 2>&1
    found=$?
    [ $found -eq "$code" ] || fail "$*: expected exit code $code, found $found: $(cat "$folder/asks.out")"
    grep -q -e "$text" "$folder/asks.out" || fail "$*: expected \"$text\", found: $(cat "$folder/asks.out")"
}

# same NAME REFERENCE: two recordings have the same bits.
same() {
    "$same_recording" "$records/$1" "$folder/$2" >/dev/null || fail "$1: other numbers than $2"
}

"$portmetd" run "$scene" --steps 50 --in-process --record "$folder/plain.h5" --quiet || fail "the plain run"
"$portmetd" run "$scene" --steps 20 --in-process --record "$folder/short.h5" --quiet || fail "the short run"

# Runs one after another, without checkpoints.
start serve serve "$scene" --record "$records"
serve=$pid
wait_until sh -c "'$portmetd' query '$scene' | grep -q '^pair: idle'" || fail "serve: not idle"
asks 0 '"name":"left","groups":\[\["q","m",' query
asks 0 '"loss":[0-9.e+-]*,"verdict":"good"},' query
for i in 1 2 3; do
    asks 0 "step 50 of 50" start --steps 50 --wait --record "run$i.h5"
    same run$i.h5 plain.h5
done
asks 2 "letters, digits" start --record ../run.h5
[ ! -e "$folder/run.h5" ] || fail "a recording outside the folder"
ln -s "$folder/elsewhere.h5" "$records/link.h5"
asks 4 "is no file" start --record link.h5
[ ! -e "$folder/elsewhere.h5" ] || fail "a recording behind a link"

# A run that is held: its recording can be read meanwhile.
asks 0 "held, run 4 of .*, step 0" start --held --steps 50 --record held.h5 # what was refused is no run
asks 0 "step 20 of 50" advance --steps 20
asks 2 "refused: run .* is under way, after step 20" start
sleep 1
cp "$records/held.h5" "$folder/copy.h5"
"$same_recording" "$folder/copy.h5" "$folder/short.h5" >/dev/null || fail "a recording of a held run lacks steps"
asks 0 "" resume
wait_until sh -c "'$portmetd' query '$scene' | grep -q 'ended, run'" || fail "the run did not end"
same held.h5 plain.h5

# A client that dies while it waits leaves a run that is held after its steps, and another one takes over.
asks 0 "held, run .*, step 0" start --held --endless
"$portmetd" advance "$scene" --steps 3000 >"$folder/dies.out" 2>&1 &
client=$!
wait_until sh -c "'$portmetd' query '$scene' | grep -q running"
kill -KILL $client
wait_until sh -c "'$portmetd' status '$scene' | grep -q 'step 3000, .*, held'" || fail "status: not held"
asks 0 "step 3005" advance --steps 5
asks 0 "ended" stop

# States between steps: one that is kept is restored with its bits, in a later run as well.
asks 0 "held, run .*, step 0" start --held --steps 50 --trajectory 0
asks 0 "step 10 of" advance --steps 10
timeout 60 "$portmetd" checkpoint "$scene" ten >"$folder/ten.out" || fail "checkpoint"
asks 0 "step 10 of" set --state "$(sed -n 's/^state //p' "$folder/ten.out" | sed 's/[^,]*/0.5/')"
asks 0 "step 20 of" advance --steps 10
cp "$folder/asks.out" "$folder/other.out"
timeout 60 "$portmetd" restore "$scene" ten --held >"$folder/restored.out" || fail "restore"
sed 's/run [0-9]*/run/' "$folder/ten.out" >"$folder/ten"
sed 's/run [0-9]*/run/' "$folder/restored.out" | cmp - "$folder/ten" || fail "restore: another state"
asks 0 "step 20 of" advance --steps 10
cmp -s "$folder/asks.out" "$folder/other.out" && fail "set --state: the same states"
asks 0 "ended" stop
asks 2 "no run is under way" advance

# The examples in plain LCM, in C and in Python.
"$advance" pair 5 >"$folder/advance.out" 2>&1 || fail "advance: $(cat "$folder/advance.out")"
grep -q "^step 5, " "$folder/advance.out" || fail "advance: $(cat "$folder/advance.out")"
lcm-gen -p --ppath "$folder/types" "$(dirname "$0")/../../lcmtypes/portmet.lcm"
PYTHONPATH=$folder/types timeout 60 python3 "$advance_py" pair 5 >"$folder/python.out" 2>&1 || fail "advance.py"
cmp "$folder/advance.out" "$folder/python.out" || fail "advance.py: $(cat "$folder/python.out")"

# A process that is killed ends the run, and the next one can begin.
asks 0 "" start --steps $long
find_child $serve left
kill -KILL "$victim"
wait_until sh -c "'$portmetd' query '$scene' | grep -q 'ended, run'" || fail "the run did not end"
awaits serve "run .* ended after step .* a process was killed"
asks 0 "step 50 of 50" start --steps 50 --wait --record after.h5
same after.h5 plain.h5

# The scene is read again, unless it has a mistake.
cp "$scene" "$folder/good.yaml"
sed 's/^time:/tome:/' "$folder/good.yaml" >"$scene.new"
cp "$scene.new" "$scene"
"$portmetd" reload "$folder/good.yaml" >"$folder/asks.out" 2>&1 && fail "a scene with a mistake was read"
grep -q 'refused: .*"tome"' "$folder/asks.out" || fail "reload: $(cat "$folder/asks.out")"
kill -HUP $serve
awaits serve 'not read again: .*"tome"'
sed 's/dt: 0.05/dt: 0.025/' "$folder/good.yaml" >"$scene.new"
cp "$scene.new" "$scene"
asks 0 "" reload
asks 0 "step 40 of 40, 1 s" start --steps 40 --wait
cp "$folder/good.yaml" "$scene"
kill -HUP $serve
wait_until sh -c "'$portmetd' query '$scene' | grep -q '\"dt\":0.05'" || fail "SIGHUP: the scene was not read"
asks 0 "step 50 of 50" start --steps 50 --wait --record again.h5
same again.h5 plain.h5

# A second service of the scene is refused, with or without a run, and the first one does not notice. With a session
# of its own it is another service, and so is one of another scene: each has its runs.
asks 0 "held, run .*, step 0" start --held --steps 50 --record beside.h5
start second serve "$scene"
ends second $pid 7 "scene pair is served already, by process $serve on .*: give this one another --session"
sed 's/^scene: pair/scene: other_pair/' "$scene" >"$folder/other.yaml"
start numbered serve "$scene" --session 5 --record "$records"
numbered=$pid
start other serve "$folder/other.yaml" --record "$records"
other=$pid
asks 0 "step 20 of 50" advance --steps 20
asks 0 "step 50 of 50" start --session 5 --steps 50 --wait --record numbered.h5
timeout 60 "$portmetd" start "$folder/other.yaml" --steps 50 --wait --record other.h5 --quiet || fail "another scene"
asks 0 "held, run .*, step 20 of 50" query
asks 0 "" resume --steps 30
wait_until sh -c "'$portmetd' query '$scene' | grep -q 'held, run .* step 30 of 50'" || fail "resume --steps"
asks 0 "" resume
wait_until sh -c "'$portmetd' query '$scene' | grep -q 'ended, run'" || fail "the run beside others did not end"
for name in beside numbered other; do
    same $name.h5 plain.h5
done
start third serve "$scene" --session 5
ends third $pid 7 "of scene pair already\|scene pair is served already"
kill -TERM $numbered $other
wait $numbered $other || fail "services beside each other: exit code $?"

# The end of the service ends the run, and closes its recording.
asks 0 "" start --steps $long --record last.h5
kill -TERM $serve
wait $serve || fail "serve: exit code $?"
says serve "run .* ended after step .*: interrupted" || fail "serve: the last run has no end"
no_orphans "after serve"
asks 8 "no service" stop

# With checkpoints a run outlives the death of its processes.
# The service manager hears when all processes are there, and then every second from the loop that does the work: one
# that is stopped says nothing.
python3 -c 'import socket, struct, sys
heard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
heard.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
heard.bind(sys.argv[1])
while True:
    text, said = heard.recvmsg(512, 64)[:2]
    print(struct.unpack("3i", said[0][2])[0], text.decode().split()[0], flush=True)' \
    "$folder/notify" >"$folder/notify.out" &
started="$started $!"
wait_until test -S "$folder/notify" || fail "nobody listens for notices"
heard() {
    [ "$(grep -c "$1" "$folder/notify.out")" -ge "$2" ]
}
mkdir "$folder/checkpoints"
export NOTIFY_SOCKET="$folder/notify"
start kept serve "$scene" --record "$records" --checkpoint "$folder/checkpoints"
kept=$pid
unset NOTIFY_SOCKET
wait_until heard "^$kept READY=1" 1 || fail "serve is never ready"
"$portmetd" query "$scene" | grep -q '^pair: idle' || fail "ready before all processes are there"
wait_until heard "^$kept WATCHDOG=1" 2 || fail "the watchdog is not fed"
kill -STOP $kept
sleep 0.2
before=$(grep -c "^$kept " "$folder/notify.out")
sleep 2
[ "$(grep -c "^$kept " "$folder/notify.out")" -eq "$before" ] || fail "a service that is stopped feeds the watchdog"
kill -CONT $kept
"$portmetd" run "$scene" --steps 3000 --in-process --record "$folder/long.h5" --quiet || fail "the long run"
timeout 120 "$portmetd" start "$scene" --steps 3000 --wait --record long.h5 >"$folder/client.out" 2>&1 &
client=$!
for i in 1 2; do
    find_child $kept left
    kill -KILL "$victim"
    sleep 0.3
    find_child $kept right
    kill -KILL "$victim"
    sleep 0.3
done
wait $client || fail "a run with kills: $(cat "$folder/client.out")"
same long.h5 long.h5
# The run outlives the death of the service, too, and so do the requests of its clients.
timeout 120 "$portmetd" start "$scene" --steps 3000 --held --record outlives.h5 --quiet || fail "start --held"
timeout 120 "$portmetd" advance "$scene" --steps 2900 >"$folder/advance.out" 2>&1 &
client=$!
wait_until sh -c "'$portmetd' query '$scene' | grep -q 'running, run .*, step [1-9]'" || fail "the run does not go on"
kill -KILL $kept
wait $kept
start kept serve "$scene" --record "$records" --checkpoint "$folder/checkpoints"
kept=$pid
wait $client && grep -q "held, run .*, step 2900 of 3000" "$folder/advance.out" || fail "a client of a killed service: $(cat "$folder/advance.out")"
awaits kept "run .* of start@.*: goes on after step .*, recorded in"
timeout 120 "$portmetd" advance "$scene" --steps 100 --quiet || fail "advance"
same outlives.h5 long.h5
# Checkpoints of the scene as it was are no obstacle.
sed 's/dt: 0.05/dt: 0.025/' "$folder/good.yaml" >"$scene.new"
cp "$scene.new" "$scene"
asks 0 "" reload
asks 0 "step 40 of 40, 1 s" start --steps 40 --wait
cp "$folder/good.yaml" "$scene"
kill -TERM $kept
wait $kept || fail "serve with checkpoints: exit code $?"

# All subsystems in the service's own process.
start inside serve "$scene" --in-process --record "$records"
inside=$pid
asks 0 "step 50 of 50" start --steps 50 --wait --record inside.h5
same inside.h5 plain.h5
[ -z "$(children $inside)" ] || fail "serve --in-process has started processes"
kill -TERM $inside
wait $inside || fail "serve --in-process: exit code $?"

# A run answers clients like a service, and begins by itself. Clients reach the first of two, and only a service changes
# states. A run that is stopped ends well.
start run run "$scene" --steps 50 --held --record "$folder/held.h5"
run=$pid
asks 0 "held, run 1 of process $run on .*, step 20 of 50" advance --steps 20
asks 2 "refused: run 1 of process $run .* is under way, after step 20" start
asks 2 "refused: this run keeps its states" reset
start late run "$scene" --steps 10 --held
ends late $pid 7 "scene pair is served already, by process $run on"
start late serve "$scene"
ends late $pid 7 "scene pair is served already, by process $run on"
"$portmetd" run "$scene" --steps 50 --quiet --record "$folder/beside.h5" || fail "a run beside one that is held"
goes_on "$scene"
ends run $run 0 ""
for name in held beside; do
    "$same_recording" "$folder/$name.h5" "$folder/plain.h5" >/dev/null || fail "$name: other bits"
done
start run run "$scene" --steps $long --held --record "$folder/stopped.h5"
asks 0 "step 20 of" advance --steps 20
asks 0 "ended, run 1 of" stop
ends run $pid 0 ""
"$same_recording" "$folder/stopped.h5" "$folder/short.h5" >/dev/null || fail "a run that was stopped has other bits"

# Nodes that are started by hand serve one run after another, and outlive the coordinator.
for node in left right; do
    start $node node "$scene" $node --serve
done
for i in 1 2; do
    start elsewhere serve "$scene" --elsewhere --record "$records"
    elsewhere=$pid
    asks 0 "step 50 of 50" start --steps 50 --wait --record "there$i.h5"
    same there$i.h5 plain.h5
    kill -TERM $elsewhere
    wait $elsewhere || fail "serve --elsewhere: exit code $?"
done
finish
