#!/bin/sh
# test_layers.sh: every source file includes only headers of its own layer and of earlier ones, and
# each foreign library has one door. Run in the repository's root.
set -u
failures=0

fail() {
    failures=$((failures + 1))
    echo "FAILED: $*"
}

# Lines "file:header" of all includes below the given folders, in quotes or angle brackets.
includes() {
    grep -rnE --include='*.[ch]' '^ *# *include' "$@" |
        sed -E 's/^([^:]*):[0-9]+: *# *include *["<]([^">]*)[">].*/\1:\2/'
}

# The folders of daemon/, in the order data flows; each may include those before it.
later="base store graph model scene sim library export transport lockstep app"
for layer in $later; do
    later=${later#"$layer"}
    later=${later# }
    [ -d "daemon/$layer" ] || fail "daemon/$layer is missing"
    [ -n "$later" ] || continue
    found=$(includes "daemon/$layer" | grep -E ":($(echo "$later" | tr ' ' '|'))/")
    [ -z "$found" ] || fail "daemon/$layer includes a later layer: $found"
done

found=$(includes daemon | grep -E ':(trainer|truth)/')
[ -z "$found" ] || fail "daemon/ includes the trainer: $found"
found=$(includes trainer | grep -E ':(library|export|transport|lockstep|app)/')
[ -z "$found" ] || fail "trainer/ includes library, export, transport, lockstep or app: $found"
# The folders of trainer/ but truth, in their order; each may include those before it.
later="evaluate body modal learn command"
for folder in $later; do
    later=${later#"$folder"}
    later=${later# }
    found=$(includes "trainer/$folder" | grep -E ":($(echo "$later none" | tr ' ' '|'))/")
    [ -z "$found" ] || fail "trainer/$folder includes a later folder: $found"
done
found=$(includes trainer | grep -vE '^trainer/(command|truth)/' | grep ':truth/')
[ -z "$found" ] || fail "only trainer/command may include trainer/truth: $found"
# Reference physics that shares code with the model cannot reveal its mistakes.
found=$(includes trainer/truth | grep -E ':(graph|model|scene|sim|library|export|transport|lockstep|app)/|:store/' |
    grep -vE ':store/(dataset|field|solid_mesh|yaml)\.h')
[ -z "$found" ] || fail "trainer/truth includes more than base, datasets, fields, meshes and YAML: $found"

# door HEADER-PATTERN ALLOWED-FILE-PATTERN
door() {
    found=$(includes daemon trainer | grep -E ":($1)" | grep -vE "^($2)")
    [ -z "$found" ] || fail "$1 belongs into $2: $found"
    includes daemon trainer | grep -E ":($1)" | grep -qE "^($2)" || fail "nobody includes $1"
}
door '(.*/)?cblas' 'daemon/base/'
door 'yaml\.h' 'daemon/store/'
door 'hdf5' 'daemon/store/'
door 'mpi\.h' '(daemon/transport/transport_mpi|trainer/learn/team_mpi)\.c'
door 'lcm/|portmet_' 'daemon/(transport|lockstep|examples)/'
# Below the transport nobody knows how messages travel.
found=$(grep -rniE 'lcm|multicast' --include='*.[ch]' daemon/base daemon/store daemon/graph daemon/model daemon/scene daemon/sim daemon/library daemon/export)
[ -z "$found" ] || fail "LCM is named below the transport: $found"
door 'gmshc\.h' 'trainer/mesh/gmsh_file\.c'
door 'libwebsockets' 'daemon/app/view_server\.c'
door 'cvode|nvector|sun' 'trainer/truth/'
door '(suitesparse/)?cholmod' 'trainer/truth/beam_matrix'

[ $failures -eq 0 ] && echo "all layers in order"
exit $((failures > 0))
