#!/bin/sh
# test_receive.sh PORTMETD MAKE_SCENE SAME_RECORDING HEARS_THE_SAME: the program's own socket receives the
# same messages as liblcm, and a scene whose processes receive in different ways computes the same bits. Where
# packets are small, large messages leave in several, so that IP never cuts one.
. "$(dirname "$0")/network.sh"

"$4" || fail "hears_the_same"

"$portmetd" run "$scene" --in-process --quiet --record "$folder/plain.h5" || fail "in process"
address='udpm://239.255.76.67:7667?ttl=0'
start left node "$scene" left --url "$address&receive=lcm"
left=$pid
start right node "$scene" right --url "$address&receive=own&spin=no"
right=$pid
start coordinator coordinator "$scene" --quiet --record "$folder/mixed.h5" --url "$address"
ends coordinator $pid 0 ""
ends left $left 0 ""
ends right $right 0 ""
"$same_recording" "$folder/plain.h5" "$folder/mixed.h5" || fail "mixed"

# Packets as small as those of an Ethernet. Two processes with every second link have 39 ports to each other.
fragments() {
    awk '/^Ip:/ { if (seen++) print $column; else for (i = 1; i <= NF; ++i) if ($i == "FragCreates") column = i }' \
        /proc/net/snmp
}
ip link set lo mtu 1500
before=$(fragments)
"$4" || fail "hears_the_same in small packets"
cat >"$folder/chain.yaml" <<EOF
scene: chain
time: {dt: 1.0e-2, steps: 20, integrator: rk4}
lockstep: {patience: 60}
$(links 40)
processes:
  even: [$(seq -s ', ' -f 'link%g' 0 2 38)]
  odd: [$(seq -s ', ' -f 'link%g' 1 2 39)]
EOF
"$portmetd" run "$folder/chain.yaml" --in-process --quiet --record "$folder/one.h5" || fail "chain in process"
start two run "$folder/chain.yaml" --quiet --record "$folder/two.h5"
ends two $pid 0 ""
"$same_recording" "$folder/one.h5" "$folder/two.h5" || fail "large messages in small packets"
[ "$(fragments)" -eq "$before" ] || fail "IP has cut $(($(fragments) - before)) fragments"

for refused in "$address&receive=both" 'mpudpm://239.255.76.67:7667?receive=own' \
    "$address&recv_buf_size=much" "$address&spin=maybe"; do
    start refused run "$scene" --url "$refused"
    ends refused $pid 3 'expected'
done
finish
