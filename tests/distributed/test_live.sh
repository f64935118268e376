#!/bin/sh
# test_live.sh PORTMETD MAKE_SCENE SAME_RECORDING HEARS_THE_SAME STRANGER SWING CONFIGS PYTHON: a
# program drives a run over LCM, is killed and started again, and the run can be repeated with the same bits.
. "$(dirname "$0")/network.sh"
swing=$6
configs=$7
sed -e "s|weights/|$configs/weights/|" -e '/pace:/d' "$configs/live_double_pendulum.yaml" >"$folder/live.yaml"

# A run that begins without its controller waits for it, and says so.
start run run "$folder/live.yaml" --steps 120 --held --record "$folder/live.h5"
run=$pid
goes_on "$folder/live.yaml" 40
awaits run "warning: the run waits after step 0 for a message on PIVOT"
"$swing" &
controller=$!
started="$started $controller"
awaits run "held after step 40"

# The controller is killed and started again.
kill -KILL $controller
wait $controller 2>/dev/null
goes_on "$folder/live.yaml"
awaits run "warning: the run waits after step 4[01] for a message on PIVOT"
"$swing" &
controller=$!
started="$started $controller"
wait $run || fail "a run that waited twice"
grep -q "steps in violation: 0" "$folder/run.out" || fail "a law is violated"

# The same bits: from the recording in one process and over LCM, and from a new controller.
"$portmetd" run "$folder/live.yaml" --steps 120 --quiet --in-process --replay "$folder/live.h5" \
    --record "$folder/here.h5" || fail "replay in process"
"$same_recording" "$folder/live.h5" "$folder/here.h5" || fail "replay in process: other bits"
"$portmetd" run "$folder/live.yaml" --steps 120 --quiet --record "$folder/again.h5" || fail "again"
"$same_recording" "$folder/live.h5" "$folder/again.h5" || fail "a new controller: other bits"
kill $controller
wait $controller 2>/dev/null
"$portmetd" test "$folder/live.yaml" --replay "$folder/live.h5" >"$folder/test.out" || fail "replay: $(cat "$folder/test.out")"

# What cannot be.
start short run "$folder/live.yaml" --steps 121 --in-process --replay "$folder/live.h5"
ends short $pid 5 "expected a run of at most 120 steps, found 121: $folder/live.h5: the recording that is replayed ends after step 120"
start longer run "$folder/live.yaml" --steps 121 --replay "$folder/live.h5"
ends longer $pid 5 "expected a run of at most 120 steps, found 121: "
start tested test "$folder/live.yaml" --steps 121 --replay "$folder/live.h5"
ends tested $pid 5 "expected a run of at most 120 steps, found 121: "
sed -e 's/^scene: .*/scene: another/' "$folder/live.yaml" >"$folder/another.yaml"
start another run "$folder/another.yaml" --in-process --replay "$folder/live.h5"
ends another $pid 5 "a recording of scene live_double_pendulum, expected one of another"
start without run "$folder/live.yaml" --in-process
ends without $pid 2 "live inputs arrive over LCM"
start kept run "$folder/live.yaml" --checkpoint "$folder/kept"
ends kept $pid 3 "has live inputs"
start other run "$scene" --in-process --replay "$folder/live.h5"
ends other $pid 3 "has no live inputs"

# The controller in Python sends the same values.
package=$8
if /usr/bin/python3 -c "import h5py, numpy" 2>/dev/null; then
    PYTHONPATH=$package /usr/bin/python3 "$(dirname "$0")/../../daemon/examples/swing.py" &
    controller=$!
    started="$started $controller"
    "$portmetd" run "$folder/live.yaml" --steps 120 --quiet --record "$folder/python.h5" || fail "Python"
    "$same_recording" "$folder/live.h5" "$folder/python.h5" || fail "Python: other bits"
    kill $controller
    wait $controller 2>/dev/null
else
    echo "no h5py and numpy here: the controller in Python is not tried"
fi

# A program may send a message type of its own.
sed -e 's/wait: true/wait: true, message: [int64_t step, int32_t n, "double v[2]"]/' \
    -e 's/\[vx, vy\]/[v_0, v_1]/' "$folder/live.yaml" >"$folder/own.yaml"
"$swing" &
controller=$!
started="$started $controller"
"$portmetd" run "$folder/own.yaml" --steps 120 --quiet --record "$folder/own.h5" || fail "own type"
kill $controller
wait $controller 2>/dev/null
"$portmetd" run "$folder/own.yaml" --steps 120 --quiet --in-process --replay "$folder/own.h5" \
    --record "$folder/own_again.h5" || fail "own type again"
"$same_recording" "$folder/own.h5" "$folder/own_again.h5" || fail "own type: other bits"

# A value that holds until the next one comes; a silent program ends the run.
sed -e 's/wait: true/start: [0.1, 0], age: 3/' "$folder/live.yaml" >"$folder/newest.yaml"
start newest run "$folder/newest.yaml" --steps 100000000
newest=$pid
"$swing" &
controller=$!
started="$started $controller"
sent() {
    "$portmetd" status "$folder/newest.yaml" 2>/dev/null | grep -q "step [1-9]"
}
wait_until sent || fail "newest: no step"
kill -KILL $controller
wait $controller 2>/dev/null
ends newest $newest 8 "no message on PIVOT for"

# Steps follow the clock: 40 steps of 0.05 s, ten times as fast.
sed -e 's/^  integrator:/  pace: 10\n  integrator:/' "$folder/live.yaml" >"$folder/paced.yaml"
for where in "" --in-process; do
    begun=$(date +%s%N)
    "$portmetd" run "$folder/paced.yaml" --steps 40 --replay "$folder/live.h5" $where \
        >"$folder/paced.out" || fail "paced $where"
    [ $(($(date +%s%N) - begun)) -ge 195000000 ] || fail "paced $where: too fast"
    grep -q "^Pace: 10 simulated s per s; [0-9]* of 40 steps" "$folder/paced.out" || fail "paced $where"
done
finish
