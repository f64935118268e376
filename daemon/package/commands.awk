# commands.awk: turns what `PROGRAM --help` and, one after the other, `PROGRAM COMMAND --help` print into a manual page
# of section 1, for commands.sh. EXAMPLES has the first example of each command, or all of a program without commands.
#   awk -v name=portmetd -v about="..." -v tail=FILE -f commands.awk     tail: further sections (roff), which end the page
function text(s) {
    gsub(/^ +| +$|`/, "", s)
    gsub(/\\/, "\\e", s)
    gsub(/-/, "\\-", s)
    return s ~ /^[.']/ ? "\\&" s : s
}
BEGIN { printf ".TH %s 1 \"\" portmet \"User Commands\"\n.SH NAME\n%s \\- %s\n", toupper(name), text(name), about }
/^Usage: / {
    sub(/^Usage: /, "")
    if (!usages++) printf ".SH SYNOPSIS\n.B %s\n.SH DESCRIPTION\n", text($0)
    else printf "%s.SS %s\n", usages == 2 ? ".SH COMMANDS\n" : "", text($0)
    part = "text"
    next
}
/^(Commands|Options):$/ { part = "terms"; next }
/^Examples:$/ {
    part = "examples"
    first = 1
    if (usages > 1) print ".PP\nExamples:\n.PP\n.nf"
    next
}
/^Exit codes: / { part = "codes"; sub(/^Exit codes: /, "") }
/^A value may also follow/ || / COMMAND --help describes/ { part = "" }
part == "examples" && /^$/ { if (usages > 1) print ".fi"; part = "" }
part == "codes" && /^$/ { part = "" }
part == "codes" { codes = codes " " $0 }
part == "terms" && match($0, /^ +(-|[a-z])[^ ]*( [^ ]+)*  +/) {
    printf ".TP\n.B %s\n%s\n", text(substr($0, 1, RLENGTH)), text(substr($0, RLENGTH + 1))
    next
}
part == "examples" {
    line = sprintf(".B %s\n", text($0))
    if (usages > 1) printf "%s", line
    if (usages == 1 || first) examples = examples line
    first = 0
}
part == "text" || part == "terms" { print /^$/ ? ".PP" : text($0) }
END {
    if (codes != "") printf ".SH EXIT STATUS\n%s\n", text(codes)
    while ((getline line < tail) > 0) {
        if (line == ".SH SEE ALSO") printf ".SH EXAMPLES\n.nf\n%s.fi\n", examples
        print line
    }
}
