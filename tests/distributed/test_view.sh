#!/bin/sh
# test_view.sh PORTMETD MAKE_SCENE SAME_RECORDING VIEW_CLIENT: `portmetd view` shows a run that does not know
# of it, and a recording; serves its page to nobody but this host's browsers; and changes nothing.
. "$(dirname "$0")/network.sh"
command -v python3 >/dev/null || { echo "skipped: no python3"; exit 77; }
client=$4
port=8080

# client ARGUMENT...: what the client of the view prints, in $folder/client.out.
client() {
    python3 "$client" $port "$@" >"$folder/client.out" 2>"$folder/client.err"
}

# field EXPRESSION: whether it holds of the message m that the client printed.
field() {
    python3 -c 'import json, sys
m = json.load(open(sys.argv[1]))
sys.exit(0 if eval(sys.argv[2]) else 1)' "$folder/client.out" "$1" 2>"$folder/field.err"
}

# expect EXPRESSION
expect() {
    field "$1" || fail "expected $1, found $(head -c 700 "$folder/client.out")"
}

# answers CODE ARGUMENT...: the status with which the view answers a client.
answers() {
    code=$1
    shift
    client "$@"
    [ "$(head -n 1 "$folder/client.out")" = "$code" ] || fail "$*: expected $code, found $(cat "$folder/client.out")"
}

serves() {
    grep -q "http://" "$folder/$1.out" 2>"$folder/grep.log"
}

# The newest frame and health of a run are there.
shows_step() {
    client last && field "m['step'] == $1"
}

# --- without libwebsockets there is no page, and a line says so ---
start first view "$scene"
first=$pid
answered() {
    serves first || says first "built without libwebsockets"
}
wait_until answered || fail "first: no page"
if says first "built without libwebsockets"; then
    echo "skipped: portmetd was built without libwebsockets"
    exit 77
fi

# --- a run ---
client listen scene
expect "m['name'] == 'pair' and [n['name'] for n in m['nodes']][:2] == ['left', 'right']"
expect "m['edges'][0] == {'name': 'joint', 'a': 0, 'b': 1, 'count': 1} and m['recording'] is None"
"$portmetd" run "$scene" --in-process --quiet --steps 30 --record "$folder/plain.h5" || fail "plain run"
start run run "$scene" --steps 30 --held --record "$folder/run.h5"
run=$pid
goes_on "$scene" 20
held run 20
wait_until shows_step 20 || fail "the frame of step 20 never came: $(head -c 500 "$folder/client.out")"
expect "abs(sum(m['parts'][0]) - m['energy']) <= 1e-12 * sum(map(abs, m['parts'][0]))"
expect "len(m['parts'][1]) == 2 and m['violations'] == 0 and abs(m['energy_residual']) < 1e-12"
expect "abs(m['edges'][0][0] + m['edges'][1][0]) <= 1e-12 * abs(m['edges'][0][0]) != 0"
expect "m['edges'][2][0] + m['edges'][3][0] >= 0"
# Every sample counts, also those between two frames, and a frame holds their least and largest values.
expect "m['seen'] == 21 and len(m['states'][0]) > 2 and None not in m['states'][0]" # since the run is recorded
expect "all(a <= b for a, b in zip(m.get('low', [[]])[0], m.get('high', [[]])[0]))"
client listen health
expect "m['steps'] == 30 and [r['name'] for r in m['rows']] == ['left', 'right']"
expect "all(k in m['rows'][0] for k in ('waits_for', 'waits', 'busy', 'drops', 'loss', 'rate'))"

# What a client sends changes nothing.
client talk
expect "m['step'] <= 20"
start second view "$scene" --udp 9870
second=$pid
wait_until grep -q udp: "$folder/second.out" || fail "second: never ready"
port=9870
client datagram power &
listening=$!
wait_until grep -q '^ *[0-9]*: 0100007F:268E ' /proc/net/udp || fail "nobody listens at port 9870"
goes_on "$scene"
wait $listening || fail "no datagram"
expect "m['pair']['power']['joint'] != 0 and m['timestamp'] > 0 and set(m['pair']['energy']) == {'left', 'right'}"
port=8080
kill -TERM $second
ends second $second 12 "interrupted"
ends run $run 0 ""
"$same_recording" "$folder/plain.h5" "$folder/run.h5" || fail "a view has changed the run"
wait_until shows_step 30 || fail "the last frame never came"
shows_end() {
    client listen health && field "m['over']"
}
wait_until shows_end || fail "the end of the run never came"

# The next run has a session that no double holds; the page receives it whole.
odd=9007199254740993
shows_session() {
    client last && field "m['session'] == '$odd'"
}
for process in left right; do
    start "odd_$process" node "$scene" $process --session $odd
    eval "odd_$process=$pid"
