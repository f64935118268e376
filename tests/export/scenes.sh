# Sourced by the tests of exports, whose first argument is BUILD: where things are.
. "$(dirname "$0")/../support/setting.sh"
build=$(realpath "$1")
portmetd=$build/daemon/app/portmetd
here=$(realpath "$(dirname "$0")")

# wide_scene: a scene whose model has a matrix of 65 x 65 numbers, too large for C source.
wide_scene() {
    zeros=$(awk 'BEGIN { for (j = 1; j < 65; ++j) printf "0.0, "; print "0.0" }')
    echo "scene: wide"
    echo "time: {dt: 0.1, steps: 1, integrator: rk4}"
    echo "subsystems: {body: {model: wide, state: {q: {unit: m, size: 65}}, initial: {q: [$zeros]}}}"
    echo "models:"
    echo "  wide:"
    echo "    energy: '|x|^2/2'"
    echo "    derived: {x: {of: [q], matrix: ["
    awk -v row="[$zeros]" 'BEGIN { for (i = 1; i < 65; ++i) print "      " row ","; print "      " row }'
    echo "      ]}}"
}
