#!/bin/sh
# SPDX-License-Identifier: MIT
# make.sh NAME [FILE]: makes the data of a scene, learns its weights and prints their errors on unseen trajectories, as
# README.md in this folder reports them. Runs in the root of the repository, writes to build/, and leaves configs/weights
# as they are. FILE is a data file of others, which is not part of this repository. Times are CPU times.
set -eu
export PATH="$PWD/build/daemon/app:$PWD/build/trainer:$PATH" OPENBLAS_NUM_THREADS=1
name=${1:-} file=${2:-}
data=build/data
mkdir -p $data build/solid
case $name in
*public* | gfinn* | couette*) [ -f "$file" ] || { echo "usage: sh configs/make.sh $name FILE" >&2; exit 2; } ;;
esac

# truth NAME: simulates configs/truth/NAME.yaml once.
truth() {
    [ -f "$data/$1.h5" ] || portmet-train truth "configs/truth/$1.yaml" -o "$data/$1.h5"
}
# fit NAME FILE [OPTION...]: learns configs/train/NAME.yaml from FILE.
fit() {
    training=$1 trained=$2
    shift 2
    portmet-train fit "configs/train/$training.yaml" --data "$trained" -o "build/weights/$training" "$@"
}
# evaluate SCENE WEIGHTS FILE [OPTION...]: errors of what fit WEIGHTS has learned.
evaluate() {
    tested=$1 weights=$2 tests=$3
    shift 3
    portmet-train evaluate "configs/$tested.yaml" --weights "build/weights/$weights" --data "$tests" "$@"
}
# fields: 20 trajectories of the beam by which nothing was chosen (a minute).
fields() {
    sed 's/^seed: .*/seed: 777001/' configs/truth/beam.yaml >$data/fresh.yaml
    [ -f $data/fresh.h5 ] || portmet-train truth $data/fresh.yaml -o $data/fresh.h5 --trajectories 0:20
}
# gap OPTION...: the gap between two crossed beams (2 minutes for their fields), on the trajectories with contact.
touched="--trajectories 12,13,15:18,19"
gap() {
    [ -f $data/crossed_lower.h5 ] || portmet-train truth configs/truth/crossed_beams.yaml -o $data/crossed.h5
    portmet-train contact configs/truth/crossed_beams.yaml --data lower=$data/crossed_lower.h5,upper=$data/crossed_upper.h5 \
        $touched "$@"
}

case $name in
double_pendulum | double_pendulum_fast | double_pendulum_soft | double_pendulum_fast_soft | double_pendulum_free | double_pendulum_network) # 16 to 130 s
    from=${name%_soft} from=${from%_free} scene=${name%_network} from=${from%_network}
    truth "$from"
    fit "$name" "$data/$from.h5"
    evaluate "$scene" "$name" "$data/$from.h5" --trajectories 40:50 --trained 0:40 --plot build/pictures
    ;;
public_double_pendulum | paper_public_double_pendulum) # 130 s, 310 s
    fit "$name" "$file" --trajectories 0:30
    evaluate "$name" "$name" "$file" --trajectories 30:40
    ;;
paper_public_parts) # 2 x 22 s
    for part in upper lower; do
        portmet-train fit configs/train/paper_public_$part.yaml --data "$file" --trajectories 0:30 -o build/weights/parts
    done
    evaluate paper_public_parts parts "$file" --trajectories 30:40
    ;;
paper_double_pendulum) # 130 s
    truth $name
    fit $name $data/$name.h5
    evaluate $name $name $data/$name.h5 --trajectories 200:240
    ;;
chain_*) # 18 s, and 70 s for the truth of chain_1000
    truth double_pendulum_wide
    fit double_pendulum_wide $data/double_pendulum_wide.h5
    truth "$name"
    evaluate "$name" double_pendulum_wide "$data/$name.h5"
    ;;
driven_upper | driven_lower) # 10 s
    truth $name
    fit $name $data/$name.h5
    evaluate $name $name $data/$name.h5 --trajectories 80:100
    ;;
driven_double_pendulum)
    truth double_pendulum
    portmet-train evaluate configs/$name.yaml --data $data/double_pendulum.h5
    ;;
gas_containers) # 46 s
    truth $name
    fit $name $data/$name.h5
    evaluate $name $name $data/$name.h5 --trajectories 80:100
    ;;
gfinn_gas | gfinn_gas_given) # 39 s
    fit "$name" "$file" --trajectories 0:60
    evaluate gfinn_gas "$name" "$file" --trajectories 60:80
    ;;
couette | couette_clock | couette_noise) # 86 to 136 s
    scene=couette_noise
    [ "$name" != couette ] || scene=couette
    fit "$name" "$file"
    evaluate $scene "$name" "$file" --until 0.995 --trajectories 2,7,12,17,22,27,32,37,42,47,52,57,62,67,72,77
    ;;
double_pendulum_noise | double_pendulum_half) # 32 s and 68 s, and 27 s for the width of bands
    truth double_pendulum
    options="--noise 0.01 --seed 1" clean=$data/double_pendulum.h5
    [ $name = double_pendulum_noise ] || options="--noise 0.01 --missing 0.5 --seed 2"
    portmet-train truth configs/truth/double_pendulum.yaml -o $data/$name.h5 $options
    portmet-train fit configs/train/double_pendulum_noise.yaml --data $data/$name.h5 -o build/weights/$name
    evaluate double_pendulum $name $clean --trajectories 40:50
    evaluate double_pendulum $name $data/$name.h5 --trajectories 40:50 --estimate 30 --truth $clean
    ;;
double_pendulum_hidden) # 113 s
    truth double_pendulum
    fit $name $data/double_pendulum.h5
    evaluate $name $name $data/double_pendulum.h5 --trajectories 40:50 --estimate 6 --truth $data/double_pendulum.h5
    ;;
