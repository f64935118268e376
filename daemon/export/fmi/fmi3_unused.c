// SPDX-License-Identifier: MIT
// The functions of FMI 3.0 that an FMU must have although its variables are all of type Float64, it
// has no clocks and no structural parameters. Part of fmi3.c.

#define TYPE(NAME, T)                                                                             \
    fmi3Status fmi3Get##NAME(fmi3Instance i, const fmi3ValueReference r[], size_t n, T v[],       \
                             size_t m) {                                                          \
        return n + m == 0 ? fmi3OK : refuse(i, "fmi3Get" #NAME ": all variables are Float64");    \
    }                                                                                             \
    fmi3Status fmi3Set##NAME(fmi3Instance i, const fmi3ValueReference r[], size_t n, const T v[], \
                             size_t m) {                                                          \
        return n + m == 0 ? fmi3OK : refuse(i, "fmi3Set" #NAME ": all variables are Float64");    \
    }
TYPE(Float32, fmi3Float32)
TYPE(Int8, fmi3Int8)
TYPE(UInt8, fmi3UInt8)
TYPE(Int16, fmi3Int16)
TYPE(UInt16, fmi3UInt16)
TYPE(Int32, fmi3Int32)
TYPE(UInt32, fmi3UInt32)
TYPE(Int64, fmi3Int64)
TYPE(UInt64, fmi3UInt64)
TYPE(Boolean, fmi3Boolean)
TYPE(String, fmi3String)

fmi3Status fmi3GetBinary(fmi3Instance i, const fmi3ValueReference r[], size_t n, size_t sizes[],
                         fmi3Binary v[], size_t m) {
    return n + m == 0 ? fmi3OK : refuse(i, "fmi3GetBinary: all variables are Float64");
}

fmi3Status fmi3SetBinary(fmi3Instance i, const fmi3ValueReference r[], size_t n,
                         const size_t sizes[], const fmi3Binary v[], size_t m) {
    return n + m == 0 ? fmi3OK : refuse(i, "fmi3SetBinary: all variables are Float64");
}

static fmi3Status no_clock(fmi3Instance i, size_t n) {
    return n == 0 ? fmi3OK : refuse(i, "the FMU has no clocks");
}

// A function of clocks with one or two arrays of values.
#define CLOCK(NAME, T)                                                               \
    fmi3Status NAME(fmi3Instance i, const fmi3ValueReference r[], size_t n, T v[]) { \
        return no_clock(i, n);                                                       \
    }
#define CLOCK2(NAME, T, U)                                                                  \
    fmi3Status NAME(fmi3Instance i, const fmi3ValueReference r[], size_t n, T v[], U w[]) { \
        return no_clock(i, n);                                                              \
    }
CLOCK(fmi3GetClock, fmi3Clock)
CLOCK(fmi3SetClock, const fmi3Clock)
CLOCK2(fmi3GetIntervalDecimal, fmi3Float64, fmi3IntervalQualifier)
CLOCK(fmi3SetIntervalDecimal, const fmi3Float64)
CLOCK2(fmi3SetIntervalFraction, const fmi3UInt64, const fmi3UInt64)
CLOCK(fmi3GetShiftDecimal, fmi3Float64)
CLOCK(fmi3SetShiftDecimal, const fmi3Float64)
CLOCK2(fmi3GetShiftFraction, fmi3UInt64, fmi3UInt64)
CLOCK2(fmi3SetShiftFraction, const fmi3UInt64, const fmi3UInt64)

fmi3Status fmi3GetIntervalFraction(fmi3Instance i, const fmi3ValueReference r[], size_t n,
                                   fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                   fmi3IntervalQualifier qualifiers[]) {
    return no_clock(i, n);
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance i, fmi3ValueReference clock, fmi3Float64 time) {
    return no_clock(i, 1);
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance i, const fmi3ValueReference r[], size_t n,
                                    const fmi3Int32 orders[], fmi3Float64 v[], size_t m) {
    return n + m == 0 ? fmi3OK : refuse(i, "the FMU has no derivatives of outputs by time");
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance i) {
    return refuse(i, "the FMU has no structural parameters");
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance i) {
    return refuse(i, "the FMU has no structural parameters");
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance i, fmi3ValueReference r, size_t *n) {
    *n = 0;
    return refuse(i, "the dependencies stand in modelDescription.xml");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance i, fmi3ValueReference r, size_t elements[],
                                       fmi3ValueReference independent[], size_t others[],
                                       fmi3DependencyKind kinds[], size_t n) {
    return refuse(i, "the dependencies stand in modelDescription.xml");
}
