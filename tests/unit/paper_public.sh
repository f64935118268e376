#!/bin/sh
# The form of the method's paper, learned from the public data of its authors in some 300 s of CPU: on ten trajectories
# that training has not seen the median errors must stay below those of the authors' network. Without the data it
# fails.
#   sh tests/unit/paper_public.sh PORTMET_TRAIN     in the root of the repository
. "$(dirname "$0")/../support/setting.sh"
train=$1
data=../shared/data/double_pendulum.h5
if [ ! -r "$data" ]; then
    echo "there is no $data"
    exit 1
fi
"$train" fit configs/train/paper_public_double_pendulum.yaml --data "$data" --trajectories 0:30 -o "$folder/weights" \
    >"$folder/out" 2>"$folder/err" || fail "fit"
report=$("$train" evaluate configs/paper_public_double_pendulum.yaml --weights "$folder/weights" --data "$data" \
    --trajectories 30:40 --json 2>"$folder/err") || fail "evaluate"
for bound in q:0.031 p:0.037 s:0.064; do
    group=${bound%%:*}
    median=$(printf '%s\n' "$report" | sed -n "s/^ *\"$group\": {\"trajectory\": .*\"median\": \([0-9.e+-]*\), \"third_quartile\".*\"snapshot\".*/\1/p")
    awk -v found="$median" -v most="${bound##*:}" 'BEGIN { exit !(found > 0 && found < most) }' ||
        fail "the median error of $group is \"$median\", expected less than ${bound##*:}"
done
finish
