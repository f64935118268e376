#!/bin/sh
# test_status.sh PORTMETD MAKE_SCENE SAME_RECORDING: `portmetd status`, SIGUSR1 and warnings name a part
# that is slow, a process whose messages get lost and one that is stopped; a service manager is told.
. "$(dirname "$0")/network.sh"
forever=1000000000
sed -e '/^time:/i lockstep: {patience: 1000}' -e 's/right\.h5/slow.h5/' "$scene" >"$folder/patient.yaml"

# shows PATTERN: whether the state of the run has such a line.
shows() {
    "$portmetd" status "$folder/patient.yaml" >"$folder/status.out" 2>"$folder/status.err" || return 1
    grep -q -e "$1" "$folder/status.out"
}

# comes_to_show PATTERN
comes_to_show() {
    wait_until shows "$1" || { cat "$folder/status.out"; fail "status: never \"$1\""; }
}

# Nobody runs.
start nobody status "$folder/patient.yaml"
ends nobody $pid 8 "no run of scene pair says within 4 s how it is doing"

# A run that waits for a node says which one.
start coordinator coordinator "$folder/patient.yaml" --steps $forever
coordinator=$pid
start left node "$folder/patient.yaml" left
left=$pid
comes_to_show "; right is missing"
start right node "$folder/patient.yaml" right
right=$pid
comes_to_show "^right  *[1-9][0-9]* .* none "
grep -q "^left  *[1-9][0-9]* " "$folder/status.out" || fail "status: left is missing"

# A slow part: it computes for nearly all of the time.
comes_to_show "; all others wait for right"
grep -q "^left .* right [0-9]* %" "$folder/status.out" || fail "status: left does not wait for right"
awaits coordinator "warning: right makes all others wait"

# The same on request.
kill -USR1 $coordinator
awaits coordinator "^right  *[1-9][0-9]* "

# A link that loses what right sends.
port_of() {
    for socket in $(ls -l "/proc/$1/fd" | sed -n 's/.*socket:\[\([0-9]*\)\].*/\1/p'); do
        awk -v inode="$socket" '$10 == inode { split($2, at, ":"); print at[2] }' /proc/net/udp
    done | grep -v -e 1DF3 -e 0000 | head -n 1
}
port=$(port_of $right)
if [ -n "$port" ] && nft add table ip loss 2>/dev/null &&
    nft add chain ip loss input '{ type filter hook input priority 0; }' &&
    nft add rule ip loss input udp sport "$((0x$port))" numgen random mod 4 == 0 counter drop; then
    comes_to_show "; [0-9]* % lost from right to left"
    awaits coordinator "warning: left had to be sent .* of the messages of right again"
    nft delete table ip loss
else
    echo "no nft here: loss is not shown"
fi

# A process that is stopped.
kill -STOP $right
comes_to_show "; right is silent"
awaits coordinator "the run pauses after step .*: no word from right"
kill -CONT $right

kill -INT $coordinator
for name in coordinator left right; do
    eval "wait \$$name"
    [ $? -eq 12 ] || fail "$name: expected an interrupted run"
done
# A service manager, which listens on a socket.
if command -v python3 >/dev/null; then
    python3 -c 'import socket, sys
manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
manager.bind(sys.argv[1])
manager.settimeout(60)
while True:
    print(manager.recv(4096).decode().replace("\n", " "), flush=True)
' "$folder/manager" >"$folder/manager.err" 2>/dev/null &
    manager=$!
    started="$started $manager"
    wait_until test -S "$folder/manager" || fail "no service manager"
    export NOTIFY_SOCKET="$folder/manager"
    # A client that finds no run, and a coordinator that is not open yet, are not ready.
    timeout 5 "$portmetd" status "$folder/patient.yaml" >"$folder/nobody.out" 2>&1 && fail "a status of nobody"
    says manager READY && fail "a client says READY=1"
    start managed coordinator "$folder/patient.yaml" --steps $forever
    managed=$pid
    awaits manager "^READY=1$"
    unset NOTIFY_SOCKET
    for name in left right; do
        start $name node "$folder/patient.yaml" $name
        eval "$name=$pid"
    done
    awaits manager "^WATCHDOG=1 STATUS=step [1-9][0-9]* of $forever, [0-9.e+]* steps/s$"
    kill -INT $managed
    wait $managed
    wait $left $right
    kill $manager
    rm "$folder/manager.err"
fi

# As JSON.
start told run "$folder/patient.yaml" --steps $forever --log=json
told=$pid
comes_to_show "^left  *[1-9][0-9]* "
is_told() {
    kill -USR1 $told || return
    sleep 0.2
    says told '"part":"left","message":"status of left","fields":{"step":[1-9]'
}
wait_until is_told || fail "told: no status of left"
kill -INT $told
wait $told
[ $? -eq 12 ] || fail "told: expected an interrupted run"
grep -v '^{"time":".*","level":"[a-z]*","part":"[a-z]*","message":".*","fields":{.*}}$' "$folder/told.err" &&
    fail "told: expected lines of JSON alone"
no_orphans "at the end" ""
finish
