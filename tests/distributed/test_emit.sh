#!/bin/sh
# test_emit.sh PORTMETD MAKE_SCENE SAME_RECORDING UNITS: what `portmetd emit` writes for systemd and for
# procman starts the processes of a scene, and the run has the bits of a run in one process. UNITS is
# the folder of the units that are installed with portmetd.
export TMPDIR=/srv # a unit does not see /tmp
. "$(dirname "$0")/network.sh"
units=$4
steps=100
url='udpm://239.255.76.67:7667?ttl=1'

"$portmetd" run "$scene" --in-process --quiet --steps $steps --record "$folder/plain.h5" || fail "in process"

# refuses PATTERN ARGUMENT...: emit ends with code 2 and this message.
refuses() {
    pattern=$1
    shift
    "$portmetd" emit "$@" >"$folder/refused.out" 2>&1
    [ $? -eq 2 ] && grep -q -e "$pattern" "$folder/refused.out" || fail "emit $*: $(cat "$folder/refused.out")"
}
refuses 'expected systemd or procman, found "upstart"' upstart "$scene"
refuses 'expected -o DIR' systemd "$scene"
refuses 'has no process called "middle"' procman "$scene" --hosts a,middle=b
refuses 'right has no host' procman "$scene" --hosts left=a
refuses 'is not the name of a host' procman "$scene" --hosts a,../b
refuses 'keeps messages on one host' procman "$scene" --hosts a,b
refuses 'expected an absolute path' procman "$scene" --record run.h5
refuses 'cannot be written' procman "$scene" --record "/tmp/a run.h5"

# runs NAME: waits for the processes that were started, and compares the recording.
runs() {
    for process in $running; do
        ends "${process%:*}" "${process#*:}" 0 ""
    done
    "$same_recording" "$folder/plain.h5" "$folder/$1.h5" || fail "$1: other bits"
}

# launch NAME COMMAND: starts one command line, such as "portmetd node SCENE left".
launch() {
    set -- "$1" $2
    name=$1
    shift 2
    start "$name" "$@"
    running="$running $name:$pid"
}

# --- procman ---

set -- --hosts one,two,coordinator=three --url "$url" --steps $steps
"$portmetd" emit procman "$scene" "$@" --record "$folder/procman.h5" -o "$folder/pair.pmd" || fail "procman"
[ "$("$portmetd" emit procman "$scene" "$@" --record "$folder/procman.h5")" = "$(cat "$folder/pair.pmd")" ] ||
    fail "procman: another text on standard output"
# One line for each command: its name, its host, what it executes.
awk '$1 == "cmd" { name = $2 } $1 == "exec" { sub(/^[^"]*"/, ""); sub(/";$/, ""); command = $0 }
    $1 == "host" { print name, $3, command }' "$folder/pair.pmd" | tr -d '";' >"$folder/commands"
for line in 'left one' 'right two' 'coordinator three'; do
    grep -q "^$line portmetd " "$folder/commands" || fail "procman: not $line: $(cat "$folder/commands")"
done
[ "$(wc -l <"$folder/commands")" -eq 3 ] || fail "procman: commands: $(cat "$folder/commands")"
running=
while read -r name host command; do
    launch "procman_$name" "$command"
done <"$folder/commands"
runs procman

# --- systemd ---

refuses 'write only below /var/lib/portmet' systemd "$scene" --record "$folder/run.h5" -o "$folder/hosts"
refuses 'do not see /home, /root' systemd "$scene" --weights /home/x/weights -o "$folder/hosts"
refuses 'write only below /var/lib/portmet' systemd "$scene" --record /var/lib/portmet/../run.h5 -o "$folder/hosts"
sed 's,left\.h5,/root/left.h5,' "$scene" >"$folder/hidden.yaml"
refuses '/root/left.h5: the units do not see /home, /root' systemd "$folder/hidden.yaml" -o "$folder/hosts"
# What is served has the runs that clients start.
set -- --hosts one,two,coordinator=three --url "$url"
refuses 'clients start the runs' systemd "$scene" "$@" --steps 3 -o "$folder/hosts"
"$portmetd" emit systemd "$scene" "$@" --record /var/lib/portmet/records -o "$folder/hosts" >"$folder/wrote" ||
    fail "systemd"
