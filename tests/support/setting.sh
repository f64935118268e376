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

# expect CODE TEXT ARGUMENT...: $program ends with this exit code, and TEXT is in the only line on standard error, which
# begins with the program's name.
expect() {
    code=$1 text=$2
    shift 2
    timeout 400 "$program" "$@" >"$folder/out" 2>"$folder/err" </dev/null
    found=$?
    [ $found -eq "$code" ] || fail "${program##*/} $*: expected exit code $code, found $found"
    [ "$(wc -l <"$folder/err")" -eq 1 ] || fail "${program##*/} $*: expected one line of error"
    grep -qF -e "$text" "$folder/err" || fail "${program##*/} $*: expected \"$text\""
    grep -q "^${program##*/}: " "$folder/err" || fail "${program##*/} $*: its name is missing"
}

# succeed TEXT ARGUMENT...: $program succeeds, with TEXT on standard output and nothing on standard error.
succeed() {
    text=$1
    shift
    timeout 400 "$program" "$@" >"$folder/out" 2>"$folder/err" </dev/null || fail "${program##*/} $*: expected success"
    [ ! -s "$folder/err" ] || fail "${program##*/} $*: expected no error"
    grep -qF -e "$text" "$folder/out" || fail "${program##*/} $*: expected \"$text\""
}

# Ends the test: success if nothing has failed.
finish() {
    [ $failures -eq 0 ] && echo "all well"
    exit $((failures > 0))
}