double_pendulum_positions) # 60 s
    truth double_pendulum
    portmet-train truth configs/truth/double_pendulum.yaml -o $data/double_pendulum_camera.h5 --noise 0.001 --seed 3
    fit $name $data/double_pendulum_camera.h5
    evaluate $name $name $data/double_pendulum_camera.h5 --trajectories 40:50 --estimate 12 --truth $data/double_pendulum.h5
    ;;
gas_containers_hidden) # 3 s
    truth gas_containers
    portmet-train truth configs/truth/gas_containers.yaml -o $data/gas_noise.h5 --noise 0.01 --seed 1
    fit $name $data/gas_noise.h5
    evaluate $name $name $data/gas_noise.h5 --trajectories 80:100 --estimate 4 --truth $data/gas_containers.h5
    ;;
beam) # 160 trajectories: 8 minutes; modes: 2 minutes; fit: 3 minutes
    truth beam
    fields
    portmet-train reduce configs/modes/beam.yaml --data $data/beam.h5 -o $data/beam
    fit beam $data/beam/modes.h5
    portmet-train reduce configs/modes/beam.yaml --data $data/fresh.h5 --basis $data/beam/basis.h5 -o $data/fresh
    evaluate beam beam $data/fresh/modes.h5 --record $data/predicted.h5
    portmet-train reconstruct $data/predicted.h5 --basis $data/beam/basis.h5 --truth $data/fresh.h5
    ;;
public_beam) # half a minute; the rows 1, 4 and 7 of FILE enter only after the training
    portmet-train truth configs/truth/beam_elastic.yaml --trajectories 0:13 -o $data/elastic.h5
    portmet-train correct $data/elastic.h5 --by "$file" --trajectories 0,2,3,5,6,8,9 -o $data/corrected.h5
    portmet-train reduce configs/modes/public_beam.yaml --data $data/corrected.h5 -o $data/public_beam
    fit public_beam $data/public_beam/modes.h5
    portmet-train reduce configs/modes/public_beam.yaml --data "$file" --basis $data/public_beam/basis.h5 \
        --trajectories 1,4,7 -o $data/public_test
    evaluate public_beam public_beam $data/public_test/modes.h5 --record $data/public_predicted.h5
    portmet-train reconstruct $data/public_predicted.h5 --basis $data/public_beam/basis.h5 --truth "$file" \
        --trajectories 1,4,7
    ;;
public_solid) # 33 s
    portmet-train solid "$file" --trajectories 0,2,3,5,6,8,9 --branches 0 -o build/solid/public_material.h5
    portmet-train respond "$file" --weights build/solid/public_material.h5 --trajectories 1,4,7
    ;;
beam_solid) # 77 s, and a minute
    truth small_beam
    fields
    portmet-train solid $data/small_beam.h5 -o build/solid/material.h5
    portmet-train respond $data/fresh.h5 --weights build/solid/material.h5 -o $data/learned.h5
    portmet-train nodes $data/fresh.h5 --mesh $data/mesh.h5 -o $data/nodes.h5
    portmet-train evaluate configs/beam_solid.yaml --data $data/nodes.h5 --record $data/predicted_solid.h5
    portmet-train reconstruct $data/predicted_solid.h5 --truth $data/fresh.h5
    ;;
l_body) # a minute, and Gmsh
    portmet-mesh configs/meshes/l_body.geo -o $data/l_mesh.h5
    truth l_body
    portmet-train nodes $data/l_body.h5 --states 21 --mesh $data/l_mesh.h5 -o $data/l_nodes.h5
    portmet-train evaluate configs/l_body.yaml --data $data/l_nodes.h5
    portmet-train respond $data/l_body.h5 --weights configs/weights/solid_beam/material.h5 --plot build/l_body -o $data/l_learned.h5
    portmet-train picture $data/l_body.h5 $data/l_learned.h5 --trajectory 1 --time 0.9 --error -o build/l_body.png
    ;;
crossed_beams | crossed_mixed) # 2 minutes for the truth
    bodies="--basis configs/weights/beam/basis.h5" stiffness="--stiffness 2e5 --creep 8e-6"
    [ $name = crossed_beams ] || { bodies="$bodies --solid upper" stiffness="--stiffness 2e5" touched="--trajectories 12"; }
    gap $bodies $stiffness -o $data/$name
    portmet-train evaluate configs/$name.yaml --data $data/$name/modes.h5 --record build/$name.h5
    gap $bodies --weights configs/weights/$name --score build/$name.h5
    [ $name = crossed_mixed ] || portmet-train reconstruct build/$name.h5 --body lower $bodies --contact configs/truth/$name.yaml \
        --weights configs/weights/$name --truth $data/crossed_lower.h5 $touched
    ;;
crossed_solids) # 2 minutes for the truth
    gap --solid lower,upper --stiffness 2e6 -o $data/$name
    portmet-train evaluate configs/$name.yaml --data $data/$name/modes.h5 --record build/$name.h5
    gap --solid lower,upper --weights configs/weights/$name --score build/$name.h5
    for body in lower upper; do
        portmet-train reconstruct build/$name.h5 --body $body --truth $data/crossed_$body.h5 $touched -o $data/learned_$body.h5
    done
    portmet-train picture $data/crossed_lower.h5 $data/crossed_upper.h5 --trajectory 15,2 --time 0.9 --error \
        --beside $data/learned_lower.h5,$data/learned_upper.h5 -o build/solids.png
    ;;
*)
    echo "usage: sh configs/make.sh NAME [FILE], where NAME is one of these:" >&2
    sed -n 's/^\([a-z][a-z_ |*]*\)).*/  \1/p' "$0" >&2
    exit 2
    ;;
esac
