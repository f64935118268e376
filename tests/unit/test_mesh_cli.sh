#!/bin/sh
# test_mesh_cli.sh PORTMET_MESH PORTMET_TRAIN [WRITE_MESH_FILE]: meshes of other programs become meshes of portmet, and
# bodies of any shape are simulated on them and follow the shipped material.
. "$(dirname "$0")/../support/setting.sh"
mesh=$1
train=$2
writer=${3:-}

# says CODE TEXT PROGRAM ARGUMENT...
says() {
    code=$1 text=$2
    shift 2
    timeout 400 "$@" >"$folder/out" 2>&1 </dev/null
    found=$?
    [ $found -eq "$code" ] || fail "$*: expected exit code $code, found $found"
    grep -qF -e "$text" "$folder/out" || fail "$*: expected \"$text\""
}

# below LIMIT TEXT: the median in the line of TEXT.
below() {
    value=$(awk -v text="$2" 'index($0, text) { print $(NF - 2) }' "$folder/out")
    [ -n "$value" ] && awk "BEGIN { exit !($value < $1) }" || fail "$2: expected less than $1 %, found \"$value\""
}

# --- a body of any shape ---

# truth NAME EDIT: configs/truth/l_body.yaml with few states, edited.
truth() {
    sed -e "s,mesh: [^ ]*,mesh: $PWD/configs/meshes/l_body.h5," -e 's/states: 41/states: 6/' -e "$2" \
        configs/truth/l_body.yaml >"$folder/$1.yaml"
}

truth body 's/seed: 95/seed: 3/'
says 0 "2 trajectories of 6 states" "$train" truth "$folder/body.yaml" --trajectories 0:2 -o "$folder/body.h5"
says 0 ", 0 of 10 steps in violation" "$train" respond "$folder/body.h5" \
    --weights configs/weights/solid_beam/material.h5 -o "$folder/learned.h5"
below 0.5 "displacement"
below 0.2 "stress, free nodes"
below 1 "stored energy"
below 2 "dissipated energy"
if command -v gnuplot >/dev/null; then
    says 0 "wrote" "$train" respond "$folder/body.h5" --weights configs/weights/solid_beam/material.h5 --plot "$folder/plot" \
        -o "$folder/learned.h5"
    [ -s "$folder/plot/errors.png" ] && [ "$(wc -l <"$folder/plot/errors.txt")" -eq 3 ] || fail "no box plots"
    says 0 "wrote" "$train" picture "$folder/body.h5" "$folder/learned.h5" --error -o "$folder/error.png"
    [ "$(grep -c '^splot' "$folder/error.gp")" -eq 3 ] || fail "expected three panels"
fi
says 2 "--error: expected two fields of one body" "$train" picture "$folder/body.h5" --error -o "$folder/none.png"
truth face 's/tilt: 0.5/tilt: 0.5\n    face: +y/'
says 3 'only a box has a `face`, not a `mesh`' "$train" truth "$folder/face.yaml" -o "$folder/none.h5"
truth size 's/  substeps: 2/  substeps: 2\n  size: [1, 1, 1]/'
says 3 'only a box has `size`, not a `mesh`' "$train" truth "$folder/size.yaml" -o "$folder/none.h5"
truth missing 's,mesh: .*,mesh: none.h5,'
says 4 "$folder/none.h5" "$train" truth "$folder/missing.yaml" -o "$folder/never.h5"
says 0 "wrote" "$train" nodes "$folder/body.h5" --mesh "$folder/again.h5" -o "$folder/nodes.h5"
for dataset in /hexahedra /clamped /node_position_reference; do
    h5diff "$folder/again.h5" configs/meshes/l_body.h5 $dataset >/dev/null || fail "$dataset has changed"
done

# The shipped scene. Its energies are compared with those of the material under the true motion, inner variables included.
says 0 "trajectories 0 to 0, 21 states" "$train" evaluate configs/l_body.yaml --data configs/reference/l_body.h5
for kind in energy entropy; do
    awk -v kind=$kind '$1 == kind && $2 == "body" { n++; if (!($3 <= 1)) bad = 1 } END { exit n != 1 || bad }' "$folder/out" ||
        fail "evaluate: expected an error below 1 %: $(grep "^  $kind" "$folder/out")"
done

# --- files of other programs ---

# Under the sanitizers: the library of Gmsh does not free all that it allocates.
export ASAN_OPTIONS="${ASAN_OPTIONS:-}:detect_leaks=0"
says 2 "--output FILE is missing" "$mesh" "$folder/none.msh"
"$mesh" "$folder/none.msh" -o "$folder/none.h5" >"$folder/out" 2>&1
if grep -q "built without Gmsh" "$folder/out"; then
    echo "skipped: portmet-mesh was built without Gmsh"
    finish
fi
says 4 "none.msh: the file cannot be read" "$mesh" "$folder/none.msh" -o "$folder/none.h5"

