# Sourced by the tests of exports, whose first argument is BUILD: places, a folder that is removed at the
# end, and the count of failures.
set -u
build=$(realpath "$1")
portmetd=$build/daemon/app/portmetd
here=$(realpath "$(dirname "$0")")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
failures=0

fail() {
    failures=$((failures + 1))
    echo "FAILED: $*"
}

finish() {
    [ $failures -eq 0 ] && echo "all well"
    exit $((failures > 0))
}
