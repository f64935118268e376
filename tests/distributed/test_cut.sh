#!/bin/sh
# test_cut.sh PORTMETD MAKE_SCENE SAME_RECORDING: a chain records the same bits in one process and over LCM
# in 1, 2 and 8 processes, cut by METIS, and with another cut.
. "$(dirname "$0")/network.sh"

# chain NAME: the scene NAME with the section `processes` from the file NAME.processes.
chain() {
    cat >"$folder/$1.yaml" - "$folder/$1.processes" <<EOF
scene: chain
url: "udpm://239.255.76.67:7667?ttl=0"
time: {dt: 1.0e-2, steps: 20, integrator: rk4}
lockstep: {patience: 60}
$(links 40)
EOF
}

# same NAME: a run over LCM records what one process has recorded.
same() {
    start "$1" run "$folder/$1.yaml" --quiet --record "$folder/$1.h5"
    ends "$1" $pid 0 ""
    "$same_recording" "$folder/plain.h5" "$folder/$1.h5" || fail "$1"
}

echo 'processes: {first: "link[0:20]", second: "link[20:40]"}' >"$folder/plain.processes"
chain plain
"$portmetd" run "$folder/plain.yaml" --in-process --quiet --record "$folder/plain.h5" || fail "in process"
echo 'processes: {even: [link0, link2, link3, "link[20:40]"], odd: [link1, "link[4:20]"]}' >"$folder/ranges.processes"
chain ranges
same ranges

echo 'processes: {auto: 8}' >"$folder/eight.processes"
chain eight
if ! "$portmetd" check "$folder/eight.yaml" >"$folder/check.out" 2>"$folder/check.err"; then
    grep -q 'auto: this program was built without METIS' "$folder/check.err" || fail "no word of METIS"
    finish
fi
for count in 1 2; do
    echo "processes: {auto: $count}" >"$folder/auto$count.processes"
    chain auto$count
    same auto$count
done
same eight

no_orphans "at the end" ""
finish
