# Sourced by tests that are scripts: a folder that is removed at the end, and the count of failures.
set -u
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
failures=0

# fail WORD...: counts a failure, and shows what the last command has written to the files out and err.
fail() {
    failures=$((failures + 1))
    echo "FAILED: $*"
    for file in "$folder/out" "$folder/err"; do
        [ ! -s "$file" ] || sed 's/^/    /' "$file"
    done
}

# Ends the test: success if nothing has failed.
finish() {
    [ $failures -eq 0 ] && echo "all well"
    exit $((failures > 0))
}