[ "$(wc -l <"$folder/wrote")" -eq 3 ] || fail "systemd: $(cat "$folder/wrote")"

# execute HOST UNIT INSTANCE SETTINGS: runs what UNIT@INSTANCE executes on a host. What units write to
# /var/lib/portmet lies in the test's folder.
execute() {
    grep -q "^Wants=$2@$3.service$" "$folder/hosts/$1/etc/systemd/system/portmet-pair.target" ||
        fail "systemd: the target on $1 does not start $2@$3"
    command=$(sed -n 's/^ExecStart=//p' "$units/$2@.service")
    for variable in SCENE PROCESS OPTIONS; do
        value=$(sed -n "s/^PORTMET_$variable=//p" "$folder/hosts/$1/etc/portmet/$4.env" |
            sed "s,/var/lib/portmet/,$folder/unit_,g; s/[&,\]/\\&/g")
        command=$(printf %s "$command" | sed "s,\${PORTMET_$variable},$value,; s,\$PORTMET_$variable,$value,")
    done
    launch "$4" "$command"
    eval "$(echo "$4" | tr - _)=$pid"
}
execute one portmet-node pair-left node-pair-left
execute two portmet-node pair-right node-pair-right
execute three portmetd pair pair
# A node and the service, when they are killed and started again by their units, go on.
timeout 60 "$portmetd" start "$scene" --url "$url" --steps $steps --held --record systemd.h5 --quiet || fail "systemd: start"
for unit in node_pair_left pair; do
    timeout 60 "$portmetd" advance "$scene" --url "$url" --steps 30 --quiet || fail "systemd: advance"
    eval "process=\$$unit"
    kill -KILL "$process"
    wait "$process"
    case $unit in
    pair) execute three portmetd pair pair ;;
    *) execute one portmet-node pair-left node-pair-left ;;
    esac
done
[ -n "$(ls "$folder"/unit_pair-left)" ] || fail "systemd: no checkpoints"
wait_until sh -c "'$portmetd' query '$scene' --url '$url' | grep -q 'held, run .*step 60 of'" || fail "systemd: not held"
timeout 60 "$portmetd" resume "$scene" --url "$url" --quiet || fail "systemd: resume"
wait_until sh -c "'$portmetd' query '$scene' --url '$url' | grep -q 'ended, run .*step $steps of'" || fail "systemd: no end"
"$same_recording" "$folder/plain.h5" "$folder/unit_records/systemd.h5" || fail "systemd: other bits"
kill -TERM "$pair" "$node_pair_left" "$node_pair_right"
wait "$pair" || fail "systemd: the service ends with $?"

# A scene without checkpoints gets none.
sed "s/rk4, substeps: 2/rk4, tolerance: 1.0e-4/" "$scene" >"$folder/adaptive.yaml"
"$portmetd" emit systemd "$folder/adaptive.yaml" -o "$folder/adaptive" >"$folder/wrote" || fail "adaptive"
grep -q '^PORTMET_OPTIONS=$' "$folder/adaptive/localhost/etc/portmet/node-pair-left.env" ||
    fail "systemd: checkpoints of a scene that cannot have any"

# systemd finds nothing to object to.
if command -v systemd-analyze >/dev/null; then
    for host in one two three; do
        mkdir "$folder/$host"
        cp "$folder/hosts/$host"/etc/systemd/system/* "$folder/$host"
        for unit in portmet-node portmetd; do
            sed "s,^ExecStart=[^ ]*,ExecStart=$portmetd," "$units/$unit@.service" >"$folder/$host/$unit@.service"
        done
        systemd-analyze verify --man=no "$folder/$host/portmet-pair.target" >"$folder/verify.out" 2>&1 ||
            fail "systemd-analyze: $(cat "$folder/verify.out")"
        [ ! -s "$folder/verify.out" ] || fail "systemd-analyze: $(cat "$folder/verify.out")"
    done
fi
no_orphans "at the end" ""
finish
