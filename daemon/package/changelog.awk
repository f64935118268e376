# changelog.awk: prints the items of one version in CHANGELOG.md as entries of a Debian changelog, whose lines are short.
#   awk -v version=0.1.0 -f changelog.awk CHANGELOG.md
function flush(    n, word, i, line) {
    n = split(item, word, " ")
    line = "  *"
    for (i = 1; i <= n; ++i) {
        if (length(line) + length(word[i]) > 76) { print line; line = "   " }
        line = line " " word[i]
    }
    if (n) print line
    item = ""
}
/^## / { flush(); on = index($2, version) == 1; next }
on && /^- / { flush(); item = substr($0, 3); next }
on { item = item " " $0 }
END { flush() }
