#!/bin/sh
# compare_builds.sh [options] OLD_BUILD NEW_BUILD [SCENE...]: whether two builds record the same numbers, bit by bit.
# Runs each scene of configs/ whose weights are there with both builds in one process, and with the new one also with
# a process for each subsystem over LCM, in a private network (which needs root). Prints one line for each scene; ends
# with 1 if anything differs. The recordings' attributes (versions) may differ, their datasets may not.
#   --steps N       at most N steps of each scene (1000; never more than a scene has)
#   --no-lcm        only in one process
#   --configs DIR   the folder of the scenes (configs/ of this repository)
# SCENE is a name in that folder, or a name with an integrator: double_pendulum+rk6; +tolerance lets the error choose the
# substeps, +processes puts two subsystems into one process. Without SCENE: all scenes, and some with each integrator.
set -u
root=$(cd "$(dirname "$0")/.." && pwd)
steps=1000
lcm=yes
configs=$root/configs
while :; do
    case ${1:-} in
    --steps) steps=$2; shift 2 ;;
    --no-lcm) lcm=; shift ;;
    --configs) configs=$(cd "$2" && pwd) || exit 2; shift 2 ;;
    *) break ;;
    esac
done
[ $# -ge 2 ] || { sed -n '2,/^set/s/^# \{0,1\}//p' "$0"; exit 2; }
old=$(cd "$1" && pwd) && new=$(cd "$2" && pwd) || exit 2
shift 2
cd "$root" || exit 2
. daemon/setup.sh
network=
[ -z "$lcm" ] || network=$(private_network)
[ -z "$lcm" ] || [ -n "$network" ] || echo "no private network here (it needs root): only in one process"
for program in "$old/daemon/app/portmetd" "$new/daemon/app/portmetd" "$new/tests/distributed/same_recording"; do
    [ -x "$program" ] || { echo "there is no $program" >&2; exit 2; }
done
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
trap 'exit 130' INT TERM

if [ $# -eq 0 ]; then
    for scene in "$configs"/*.yaml; do
        set -- "$@" "$(basename "$scene" .yaml)"
    done
    for integrator in euler heun rk4_balanced rk6 rk6_balanced discrete_gradient tolerance; do
        for scene in double_pendulum analytic_double_pendulum gas_containers chain_3; do
            set -- "$@" "$scene+$integrator"
        done
    done
    set -- "$@" double_pendulum_soft+rk6 driven_lower+discrete_gradient driven_lower+rk4_balanced beam+rk4_balanced \
        crossed_beams+rk4_balanced chain_5+processes gas_containers+processes
fi

# write_scene NAME: $folder/scene.yaml, with its paths made absolute, so that nothing is written beside the scene.
# What a scene lacks to run alone is added: the long chain's start and its processes; the clock sets no pace.
write_scene() {
    sed -e "s,\(weights\|reference\|meshes\)/,$configs/&," -e '/^ *pace:/d' "$configs/${1%+*}.yaml" >"$folder/scene.yaml"
    case $1 in
    chain_5+processes) sed -i '/^time:/i processes: {a: [link1, link4], b: [link2, link3]}' "$folder/scene.yaml" ;;
    gas_containers+processes) sed -i '/^time:/i processes: {both: [left, right]}' "$folder/scene.yaml" ;;
    *+tolerance) sed -i 's/substeps: *[0-9]*/tolerance: 1.0e-6/; /law_tolerances\?/d' "$folder/scene.yaml" ;;
    *+*) sed -i "s/integrator: *[a-z0-9_]*/integrator: ${1#*+}/" "$folder/scene.yaml" ;;
    esac
    if [ "$1" = chain_1000 ]; then
        sed -i -e '/columns: \[s1\]/a \    initial: {q: [4.5, 4.4], p: [-0.5, 1.4], s: -0.1}' \
            -e '/columns: \["s\[i\]"\]/a \    initial: {q: [-2.7, 0.1], p: [1.4, -0.2], s: 0.1}' \
            -e '/^time:/i processes: {a: ["link[1:301]"], b: ["link[301:601]"], c: ["link[601:1001]"]}' "$folder/scene.yaml"
    fi
}