# Two cubes beside each other, the first clamped at x = 0, in two formats.
# msh TYPE NODES: the second element.
msh() {
    cat <<END
\$MeshFormat
2.2 0 8
\$EndMeshFormat
\$PhysicalNames
2
2 1 "wall"
3 2 "body"
\$EndPhysicalNames
\$Nodes
12
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
5 0 0 1
6 1 0 1
7 1 1 1
8 0 1 1
9 2 0 0
10 2 1 0
11 2 0 1
12 2 1 1
\$EndNodes
\$Elements
3
1 3 2 1 1 1 4 8 5
2 5 2 2 1 1 2 3 4 5 6 7 8
3 $1 2 2 1 $2
\$EndElements
END
}
msh 5 "2 9 10 3 6 11 12 7" >"$folder/two.msh"
says 0 "2 hexahedra, 12 nodes, of which 4 are clamped" "$mesh" "$folder/two.msh" --clamped wall -o "$folder/two.h5"
truth two "s,mesh: [^ ]*,mesh: two.h5,; s/states: 6/states: 3/; s/\[1.0e4, 5.0e4\]/[100, 200]/"
says 0 "1 trajectory of 3 states" "$train" truth "$folder/two.yaml" --trajectories 0:1 -o "$folder/of_two.h5"
says 5 'no physical group "clamped", found: wall, body' "$mesh" "$folder/two.msh" -o "$folder/none.h5"
msh 4 "2 9 10 11" >"$folder/mixed.msh"
says 5 "element 3 (one of 1) is a Tetrahedron 4, expected hexahedra" "$mesh" "$folder/mixed.msh" --clamped wall -o "$folder/none.h5"
says 0 "12 hexahedra" "$mesh" "$folder/mixed.msh" --clamped wall --split -o "$folder/split.h5"
# Its nodes are numbered as in a mirror, which is the same brick.
msh 5 "9 2 3 10 11 6 7 12" >"$folder/mirror.msh"
says 0 "2 hexahedra, 12 nodes, of which 4 are clamped" "$mesh" "$folder/mirror.msh" --clamped wall -o "$folder/mirror.h5"
msh 5 "2 9 3 10 6 11 12 7" >"$folder/twisted.msh"
says 5 "element 3 has no positive volume everywhere" "$mesh" "$folder/twisted.msh" --clamped wall -o "$folder/none.h5"
echo "not a mesh" >"$folder/text.msh"
says 4 "line 1: syntax error" "$mesh" "$folder/text.msh" -o "$folder/none.h5"
says 4 ": the file is damaged, or Gmsh" "$mesh" "$folder/text.msh" -o "$folder/none.h5"
says 0 "2 hexahedra, 12 nodes, of which 4 are clamped" "$mesh" "$folder/two.msh" --clamped x=2 -o "$folder/plane.h5"
says 5 "no node lies in the plane x=0.3" "$mesh" "$folder/two.msh" --clamped x=0.3 -o "$folder/none.h5"
says 5 'no physical group "x=", found: wall, body; --clamped also takes a plane' "$mesh" "$folder/two.msh" --clamped x= -o "$folder/none.h5"
# Formats with names of groups, and formats without.
if [ -n "$writer" ]; then
    for format in "2.2 0 msh" "2.2 1 msh" "4.1 0 msh" "4.1 1 msh" "4.1 0 unv" "4.1 0 vtk" "4.1 1 vtk" "4.1 0 bdf" "4.1 0 mesh"; do
        set -- $format
        file=$folder/format_$1_$2.$3
        clamped=wall
        [ "$3" = msh ] || [ "$3" = unv ] || clamped=x=0
        "$writer" "$folder/two.msh" "$file" "$1" "$2" || fail "$format: cannot be written"
        says 0 "2 hexahedra, 12 nodes, of which 4 are clamped" "$mesh" "$file" --clamped $clamped -o "$folder/format.h5"
        for dataset in /hexahedra /clamped /node_position_reference; do
            h5diff "$folder/format.h5" "$folder/two.h5" $dataset >/dev/null || fail "$format: $dataset differs"
        done
    done
    says 5 'no physical group "wall", found: none' "$mesh" "$folder/format_4.1_0.vtk" --clamped wall -o "$folder/none.h5"
    # Tetrahedra of a file, whose new nodes lie halfway between its own, and a surface.
    "$writer" configs/meshes/column.geo "$folder/tetrahedra.vtk" 4.1 0 || fail "column.geo: cannot be written"
    says 5 "is a Tetrahedron 4, expected hexahedra" "$mesh" "$folder/tetrahedra.vtk" --clamped x=0 -o "$folder/none.h5"
    says 0 "hexahedra" "$mesh" "$folder/tetrahedra.vtk" --clamped x=0 --split -o "$folder/column.h5"
    sed '/Physical/d' configs/meshes/column.geo >"$folder/box.geo" # else Gmsh writes the groups alone
    "$writer" "$folder/box.geo" "$folder/surface.stl" 4.1 0 || fail "surface.stl: cannot be written"
    says 5 "no element of a volume, expected hexahedra; a surface becomes a volume by a .geo file" \
        "$mesh" "$folder/surface.stl" --clamped x=0 -o "$folder/none.h5"
    printf 'Merge "surface.stl";\nSurface Loop(1) = {1};\nVolume(1) = {1};\nMesh.SecondOrderLinear = 1;\n' >"$folder/surface.geo"
    says 0 "hexahedra" "$mesh" "$folder/surface.geo" --clamped x=0 --split -o "$folder/surface.h5"
fi
# The geometry of the shipped mesh gives a mesh; versions of Gmsh differ in its nodes.
says 0 "hexahedra" "$mesh" configs/meshes/l_body.geo -o "$folder/l_body.h5"

finish
