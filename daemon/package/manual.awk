# manual.awk: turns a page of this repository (Markdown) into a manual page of section 5.
#   awk -v name=portmet-scene -v about="..." [-v part="The dataset"] -f manual.awk PAGE
# With `part`, only the section of that heading. Headings, paragraphs, lists, code and tables are known;
# in a table the first column becomes the term.
function text(s,    link) {
    gsub(/\\/, "\\e", s)
    gsub(/`/, "", s)
    gsub(/\*\*/, "", s)
    while (match(s, /\[[^][]*\]\([^()]*\)/)) {
        link = substr(s, RSTART + 1, RLENGTH - 2)
        s = substr(s, 1, RSTART - 1) substr(link, 1, index(link, "](") - 1) substr(s, RSTART + RLENGTH)
    }
    gsub(/-/, "\\-", s)
    return s ~ /^[.']/ ? "\\&" s : s
}
# Prints the paragraph or the list item read so far.
function flush() {
    if (buffer != "") print begin (begin == "" ? "" : "\n") text(buffer)
    buffer = begin = ""
}
function level(s) { match(s, /^#+/); return RLENGTH }
BEGIN {
    printf ".TH %s 5 \"\" \"portmet\" \"File Formats\"\n.SH NAME\n%s \\- %s\n.SH DESCRIPTION\n", toupper(name), name, about
    on = part == ""
}
/^```/ { flush(); code = !code; if (on) print code ? ".PP\n.EX" : ".EE"; next }
!code && /^#/ {
    flush()
    in_table = 0
    title = $0
    sub(/^#+ */, "", title)
    depth = level($0)
    if (part != "") {
        if (title == part) { on = 1; top = depth; depth = 2 }
        else if (on && depth <= top) { exit }
    }
    if (on && depth > 1) print (depth == 2 ? ".SH " : ".SS ") text(title)
    next
}
!on { next }
code || (buffer == "" && /^    /) {
    if (!code && !indented) print ".PP\n.EX"
    indented = !code
    print text($0)
    next
}
indented { indented = 0; print ".EE" }
/^\|[-| :]*\|$/ { next }
/^\|/ {
    flush()
    line = $0
    gsub(/\\\|/, "\001", line)
    n = split(line, cell, /\|/)
    for (i = 2; i < n; ++i) {
        gsub(/^ +| +$/, "", cell[i])
        gsub(/\001/, "|", cell[i])
    }
    if (!in_table) {
        in_table = 1
        for (i = 2; i < n; ++i) head[i] = cell[i]
        next
    }
    print ".TP\n.B " (cell[2] == "" ? "\\&" : text(cell[2]))
    for (i = 3; i < n - 1; ++i) if (cell[i] != "") print text(head[i] ": " cell[i]) (i < n - 2 ? ";" : ".")
    if (n > 3) print text(cell[n - 1])
    next
}
{ in_table = 0 }
/^[-*] / { flush(); sub(/^[-*] /, ""); buffer = $0; begin = ".IP \\(bu 2"; next }
/^ *$/ { flush(); print ".PP"; next }
{ buffer = buffer == "" ? $0 : buffer " " $0; sub(/  +/, " ", buffer) }
END { flush() }