# limit NAME: how many steps of it, so that none takes more than a few seconds.
limit() {
    most=$steps
    case $1 in
    chain_1000) most=10 ;;
    crossed_mixed) most=14 ;;
    esac
    own=$(sed -n 's/.*[{ ]steps: *\([0-9]*\).*/\1/p' "$folder/scene.yaml" | head -n 1)
    for other in "$steps" "$own"; do
        [ -z "$other" ] || [ "$other" -ge "$most" ] || most=$other
    done
    echo "$most"
}

# record BUILD RECORDING OPTION...: a run of the scene; its tables, without the speed, to RECORDING.out. Live inputs
# come from the example program when the run is over LCM, and from the old build's recording otherwise.
record() {
    build=$1
    recording=$folder/$2.h5
    shift 2
    timeout 600 $start "$build/daemon/app/portmetd" run "$folder/scene.yaml" --steps "$count" --record "$recording" "$@" \
        >"$folder/tables" 2>"$folder/err" </dev/null
    code=$?
    grep -v '^Speed:' "$folder/tables" >"$recording.out"
    echo "exit code $code" >>"$recording.out"
    [ $code -eq 0 ] || [ $code -eq 10 ] # 10: to the end, with a law violated
}

# compare A B: "equal", or where they differ and by how much; the tables are only mentioned.
compare() {
    if "$new/tests/distributed/same_recording" "$folder/$1.h5" "$folder/$2.h5" 2>"$folder/err"; then
        word=equal
        cmp -s "$folder/$1.h5.out" "$folder/$2.h5.out" || word="equal (other tables)"
    else
        word=DIFFERS
        different=$((different + 1))
        sed 's/^/    /' "$folder/err" | head -n 12 >>"$folder/details"
    fi
}

different=0 compared=0
printf '%-45s %5s  %-22s %s\n' scene steps "in one process" "new over LCM"
for name; do
    [ -f "$configs/${name%+*}.yaml" ] || { echo "there is no scene $name" >&2; exit 2; }
    write_scene "$name"
    count=$(limit "$name")
    : >"$folder/details"
    rm -f "$folder"/*.h5 "$folder"/*.h5.out
    source=--in-process
    start=
    if grep -q '^live_inputs:' "$folder/scene.yaml"; then
        if [ -z "$network" ]; then
            printf '%-45s %5s  %s\n' "$name" - "skipped: live inputs need LCM"
            continue
        fi
        cat >"$folder/with_swing" <<'END'
"$SWING" & swing=$!
"$@"; code=$?
kill $swing
exit $code
END
        start="$network env SWING=$old/tests/distributed/swing sh $folder/with_swing"
        record "$old" live || { printf '%-45s %5s  %s\n' "$name" - "the old build cannot run it"; continue; }
        start=
        source="--in-process --replay $folder/live.h5"
    fi
    if ! record "$old" old $source; then
        if grep -q "weights.*cannot be opened" "$folder/err"; then
            printf '%-45s %5s  %s\n' "$name" - "skipped: its weights are not there"
        else
            printf '%-45s %5s  %s\n' "$name" - "skipped: the old build says: $(cut -c1-120 "$folder/err" | head -n 1)"
        fi
        continue
    fi
    compared=$((compared + 1))
    here=FAILS there=-
    if record "$new" new $source; then
        compare old new
        here=$word
    else
        different=$((different + 1))
        sed 's/^/    /' "$folder/err" >>"$folder/details"
    fi
    if [ -n "$network" ]; then
        start=$network there=FAILS
        if record "$new" lcm ${source#--in-process}; then
            compare old lcm
            there=${word%% *}
        else
            different=$((different + 1))
            sed 's/^/    /' "$folder/err" >>"$folder/details"
        fi
        start=
    fi
    printf '%-45s %5s  %-22s %s\n' "$name" "$count" "$here" "$there"
    cat "$folder/details"
done
echo "$compared scenes compared, $different differences"
[ "$compared" -gt 0 ] && [ "$different" -eq 0 ]