done
start odd coordinator "$scene" --quiet --steps 5 --session $odd
ends odd $pid 0 ""
ends odd_left "$odd_left" 0 ""
ends odd_right "$odd_right" 0 ""
wait_until shows_session || fail "the session of the next run: $(head -c 100 "$folder/client.out")"
client listen frame
expect "m['step'] == 0 and abs(sum(m['parts'][0]) - m['energy']) <= 1e-12 * sum(map(abs, m['parts'][0]))"

# --- who may ask ---
answers 200 get /
grep -q '<title>portmet</title>' "$folder/client.out" || fail "the page is not there"
answers 200 get /view.js
cmp -s "$(dirname "$0")/../../daemon/view/view.js" - <<END || fail "another script is served"
$(sed 1d "$folder/client.out")
END
answers 200 get /view.css
answers 200 get / "Host: localhost:$port"
answers 404 get /../etc/passwd
answers 403 get / "Host: elsewhere.example:$port"
for method in POST PUT DELETE HEAD OPTIONS; do
    answers 405 send $method /
done
answers 403 listen scene "Origin: http://elsewhere.example"
answers 403 listen scene "Origin: null"
answers 403 listen scene "Origin: https://127.0.0.1:$port"
answers 403 listen scene "Host: elsewhere.example:$port" "Origin: http://elsewhere.example:$port"
client crowd 40 # those who sit there longest make room
expect "m['name'] == 'pair'"
client listen scene "Origin: http://127.0.0.1:$port"
expect "m['name'] == 'pair'"
[ -z "$(awk '$2 ~ /:1F90$/ && $2 !~ /^0100007F:/' /proc/net/tcp)" ] || fail "port 8080 is open beyond 127.0.0.1"
timeout 30 "$portmetd" view "$scene" >/dev/null 2>"$folder/taken.err"
[ $? -eq 7 ] && says taken "cannot listen on port 8080 of 127.0.0.1" || fail "a taken port"
kill -INT $first
ends first $first 12 "interrupted"

# --- a service, whose runs the page controls if it may ---
port=8082
# said WORD EXPRESSION: what the page is told when it asks for this.
said() {
    client ask "$1"
    expect "$2"
}
for control in "" "--control view"; do
    start serve serve "$scene" $control
    serve=$pid
    wait_until sh -c "'$portmetd' query '$scene' | grep -q '^pair: idle'" || fail "serve: not idle"
    start control view "$scene" --port $port
    wait_until serves control || fail "control: no page"
    if [ -z "$control" ]; then
        said query "m == {'allowed': False, 'said': ''}"
        said start "'without --control view' in m['said'] and not m['allowed']"
        "$portmetd" query "$scene" | grep -q '^pair: idle' || fail "a view has started a run that it must not"
    else
        said query "m == {'allowed': True, 'said': ''}"
        said step "'no run is under way' in m['said']"
        said start "m['said'] == ''"
        said reset "m['said'] == '' or 'no run is under way' in m['said']"
        "$portmetd" start "$scene" --held --endless >"$folder/held.out" || fail "start: $(cat "$folder/held.out")"
        said step "m['said'] == ''"
        said step "m['said'] == ''"
        "$portmetd" query "$scene" | grep -q 'held, run .*, step 2' || fail "step: $("$portmetd" query "$scene" | head -n 1)"
        said reset "m['said'] == ''"
        "$portmetd" query "$scene" | grep -q 'held, run .*, step 0' || fail "reset: $("$portmetd" query "$scene" | head -n 1)"
        said start "m['said'] == ''"
        said hold "m['said'] == ''"
        "$portmetd" query "$scene" | grep -q 'held, run ' || fail "hold"
        said stop "m['said'] == ''"
        "$portmetd" query "$scene" | grep -q ': ended, run ' || fail "stop"
        answers 403 listen control "Origin: http://elsewhere"
    fi
    kill -TERM $pid
    ends control $pid 12 "interrupted"
    kill -TERM $serve
    wait $serve || fail "serve: exit code $?"
done

# --- a recording ---
start recording view "$scene" --recording "$folder/plain.h5" --port 8081
recording=$pid
port=8081
wait_until serves recording || fail "recording: no page"
client listen scene
expect "[s['name'].split('.')[0] for s in m['states']] == sorted(s['name'].split('.')[0] for s in m['states'])"
expect "m['states'][0]['name'].startswith('left.') and m['states'][0]['unit'] != ''"
client listen frame
expect "m['step'] == 0 and m['violations'] == 0 and m['seen'] == 1"
python3 -c 'import h5py' 2>/dev/null && {
    client last
    python3 -c 'import h5py, json, sys
z = [v for part in ("left", "right") for v in h5py.File(sys.argv[2])["subsystems"][part]["z"][-1]]
found = json.load(open(sys.argv[1]))["states"][0]
sys.exit(len(z) != len(found) or any(abs(a - b) > 1e-12 * abs(a) for a, b in zip(z, found)))' \
        "$folder/client.out" "$folder/plain.h5" || fail "the states of the last frame"
}
wait_until shows_step 30 || fail "the last frame of the recording never came"
expect "abs(sum(m['parts'][0]) - m['energy']) <= 1e-12 * sum(map(abs, m['parts'][0])) and m['violations'] == 0"

