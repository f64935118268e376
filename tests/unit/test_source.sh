#!/bin/sh
# test_source.sh LIBRARY_OR_OBJECT...: what keeps the source readable. No file includes or calls another one in a
# circle, and no type is declared twice. The build's libraries, and the objects of its programs, tell who calls whom.
# Runs in the repository's root.
set -u
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

# fail WHAT: prints a failure. A file counts failures, since the end of a pipeline is a subshell.
fail() {
    echo "FAILED: $*" | tee -a "$folder/failures"
}

sources=$(find daemon trainer tests -name '*.[ch]')
[ "$(echo "$sources" | wc -l)" -gt 300 ] || fail "expected some hundred files, found: $sources"

# circle WHAT: the pairs "user used" on standard input have none.
circle() {
    LC_ALL=C tsort >"$folder/order" 2>"$folder/loops" || fail "$1 in a circle: $(tr '\n' ' ' <"$folder/loops")"
    [ -s "$folder/order" ] || fail "$1: nothing was compared"
}

# Headers and sources: "file.h included.h" as paths below the include folders.
for file in $(find daemon trainer -name '*.[ch]'); do
    sed -nE 's/^#include "(([a-z_0-9]+\/)+[a-z_0-9]+\.h)".*/\1/p' "$file" | sed "s|^|${file#*/} |"
done | awk '$1 != $2' | circle "files include each other"

# Objects: who calls a function that another object of the project defines.
nm -A "$@" 2>/dev/null | awk '
    NF < 2 { next }
    { object = $1; sub(/:[0-9a-f]*$/, "", object); kind = $(NF - 1); name = $NF }
    kind ~ /^[TDRB]$/ { home[name] = object }
    kind == "U" { uses[++n] = object " " name }
    END {
        for (i = 1; i <= n; i++) {
            split(uses[i], use, " ")
            if (use[2] in home && home[use[2]] != use[1]) print use[1], home[use[2]]
        }
    }' | sort -u | circle "files call each other"

# Type names, in the daemon and the trainer.
twice=$(find daemon trainer -name '*.[ch]' -exec grep -hE '^typedef |^\} *[a-z_0-9]+;|^(struct|enum|union) [a-z_0-9]+ \{' {} + |
    sed -nE 's/^\} *([a-z_0-9]+);.*/\1/p; s/^typedef .*[ *]([a-z_0-9]+);.*/\1/p; s/^typedef .*\(\*([a-z_0-9]+)\).*/\1/p; s/^(struct|enum|union) ([a-z_0-9]+) \{.*/struct \2/p' |
    sort | uniq -d | tr '\n' ' ')
[ -z "$twice" ] || fail "types are declared twice: $twice"

[ -e "$folder/failures" ] && exit 1
echo "all well"
