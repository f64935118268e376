#!/bin/sh
# test_format.sh: the layout of all sources is that of .clang-format. Other versions of clang-format lay out differently
# in places, so that only Debian 12's, 14, is asked. Runs in the repository's root.
#   sh tests/unit/test_format.sh --fix      lays out what differs
version=14
for clang_format in clang-format-$version clang-format none; do
    "$clang_format" --version 2>/dev/null | grep -q "version $version\." && break
done
if [ "$clang_format" = none ]; then
    echo "skipped: there is no clang-format $version (Debian 12: apt-get install clang-format)"
    exit 77
fi
sources=$(find daemon trainer tests -name '*.[ch]')
if [ "${1:-}" = --fix ]; then
    exec "$clang_format" -i $sources
fi
found=$("$clang_format" --dry-run $sources 2>&1 | sed -n 's/^\([^:]*\):\([0-9]*\):.*clang-format-violations.*/\1:\2/p')
if [ -n "$found" ]; then
    echo "FAILED: clang-format lays these lines out differently (sh tests/unit/test_format.sh --fix):"
    echo "$found" | head -n 20
    exit 1
fi
echo "all well: $(echo "$sources" | wc -l) files"
