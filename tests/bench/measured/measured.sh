#!/bin/sh
# Fits the measured pendula with one piece left out after the other, scores the piece that was left out, and draws the
# learned friction of the single pendulum with its band, as README.md in this folder reports them.
#   sh tests/bench/measured/measured.sh FOLDER [OUT]
# FOLDER holds measured_single_pendulum.h5 and measured_double_pendulum.h5; OUT takes weights and output.
set -u
if [ $# -lt 1 ]; then
    echo "usage: sh $0 FOLDER [OUT]" >&2
    exit 2
fi
root=$(cd "$(dirname "$0")/../../.." && pwd)
data=$1
out=${2:-$root/build/measured}
train=${PORTMET_TRAIN:-$root/build/trainer/portmet-train}
export OPENBLAS_NUM_THREADS=1
mkdir -p "$out"

# fit_and_score NAME TRAINED TESTED
fit_and_score() {
    file=$data/$1.h5 weights=$out/$1_$3
    (time -p "$train" fit "$root/configs/train/$1.yaml" --data "$file" --trajectories "$2" -o "$weights") >"$weights.txt" 2>&1 ||
        echo "the fit failed: $weights.txt"
    echo "== $1, trained on $2, CPU $(awk '$1 == "user" { print $2 }' "$weights.txt") s"
    "$train" evaluate "$root/configs/$1.yaml" --weights "$weights" --data "$file" --trajectories "$3" --estimate 0.5 |
        grep -E '^column|^theta|^Laws'
}

fit_and_score measured_single_pendulum 1:4 0
fit_and_score measured_single_pendulum 0,2:4 1
fit_and_score measured_single_pendulum 0:2,3 2
fit_and_score measured_single_pendulum 0:3 3
fit_and_score measured_double_pendulum 0:18 18:24

# The friction of all pieces: numbers FILE DATASET prints a dataset, one number a line.
numbers() {
    h5dump -d "$2" -y -w 1 "$1" | sed -n '/DATA {/,/}/p' | grep -oE '[-+0-9.][-+0-9.e]*' | grep -E '[0-9]'
}
weights=$out/single_all
"$train" fit "$root/configs/train/measured_single_pendulum.yaml" --data "$data/measured_single_pendulum.h5" -o "$weights" \
    >"$weights.txt" || exit 1
# The band is that of a piece that the fit has not seen: the variance of the weights counts `scale` times.
scale=$(h5dump -a /scale -y -m %.9g "$weights/measured.h5" | sed -n '/DATA {/,/}/p' | grep -oE '[0-9][0-9.e+]*' | head -n 1)
# Weights in their order: stiffness, zero, viscous, dry, drag, slow; all but zero are logarithms.
{ numbers "$weights/measured.h5" /weights; numbers "$weights/measured.h5" /covariance; } | awk -v scale="$scale" '
    { x[NR - 1] = $1 }
    END {
        n = 6
        for (v = -10; v <= 10.001; v += 0.02) {
            m = exp(x[2]); d = exp(x[3]); a = exp(x[4]); s2 = exp(2*x[5]); r = sqrt(v*v + s2)
            f = (m + d/r + a*r)*v
            g[0] = g[1] = 0; g[2] = m*v; g[3] = d*v/r; g[4] = a*r*v; g[5] = (-d/(r*r*r) + a/r)*s2*v
            variance = 0
            for (i = 0; i < n; i++) for (j = 0; j < n; j++) variance += g[i]*g[j]*x[n + n*i + j]
            w = 1.645*sqrt(variance > 0 ? scale*variance : 0)
            printf "%.3f %.6f %.6f %.6f\n", v, f, f - w, f + w
        }
    }' >"$out/friction.txt"
# A straight line for comparison: linear friction, which the authors of the data assume, fitted to the same pieces.
sed -e '/  dry: /d; /  drag: /d; /  slow: /d' -e 's/"(viscous + .*dE.s"/"viscous*dE.s"/' -e "s|^scene: .*|scene: $root/configs/measured_single_pendulum.yaml|" \
    "$root/configs/train/measured_single_pendulum.yaml" >"$out/line.yaml"
"$train" fit "$out/line.yaml" --data "$data/measured_single_pendulum.h5" -o "$out/line" >"$out/line.txt"
line=$(awk '$1 == "arm.viscous" { print $3 + 0 }' "$out/line.txt")
"$train" evaluate "$root/configs/measured_single_pendulum.yaml" --weights "$out/line" --data "$data/measured_single_pendulum.h5" \
    --trajectories 0:4 --estimate 0.5 | grep -E '^theta' | sed 's/^/straight line, all pieces: /'
cat >"$out/friction.gp" <<END
set terminal pngcairo size 800,480 font 'DejaVu Sans,11' background 'white'
set output 'friction.png'
set border 3 linecolor '#555555'
set tics nomirror out
set grid linetype 1 linecolor '#e4e4e4'
set key left top Left reverse
set yrange [-0.75:0.95]
set xlabel 'velocity, rad/s'
set ylabel 'friction torque over moment of inertia, rad/s^2'
plot 'friction.txt' using 1:3:4 with filledcurves linecolor '#a6cee3' title 'band of 90 % for a piece that the fit has not seen', \
     'friction.txt' using 1:2 with lines linewidth 2 linecolor '#0072b2' title 'learned friction', \
     $line*x with lines linewidth 1.5 dashtype 2 linecolor '#d55e00' title "linear friction, the data's authors' form, fitted to the same pieces"
END
(cd "$out" && gnuplot friction.gp) && echo "drew $out/friction.png"
