#!/bin/sh
# test_receive.sh PORTMETD MAKE_SCENE SAME_RECORDING HEARS_THE_SAME: the program's own socket receives the
# same messages as liblcm, and a scene whose processes receive in different ways computes the same bits.
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

for refused in "$address&receive=both" 'mpudpm://239.255.76.67:7667?receive=own' \
    "$address&recv_buf_size=much" "$address&spin=maybe"; do
    start refused run "$scene" --url "$refused"
    ends refused $pid 3 'expected'
done
finish
