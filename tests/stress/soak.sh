#!/bin/sh
# soak.sh PORTMETD MAKE_SCENE SAME_RECORDING SECONDS [TABLE]: two nodes and a coordinator over LCM for so many seconds,
# with a recording and checkpoints, 5 % of all datagrams lost, and a node killed every 20 s. Writes the memory and the
# descriptors of each process to TABLE. Memory and descriptors must stay where they were, and the recording must hold
# every step.
. "$(dirname "$0")/../distributed/network.sh"
seconds=$4 table=${5:-$folder/soak.csv}
if ! { nft add table ip loss && nft add chain ip loss input '{ type filter hook input priority 0; }' &&
    nft add rule ip loss input udp dport 7667 numgen random mod 20 == 0 counter drop; }; then
    fail "nft cannot drop datagrams"
    finish
fi
sed '/^time:/i lockstep: {patience: 60}' "$scene" >"$folder/soak.yaml"
start soak run "$folder/soak.yaml" --quiet --steps 1000000000 --record "$folder/soak.h5" --checkpoint "$folder/saved"
run=$pid

memory() { awk '/^VmRSS/ { print $2 }' "/proc/$1/status" 2>/dev/null; }
descriptors() { ls "/proc/$1/fd" 2>/dev/null | wc -l; }
size() { stat -c %s "$folder/soak.h5" 2>/dev/null || echo 0; }

wait_until test -s "$folder/soak.h5" || fail "no recording"
echo "s,recording kB,run kB,run fds,coordinator kB,coordinator fds,left kB,left fds,right kB,right fds,kills" >"$table"
kills=0 second=0
while [ $second -lt "$seconds" ] && kill -0 "$run" 2>/dev/null; do
    sleep 5
    second=$((second + 5))
    line=$second,$(($(size) / 1024)),$(memory "$run"),$(descriptors "$run")
    for name in coordinator left right; do
        victim=$(child "$run" $name)
        line=$line,$(memory "${victim:-0}"),$(descriptors "${victim:-0}")
    done
    echo "$line,$kills" >>"$table"
    if [ $((second % 20)) -eq 0 ]; then
        name=left
        [ $((second % 40)) -eq 0 ] && name=right
        victim=$(child "$run" $name)
        [ -n "$victim" ] && kill -KILL "$victim" && kills=$((kills + 1))
    fi
done
kill -TERM "$run" 2>/dev/null
wait "$run"
code=$?
[ $code -eq 12 ] || fail "exit code $code, expected 12"
[ $kills -gt 0 ] || fail "nothing was killed"

# Memory: the largest of the last half of the time beside the largest of the second quarter. Descriptors: the smallest,
# since a checkpoint that is being written takes one for a moment.
awk -F, -v seconds="$seconds" '
    # A process that is not there has 0.
    function outermost(i, a, b) { return b > 0 && (a == "" || (i % 2 ? b > a : b < a)) ? b : a }
    NR > 1 && $1 > seconds / 4 && $1 <= seconds / 2 { for (i = 3; i <= 10; ++i) early[i] = outermost(i, early[i], $i + 0) }
    NR > 1 && $1 > seconds / 2 { for (i = 3; i <= 10; ++i) late[i] = outermost(i, late[i], $i + 0) }
    NR == 1 { for (i = 3; i <= 10; ++i) name[i] = $i }
    END {
        for (i = 3; i <= 10; ++i) {
            grown = late[i] > (i % 2 ? early[i] * 1.05 + 512 : early[i])
            printf "  %-16s %8d in the second quarter, %8d later%s\n", name[i], early[i], late[i], grown ? ": GROWN" : ""
            bad += grown
        }
        exit bad > 0
    }' "$table" || fail "memory or descriptors grow"

certain=$(h5dump -y -a /committed "$folder/soak.h5" | awk '/DATA \{/ { data = 1; next } data && NF { print $1; exit }')
gaps=$(h5dump -y -w 1 -d /step "$folder/soak.h5" | awk -v certain="$certain" '
    /DATA \{/ { data = 1; next } /\}/ { data = 0 }
    data && NF && rows < certain { bad += ($1 + 0 != rows); ++rows }
    END { print bad + certain - rows }')
[ "$gaps" -eq 0 ] || fail "$gaps of $certain samples are not where they belong"
echo "$second s, $kills kills, $(nft list chain ip loss input | grep -o 'packets [0-9]*' | tr -d 'a-z ') datagrams lost, \
$certain samples recorded without a gap, $(($(size) / 1024)) kB"
[ $failures -gt 0 ] || echo "memory and descriptors stay where they were"
finish