# Violations of a recording are counted from its residuals.
sed 's/^scene:.*/&\nlaws: {energy: 0, entropy: 1.0}/' "$scene" >"$folder/exact.yaml"
start exact view "$folder/exact.yaml" --recording "$folder/plain.h5" --port 8083
port=8083
wait_until serves exact || fail "exact: no page"
wait_until shows_step 30 || fail "exact: the last frame never came"
expect "0 < m['violations'] <= 30"
kill -TERM $pid
ends exact $pid 12 "interrupted"
port=8081

# --- a large scene, of which a run records some parts ---
cat >"$folder/many.yaml" <<END
scene: many
time: {dt: 0.1, steps: 4, integrator: rk4, substeps: 2}
models:
  part: {energy: '|p|^2/2 + |q|^2/2', reversible: {given: [[q, p, 1.0]]}}
  joint: {law: bracket, reversible: {given: [[a.p, b.q, 1.0]]}}
subsystems:
  "m[0:1000]": {model: part, initial: {q: 0.1, p: 1.0}, state: {q: {unit: m, size: 1}, p: {unit: kg m/s, size: 1}}}
ports:
  "j[0:999]": {law: bracket, between: ["m[i]", "m[i+1]"], model: joint, expose: {"m[i]": p, "m[i+1]": q}}
record: {parts: [m0, "m[500:503]"]}
END
sed 's/^record:.*//' "$folder/many.yaml" >"$folder/all.yaml"
for name in many all; do
    "$portmetd" run "$folder/$name.yaml" --in-process --quiet --record "$folder/$name.h5" || fail "$name: run"
    start $name view "$folder/$name.yaml" --recording "$folder/$name.h5" --port 8082
    port=8082
    wait_until serves $name || fail "$name: no page"
    client listen scene
    if [ $name = many ]; then
        expect "[n['name'] for n in m['nodes']] == ['m0', 'm500', 'm501', 'm502'] and m['subsystems'] == 1000"
        expect "[e['name'] for e in m['edges']] == ['j500', 'j501']"
    else
        expect "len(m['nodes']) == 64 and m['nodes'][1]['count'] in (15, 16) and len(m['edges']) == 63"
    fi
    wait_until shows_step 4 || fail "$name: the last frame never came"
    expect "all(e > 0 for e in m['parts'][0])"
    expect "all(a + b == 0 != a for a, b in zip(m['edges'][0], m['edges'][1]))"
    kill -TERM $pid
    ends $name $pid 12 "interrupted"
done
port=8081

# --- a browser ---
# The browser's own clock may run ahead of a slow machine: then it draws again, for longer.
draws() {
    budget=$((${budget:-2500} * 2))
    timeout 60 chromium --headless=new --no-sandbox --disable-gpu --user-data-dir="$folder/browser" \
        --virtual-time-budget=$budget --dump-dom "http://127.0.0.1:$port/" >"$folder/page" 2>"$folder/browser.log"
    grep -q '<dd id="step">[0-9]* of' "$folder/page"
}
if command -v chromium >/dev/null; then
    wait_until draws || fail "the browser shows no step: $(tail -n 3 "$folder/browser.log")"
    grep -q '<h1 id="name">pair</h1>' "$folder/page" || fail "the browser shows no name"
    grep -q '<text [^>]*>left</text>' "$folder/page" || fail "the browser shows no graph"
    grep -q 'class="value[a-z ]*">[0-9.]* [a-zµ]*W</text>' "$folder/page" || fail "the browser shows no power"
    grep -q '<option value="state ' "$folder/page" || fail "the browser offers no states"
    grep -q 'aria-label="Energies over time, 2 curves"' "$folder/page" || fail "the browser draws no energies"
    for panel in "first law" "second law" "curves, first panel"; do
        grep -q "<button type=\"button\" aria-label=\"CSV, $panel\">" "$folder/page" || fail "the browser saves no $panel"
    done
    grep -q 'role="button" aria-pressed="false" aria-label="left, ' "$folder/page" || fail "no node for the keyboard"
else
    echo "no chromium here: the page is not drawn"
fi
kill -TERM $recording
ends recording $recording 12 "interrupted"
finish
