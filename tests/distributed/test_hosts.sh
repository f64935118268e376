#!/bin/sh
# test_hosts.sh PORTMETD MAKE_SCENE SAME_RECORDING: nodes on two hosts, here two network namespaces
# joined by a virtual cable. A cable that is cut for a moment changes nothing.
. "$(dirname "$0")/network.sh"
url='udpm://239.255.76.67:7667?ttl=1'
steps=1000

unshare -n sleep 100 &
host=$!
started="$started $host"
sleep 0.2
there() {
    nsenter --net="/proc/$host/ns/net" "$@"
}
if ! ip link add here type veth peer name there netns $host; then
    echo "skipped: no virtual cable in this kernel"
    exit 77
fi
ip addr add 10.0.0.1/24 dev here
ip link set here up
ip route replace 224.0.0.0/4 dev here
there ip addr add 10.0.0.2/24 dev there
there ip link set there up
there ip route add 224.0.0.0/4 dev there

"$portmetd" run "$scene" --in-process --quiet --steps $steps --record "$folder/plain.h5" ||
    fail "in process"

start left node "$scene" left --url "$url"
left=$pid
there "$portmetd" node "$scene" right --url "$url" >"$folder/right.out" 2>"$folder/right.err" &
right=$!
started="$started $right"
start coordinator coordinator "$scene" --quiet --steps $steps --url "$url" \
    --record "$folder/hosts.h5"
coordinator=$pid
sleep 0.3
cut() {
    there nft add chain ip cut "$1" "{ type filter hook $1 priority 0; }" &&
        there nft add rule ip cut "$1" udp dport 7667 counter drop
}
if there nft add table ip cut 2>/dev/null && cut input && cut output; then
    sleep 0.5
    there nft list chain ip cut output | grep -q 'packets [1-9]' || fail "nothing was lost"
    there nft delete table ip cut
fi
ends coordinator $coordinator 0 ""
ends left $left 0 ""
ends right $right 0 ""
"$same_recording" "$folder/plain.h5" "$folder/hosts.h5" || fail "two hosts"
finish
