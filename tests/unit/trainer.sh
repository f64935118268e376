# Sourced by tests of the trainer's command line, whose first argument is PORTMET_TRAIN: a folder that is
# removed at the end, and the count of failures. A failure shows the output of the last command, which the
# tests write to the file `out`.
set -u
train=$1
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
failures=0

fail() {
    failures=$((failures + 1))
    echo "FAILED: $*"
    sed 's/^/    /' "$folder/out"
}
