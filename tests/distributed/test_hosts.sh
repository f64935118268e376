#!/bin/sh
# test_hosts.sh PORTMETD MAKE_SCENE SAME_RECORDING: nodes on two and on three hosts, here network
# namespaces joined by virtual cables. A cut cable makes the run pause, and changes no bit when it is mended.
# Scenes side by side do not disturb each other.
. "$(dirname "$0")/network.sh"
url='udpm://239.255.76.67:7667?ttl=1'
steps=300

# A switch, and two more hosts with a cable to it each.
for i in 2 3; do
    unshare -n sleep 1000 &
    eval "host$i=$!"
    started="$started $!"
    wait_until has_own_network $! || fail "no host $i"
done
on() {
    eval "namespace=/proc/\$host$1/ns/net"
    shift
    nsenter --net="$namespace" "$@"
}
plug() {
    eval "process=\$host$1"
    ip link add "port$1" type veth peer name cable netns "$process" &&
        ip link set "port$1" master switch up &&
        on "$1" ip addr add "10.0.0.$1/24" dev cable &&
        on "$1" ip link set cable up &&
        on "$1" ip route add 224.0.0.0/4 dev cable
}
if ! { ip link add switch type bridge mcast_snooping 0 && ip addr add 10.0.0.1/24 dev switch &&
    ip link set switch up && ip route replace 224.0.0.0/4 dev switch && plug 2 && plug 3; }; then
    echo "skipped: no virtual cable or switch in this kernel"
    exit 77
fi

# start_on HOST NAME ARGUMENT...: as start, on host 2 or 3.
start_on() {
    number=$1
    name=$2
    shift 2
    eval "namespace=/proc/\$host$number/ns/net"
    nsenter --net="$namespace" "$portmetd" "$@" >"$folder/$name.out" 2>"$folder/$name.err" \
        </dev/null &
    pid=$!
    started="$started $pid"
}

# cut HOST: drops and counts all messages in either direction.
cut() {
    on "$1" nft add table ip cut 2>/dev/null || return
    for hook in input output; do
        on "$1" nft add chain ip cut $hook "{ type filter hook $hook priority 0; }"
        on "$1" nft add rule ip cut $hook udp dport 7667 counter drop
    done
}

# has_lost HOST HOOK: whether a message was to go out (output), or to come in (input), since the cut.
has_lost() {
    on "$1" nft list chain ip cut "$2" | grep -q 'packets [1-9]'
}

mend() {
    on "$1" nft delete table ip cut
}

"$portmetd" run "$scene" --in-process --quiet --steps $steps --record "$folder/plain.h5" ||
    fail "in process"

# Two hosts, or three: the coordinator is here. While the cable is cut, the coordinator says that the run
# pauses, and no step is made; when it is mended, the run goes on.
sed '/^time:/i lockstep: {patience: 1000}' "$scene" >"$folder/scene_patient.yaml"
for hosts in 2 3; do
    start_on $hosts left node "$folder/scene_patient.yaml" left --url "$url"
    left=$pid
    start_on 2 right node "$folder/scene_patient.yaml" right --url "$url"
    right=$pid
    record=$folder/hosts_$hosts.h5
    name=hosts_$hosts
    start $name coordinator "$folder/scene_patient.yaml" --steps $steps --url "$url" --record "$record" \
        --held
    coordinator=$pid
    goes_on "$folder/scene_patient.yaml" 100 --url "$url"
    held $name 100
    if cut 2; then
        goes_on "$folder/scene_patient.yaml" 200 --url "$url"
        for hook in input output; do
            wait_until has_lost 2 $hook || fail "nothing was lost: $hook"
        done
        awaits $name "the run pauses after step 100: no word from .*right"
        says $name "held after step 200" && fail "$name: steps were made across a cut cable"
        mend 2
        awaits $name "the run goes on"
    else
        goes_on "$folder/scene_patient.yaml" 200 --url "$url"
    fi
    held $name 200
    goes_on "$folder/scene_patient.yaml" "" --url "$url"
    ends $name $coordinator 0 ""
    ends left $left 0 ""
    ends right $right 0 ""
    "$same_recording" "$folder/plain.h5" "$record" || fail "$hosts hosts"
done

# By hand on one host: another scene on the same port, and the same scene on another port.
sed 's/^scene: pair/scene: other_pair/' "$scene" >"$folder/scene_other.yaml"
aside='udpm://239.255.76.67:7668?ttl=1'
side_by_side() {
    start "left_$1" node "$2" left --url "$3"
    started_by_hand="$started_by_hand left_$1:$pid"
    start "right_$1" node "$2" right --url "$3"
    started_by_hand="$started_by_hand right_$1:$pid"
    start "coordinator_$1" coordinator "$2" --quiet --steps $steps --url "$3" \
        --record "$folder/side_$1.h5"
    started_by_hand="$started_by_hand coordinator_$1:$pid"
}
started_by_hand=
side_by_side one "$scene" "$url"
side_by_side two "$folder/scene_other.yaml" "$url"
side_by_side three "$scene" "$aside"
for process in $started_by_hand; do
    ends "${process%:*}" "${process#*:}" 0 ""
done
for name in one two three; do
    "$same_recording" "$folder/plain.h5" "$folder/side_$name.h5" || fail "side by side: $name"
done
no_orphans "at the end" ""
finish
