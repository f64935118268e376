# wire_types.awk: describes each struct of portmet.lcm to the codec (daemon/lockstep/codec.h).
#   awk -f wire_types.awk portmet.lcm > wire_types.c
# Knows what portmet.lcm uses: numbers, booleans, strings, and arrays of double or int64_t whose length
# is an int32_t of the same struct.
BEGIN {
    kind["int8_t"] = "I8"; kind["boolean"] = "BOOLEAN"; kind["int32_t"] = "I32"
    kind["int64_t"] = "I64"; kind["double"] = "DOUBLE"; kind["string"] = "TEXT"
    array["double"] = "DOUBLES"; array["int64_t"] = "I64S"
    print "// Generated from lcmtypes/portmet.lcm by wire_types.awk."
    print "#include \"lockstep/codec.h\""
}
{ sub(/\/\/.*/, "") }
/^struct / {
    struct = $2
    count = 0
    delete is_length
}
/;/ && !/const|package/ {
    split($0, word, /[ \t;\[\]]+/)
    first = word[1] == "" ? 2 : 1
    type[++count] = word[first]; name[count] = word[first + 1]; length_of[count] = word[first + 2]
    is_length[length_of[count]] = 1
    if (!((length_of[count] == "" ? type[count] in kind : type[count] in array))) {
        print "portmet.lcm:" NR ": no codec for: " $0 > "/dev/stderr"
        exit 1
    }
}
/^}/ {
    message = "portmet_" struct
    sub(/_t$/, "_type", struct)
    print "\nconst pm_wire_type pm_" struct " = {__" message "_get_hash, " count ", (const pm_wire_field[]){"
    for (i = 1; i <= count; ++i) {
        field = "offsetof(" message ", " name[i] ")"
        if (length_of[i] != "") {
            print "    {PM_WIRE_" array[type[i]] ", " field ", offsetof(" message ", " length_of[i] ")},"
        } else {
            print "    {PM_WIRE_" (name[i] in is_length ? "COUNT" : kind[type[i]]) ", " field ", 0},"
        }
    }
    print "}};"
    all = all "&pm_" struct ", "
}
END { print "\nconst pm_wire_type *const pm_wire_types[] = {" all "NULL};" }
