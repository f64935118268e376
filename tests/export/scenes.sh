# Sourced by the tests of exports, whose first argument is BUILD: where things are.
. "$(dirname "$0")/../support/setting.sh"
build=$(realpath "$1")
portmetd=$build/daemon/app/portmetd
here=$(realpath "$(dirname "$0")")
