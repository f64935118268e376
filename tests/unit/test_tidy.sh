#!/bin/sh
# test_tidy.sh BUILD: clang-tidy finds nothing in daemon/ and trainer/ by the checks of .clang-tidy. BUILD holds
# compile_commands.json. It takes some 20 s of CPU. Runs in the repository's root.
. "$(dirname "$0")/../support/setting.sh"
if ! command -v clang-tidy >/dev/null; then
    echo "skipped: there is no clang-tidy (apt-get install clang-tidy)"
    exit 77
fi
find daemon trainer -name '*.c' -not -path '*/examples/*' -not -path '*/fmi/*' >"$folder/sources"
# Sources that this build leaves out, as for want of a library, have no command.
while read -r source; do
    grep -q "/$source\"" "$1/compile_commands.json" && echo "$source"
done <"$folder/sources" >"$folder/built"
[ "$(wc -l <"$folder/built")" -gt 200 ] || fail "expected some hundred sources in $1/compile_commands.json"
xargs -P "$(nproc)" -n 16 clang-tidy -p "$1" --quiet <"$folder/built" >"$folder/out" 2>/dev/null ||
    fail "clang-tidy: $(grep -E '(error|warning):' "$folder/out" | sort -u)"
: >"$folder/out"
finish
