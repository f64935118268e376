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

# in_order ROOT PREFIX FOLDER...: these are all folders of sources below ROOT, and each includes only those before it.
# PREFIX begins their headers' paths in an include.
in_order() {
    root=$1
    prefix=$2
    shift 2
    for folder in $(find "$root" -mindepth 2 -maxdepth 2 -name '*.[ch]' | sed "s|^$root/||; s|/[^/]*$||" | sort -u); do
        case " $* " in *" $folder "*) ;; *) fail "$root/$folder has no place in the order of layers" ;; esac
    done
    while [ $# -gt 0 ]; do
        folder=$1
        shift
        [ -d "$root/$folder" ] || fail "$root/$folder is missing"
        [ $# -gt 0 ] || continue
        found=$(includes "$root/$folder" | grep -E ":$prefix($(echo "$*" | tr ' ' '|'))/")
        [ -z "$found" ] || fail "$root/$folder includes a later layer: $found"
    done
}

# The folders in the order data flows.
in_order daemon '' base store graph model scene sim transport lockstep library export study app examples
in_order trainer '' truth data loss optimise shooting inference evaluate fit propose bodies command
in_order trainer/bodies bodies/ mesh field truth solid modal command

found=$(includes daemon | grep -E ':(trainer|truth)/')
[ -z "$found" ] || fail "daemon/ includes the trainer: $found"
found=$(includes trainer | grep -E ':(library|export|transport|lockstep|study|app)/')
[ -z "$found" ] || fail "trainer/ includes library, export, transport, lockstep, study or app: $found"
# A first proposal looks at data alone: it neither trains nor evaluates. The search tries training files by short fits.
found=$(includes trainer/propose | grep -vE '^trainer/propose/(search|advice)\.[ch]:' | grep -E ':(truth|loss|optimise|shooting|inference|evaluate|fit|sim|graph)/')
[ -z "$found" ] || fail "trainer/propose includes more than data, models and scenes: $found"
# Bodies are apart: the program alone joins them to the rest, and their folders have an order as well.
found=$(includes daemon trainer | grep -vE '^trainer/bodies/' | grep ':bodies/' | grep -v '^trainer/main.c:bodies/bodies.h$')
[ -z "$found" ] || fail "outside trainer/bodies only main may include it, by bodies.h: $found"
# The program that reads meshes links the model's bricks and the files alone.
found=$(includes trainer/bodies/mesh | grep -vE ':((base|store|bodies/mesh)/|model/solid/|[a-z]*\.h$)')
[ -z "$found" ] || fail "trainer/bodies/mesh includes more than bricks and files: $found"
found=$(includes trainer/bodies | grep -E ':(command|fit|propose)/')
[ -z "$found" ] || fail "trainer/bodies includes commands, fit or propose of the trainer: $found"
found=$(includes trainer | grep -vE '^trainer/(command|truth|bodies/truth|bodies/command)/|^trainer/bodies/bodies.h' | grep -E ':(bodies/)?truth/')
[ -z "$found" ] || fail "only commands may include the truth: $found"
# Reference physics that shares code with the model cannot reveal its mistakes.
found=$(includes trainer/truth trainer/bodies/truth | grep -E ':(graph|model|scene|sim|library|export|transport|lockstep|app)/|:store/' |
    grep -vE ':store/(dataset|solid_mesh|yaml)\.h')
[ -z "$found" ] || fail "the truth includes more than base, datasets, meshes and YAML of the store: $found"
found=$(includes trainer/truth trainer/bodies/truth | grep -E ':(evaluate|bodies/(solid|modal|command|bodies))')
[ -z "$found" ] || fail "the truth includes the trainer: $found"

# door HEADER-PATTERN ALLOWED-FILE-PATTERN
door() {
    found=$(includes daemon trainer | grep -E ":($1)" | grep -vE "^($2)")
    [ -z "$found" ] || fail "$1 belongs into $2: $found"
    includes daemon trainer | grep -E ":($1)" | grep -qE "^($2)" || fail "nobody includes $1"
}
door '(.*/)?cblas' 'daemon/base/'
door 'yaml\.h' 'daemon/store/'
door 'hdf5' 'daemon/store/'
door 'mpi\.h' '(daemon/transport/transport_mpi|trainer/loss/team_mpi)\.c'
door 'lcm/|portmet_' 'daemon/(transport|lockstep|examples)/'
# Below the transport nobody knows how messages travel.
found=$(grep -rniE 'lcm|multicast' --include='*.[ch]' daemon/base daemon/store daemon/graph daemon/model daemon/scene daemon/sim daemon/export)
[ -z "$found" ] || fail "LCM is named below the transport: $found"
door 'gmshc\.h' 'trainer/bodies/mesh/gmsh_file\.c'
door 'libwebsockets' 'daemon/app/view_server\.c'
door 'cvode|nvector|sun' 'trainer/truth/'
door '(suitesparse/)?cholmod' 'trainer/bodies/truth/beam_solve'

[ $failures -eq 0 ] && echo "all layers in order"
exit $((failures > 0))
