#!/bin/sh
# precision.sh RUN_BENCH PORTMETD CONFIGS FOLDER: run time against error in one process; then the wall
# time of some of these runs over LCM, a process each, the fastest of three, in a private network (left
# out where there can be none); and the picture of both. Leaves table.csv, lcm.csv and precision.png in
# FOLDER.
set -eu
run_bench=$1
portmetd=$2
configs=$3
mkdir -p "$4"
folder=$(cd "$4" && pwd)
source=$(cd "$(dirname "$0")" && pwd)
dt=0.3 # s, of both scenes

"$run_bench" "$folder/table.csv" "$configs" double_pendulum double_pendulum_fast

# The same pendula from formulas, with slow, fast and very fast conduction, from the same starts.
known=$folder/known
mkdir -p "$known/truth"
for K in 0_5 300 3000; do
    conductivity=$(echo $K | tr _ .)
    sed "s/conductivity: 300 /conductivity: $conductivity /" "$configs/truth/double_pendulum_fast.yaml" \
        >"$known/truth/known_$K.yaml"
    sed -e "s/^scene: .*/scene: known_$K/" -e "s/{K: 0.5}/{K: $conductivity}/" \
        "$configs/analytic_double_pendulum.yaml" >"$known/known_$K.yaml"
done
"$run_bench" "$folder/known.csv" "$known" known_0_5 known_300 known_3000
sed 1d "$folder/known.csv" >>"$folder/table.csv"
rm -r "$known" "$folder/known.csv"

cd "$configs/.."
. daemon/setup.sh
network=$(private_network)

# over_lcm SCENE METHOD SUBSTEPS: the row of the table, with the time of a run over LCM. In place of
# substeps stands the tolerance if METHOD ends in _adaptive.
over_lcm() {
    case $2 in
    *_adaptive) pace="s/^\( *\)substeps: .*/\1tolerance: $(printf %.6f "$3")/" ;;
    *) pace="s/substeps: [0-9]*/substeps: $3/" ;;
    esac
    sed -e "s/, tolerance: [0-9.e-]*//" -e "s/integrator: [a-z0-9_]*/integrator: ${2%_adaptive}/" -e "$pace" \
        -e "s|weights: weights|weights: $configs/weights|" \
        -e "s|file: reference|file: $configs/reference|" "$configs/$1.yaml" >"$folder/scene.yaml"
    speed=$(for repetition in 1 2 3; do
        $network "$portmetd" run "$folder/scene.yaml" | sed -n 's/^Speed: \([0-9]*\) .*/\1/p'
    done | sort -n | tail -n 1)
    awk -F, -v OFS=, -v row="$1,$2,$3," -v seconds_per_step="$speed" -v dt=$dt \
        'index($0, row) == 1 { $5 = 1 / (seconds_per_step * dt); print }' "$folder/table.csv"
}

head -n 1 "$folder/table.csv" >"$folder/lcm.csv"
if [ -n "$network" ]; then
    for point in rk4,4 rk4,16 rk4_balanced,2 rk4_balanced,4 rk4_balanced,8 rk4_balanced,16 \
        rk4_adaptive,0.001 rk4_adaptive,0.0001 rk4_adaptive,1e-05 \
        rk6_balanced,1 rk6_balanced,2 rk6_balanced,4 rk6_balanced,8 discrete_gradient,1; do
        over_lcm double_pendulum "${point%,*}" "${point#*,}"
    done >>"$folder/lcm.csv"
    for point in rk4,16 rk4_balanced,16 rk4_balanced,32 rk6_balanced,16 discrete_gradient,1 \
        discrete_gradient,2; do
        over_lcm double_pendulum_fast "${point%,*}" "${point#*,}"
    done >>"$folder/lcm.csv"
    echo "Over LCM:"
    cat "$folder/lcm.csv"
fi
rm -f "$folder/scene.yaml"
gnuplot -e "folder='$folder'" "$source/precision.gp" 2>/dev/null && echo "picture: $folder/precision.png"
