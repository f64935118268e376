#!/bin/sh
# kills.sh PORTMETD BENCH CONFIGS [RUNS [SUBSTEPS]]: runs of 200 steps of the double pendulum by one client, each compared
# bit by bit with the run in one process, while one datagram in ten gets lost and a process of the service is killed every
# second, in a private network (root). Prints how many were killed and lost, and fails if the service's memory, threads or
# files have grown after the first twenty runs. With one substep a run takes 1 to 2 s, with the scene's 16 it takes 20.
. "$(dirname "$0")/../../support/private_network.sh"
. "$(dirname "$0")/resources.sh"
portmetd=$1
bench=$2
configs=$(realpath "$3")
runs=${4:-1000}
substeps=${5:-1}
folder=$(mktemp -d)
trap 'kill $killer $service 2>/dev/null; rm -rf "$folder"' EXIT
sed "s#\(weights: \|file: \)#&$configs/#; s/checkpoint: 100/checkpoint: 4/; s/substeps: 16 .*/substeps: $substeps/" \
    "$configs/double_pendulum.yaml" >"$folder/kills.yaml"
if ! nft add table ip loss || ! nft add chain ip loss input '{ type filter hook input priority 0; }' ||
    ! nft add rule ip loss input udp dport 7667 numgen random mod 10 == 0 counter drop; then
    echo "skipped: no nft here"
    exit 77
fi
"$portmetd" serve "$folder/kills.yaml" --checkpoint "$folder/checkpoints" 2>"$folder/err" &
service=$!
until "$portmetd" query "$folder/kills.yaml" 2>/dev/null | grep -q ": idle"; do sleep 0.2; done
while sleep 1; do
    kill -KILL "$(tr ' ' '\n' <"/proc/$service/task/$service/children" | grep . | shuf -n 1)" 2>>"$folder/late"
done &
killer=$!
"$bench" "$folder/kills.yaml" 20 200 0 >"$folder/first" || exit 1
before=$(resources $service)
"$bench" "$folder/kills.yaml" "$runs" 200 0
code=$?
kill $killer
echo "the service after 20 runs: $before, after all: $(resources $service)"
flat "$before" "$(resources $service)" || code=1
kill -TERM $service && wait $service || code=$?
echo "$(grep -c 'killed by signal 9' "$folder/err") processes killed, $(nft list chain ip loss input | sed -n 's/.*packets \([0-9]*\).*/\1/p') datagrams lost; ended with $code"
exit $code
