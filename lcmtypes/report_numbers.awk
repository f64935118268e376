# report_numbers.awk: lists the numbers of report_t for daemon/scene/sample.h.
#   awk -f report_numbers.awk portmet.lcm > report_numbers.h
# A comment of a number that a recording keeps as a series ends with its unit and "Recorded as NAME.", in one line.
/^struct / { struct = $2 }
struct == "report_t" && /\[(npart|nend)\];/ {
    split($0, word, /[ \t;\[\]]+/)
    name = word[3]
    unit = series = "NULL"
    if (match($0, /, [^ ,]+\. Recorded as [^ ]+\.$/)) {
        split(substr($0, RSTART + 2, RLENGTH - 3), part, /\. Recorded as /)
        unit = "\"" part[1] "\""
        series = "\"" part[2] "\""
    }
    if (/Recorded/ && series == "NULL") {
        print "portmet.lcm:" NR ": expected \", UNIT. Recorded as NAME.\" with a unit without blanks" > "/dev/stderr"
        exit failed = 1
    }
    member = name
    if (word[4] == "nend") {
        sub(/_flux$/, "", member)
        ends = ends " \\\n    END(" member ", " name ", " series ", " unit ")"
    } else if (sub(/^bulk_/, "", member)) {
        numbers = numbers " \\\n    BULK(" member ", " name ", " series ", " unit ")"
    } else {
        type = word[2] == "double" ? "double" : "long"
        numbers = numbers " \\\n    NUMBER(" type ", " name ", " series ", " unit ")"
    }
}
END {
    if (failed) {
        exit 1
    }
    print "// Generated from lcmtypes/portmet.lcm by report_numbers.awk."
    print "#define PM_SUBSYSTEM_NUMBERS(NUMBER, BULK)" numbers
    print "#define PM_END_NUMBERS(END)" ends
}
