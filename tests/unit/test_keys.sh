#!/bin/sh
# test_keys.sh: the pages explain each key that a file of the user's may have, and no other. Runs in the
# repository's root. In the source, keys are the texts of arrays called `keys` or ending in `_keys`, and of
# macros ending in KEYS; in the pages, the first column of tables whose heading begins with "key".
. "$(dirname "$0")/../support/setting.sh"

find daemon/scene daemon/store trainer -name '*.[ch]' -exec awk '
    /keys\[\] = \{/ || /^#define [A-Z_]*KEYS/ { inside = 1 }
    /keys\[\] = \{/ { macro = 0 }
    inside { print }
    inside && (/\};/ || (!/\\$/ && macro)) { inside = 0 }
    /^#define [A-Z_]*KEYS/ { macro = 1; if (!/\\$/) inside = 0 }' {} + |
    grep -oE '"[A-Za-z_0-9]+"' | tr -d '"' | sort -u >"$folder/accepted"

find . -name '*.md' -not -path './build*' -exec awk '
    FNR == 1 { table = 0 }
    /^\| *[Kk]ey/ { table = 1; next }
    !/^\|/ { table = 0 }
    table { split($0, column, "|"); print column[2] }' {} + |
    grep -oE '`[A-Za-z_0-9]+`' | tr -d '`' | sort -u >"$folder/documented"

[ "$(wc -l <"$folder/accepted")" -gt 80 ] || fail "expected some hundred keys in the source"
missing=$(comm -23 "$folder/accepted" "$folder/documented" | tr '\n' ' ')
[ -z "$missing" ] || fail "no page explains: $missing"
unknown=$(comm -13 "$folder/accepted" "$folder/documented" | tr '\n' ' ')
[ -z "$unknown" ] || fail "the pages explain what no reader accepts: $unknown"

[ $failures -eq 0 ] && echo "all well: $(wc -l <"$folder/accepted") keys"
exit $((failures > 0))
