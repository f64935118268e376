#!/bin/sh
# The shipped weights in the form of the method's paper, on ten trajectories of the public data that no training has seen:
# the median errors must stay below those of the authors' network. Without the data the test is skipped.
#   sh tests/unit/test_paper_public.sh PORTMET_TRAIN     in the root of the repository
train=$1
data=../shared/data/double_pendulum.h5
if [ ! -r "$data" ]; then
    echo "skipped: there is no $data"
    exit 77
fi
report=$("$train" evaluate configs/paper_public_double_pendulum.yaml --data "$data" --trajectories 30:40 --json) || exit 1
status=0
for bound in q:0.031 p:0.037 s:0.064; do
    group=${bound%%:*}
    median=$(printf '%s\n' "$report" | sed -n "s/^ *\"$group\": {\"trajectory\": .*\"median\": \([0-9.e+-]*\), \"third_quartile\".*\"snapshot\".*/\1/p")
    if ! awk -v found="$median" -v most="${bound##*:}" 'BEGIN { exit !(found > 0 && found < most) }'; then
        echo "FAILED: the median error of $group is \"$median\", expected less than ${bound##*:}"
        status=1
    fi
done
exit $status
