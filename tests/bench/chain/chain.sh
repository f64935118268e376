#!/bin/sh
# chain.sh RUN_BENCH PORTMET_TRAIN CONFIGS FOLDER: the error of chains of 10, 100 and 1,000 links, as many
# links in all. Leaves the data and table.txt in FOLDER. The seed is one that nothing was chosen by.
set -eu
run_bench=$1
portmet_train=$2
configs=$3
mkdir -p "$4"
folder=$(cd "$4" && pwd)
seed=777001

{
    echo "relative L2 errors in %; q, p and s of a link: median, third quartile, mean, largest over links and"
    echo "trajectories; of the whole chain: medians of q, p, s; entropy produced: median, mean; energy, J"
    echo "links runs substeps   q                                  p                                  s"
    for point in 10,400 100,40 1000,4; do
        links=${point%,*}
        sed -e "s/^seed: .*/seed: $seed/" -e "s/count: 999/count: $((links - 1))/" \
            -e "s/^trajectories: .*/trajectories: ${point#*,}/" "$configs/truth/chain_1000.yaml" \
            >"$folder/truth.yaml"
        # The scene lies in the folder, so its weights need their full path.
        sed -e "s/\[2:1001\]/[2:$((links + 1))]/" -e "s/\[1:1000\]/[1:$links]/" \
            -e "s|weights: weights|weights: $configs/weights|" "$configs/chain_1000.yaml" >"$folder/scene.yaml"
        if [ ! -e "$folder/chain_$links.h5" ]; then
            "$portmet_train" truth "$folder/truth.yaml" -o "$folder/chain_$links.h5" >"$folder/truth_$links.txt"
        fi
        for substeps in 6 12 24; do
            "$run_bench" "$folder/scene.yaml" "$folder/chain_$links.h5" "$substeps"
        done
    done
} | tee "$folder/table.txt"
grep -h "convergence" "$folder"/truth_*.txt
rm "$folder/truth.yaml" "$folder/scene.yaml"
