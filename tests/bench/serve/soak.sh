#!/bin/sh
# soak.sh PORTMETD CONFIGS [STEPS]: a run of the double pendulum without a last step, at full speed, with both parts
# in the service's process and compiled models, in a private network (root). Prints its energy, and the memory, the
# threads and the descriptors of all processes, ten times, and fails if they have grown from the second to the last
# time, if a step was in violation, or if it took more than an hour.
. "$(dirname "$0")/../../support/private_network.sh"
. "$(dirname "$0")/resources.sh"
portmetd=$1
configs=$(realpath "$2")
steps=${3:-10000000}
folder=$(mktemp -d)
trap 'kill $service 2>/dev/null; rm -rf "$folder"' EXIT
scene=$configs/double_pendulum.yaml

# reached: the step of the run.
reached() {
    "$portmetd" query "$scene" | sed -n 's/.*, step \([0-9]*\).*/\1/p' | head -n 1
}

"$portmetd" serve "$scene" --in-process --compiled 2>"$folder/err" &
service=$!
until "$portmetd" query "$scene" 2>/dev/null | grep -q ": idle"; do sleep 0.2; done
began=$(date +%s)
"$portmetd" start "$scene" --endless --quiet || exit 1
second= part=1
while [ $part -le 10 ]; do
    until [ "$(reached)" -ge $((steps / 10 * part)) ]; do
        kill -0 $service || { cat "$folder/err"; exit 1; }
        sleep 5
    done
    now=$(resources $service $(cat /proc/$service/task/$service/children))
    second=${second:-$([ $part -lt 2 ] || echo "$now")}
    echo "$("$portmetd" query "$scene" | head -n 1 | sed 's/.*, step/step/'); after $(($(date +%s) - began)) s: $now"
    part=$((part + 1))
done
took=$(($(date +%s) - began))
"$portmetd" stop "$scene" | tee "$folder/stop" | head -n 1
kill -TERM $service && wait $service || { echo "the service ended with $?"; exit 1; }
flat "$second" "$now" || exit 1
grep -q ' 0 violations' "$folder/stop" || { echo "steps were in violation"; exit 1; }
[ $took -le 3600 ] || { echo "took $took s"; exit 1; }
