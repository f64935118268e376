// A serializer is a cursor over an array of numbers.
#include "base/serializer.h"

#include "base/digest.h"

pm_serializer pm_serializer_count(const char *kind) {
    return (pm_serializer){.layout = pm_digest_text(PM_DIGEST_INIT, kind)};
}

pm_serializer pm_serializer_save(const char *kind, double *number) {
    pm_serializer serializer = pm_serializer_count(kind);
    serializer.to = number;
    return serializer;
}

pm_serializer pm_serializer_restore(const char *kind, const double *number) {
    pm_serializer serializer = pm_serializer_count(kind);
    serializer.from = number;
    return serializer;
}

void pm_serializer_put(pm_serializer *serializer, const char *name, double *value, int count) {
    serializer->layout = pm_digest_integer(pm_digest_text(serializer->layout, name), count);
    serializer->count += count;
    if (serializer->to != NULL) {
        for (int i = 0; i < count; ++i) {
            *serializer->to++ = value == NULL ? 0 : value[i];
        }
    }
    if (serializer->from != NULL) {
        for (int i = 0; i < count && value != NULL; ++i) {
            value[i] = serializer->from[i];
        }
        serializer->from += count;
    }
}

void pm_serializer_put_long(pm_serializer *serializer, const char *name, long *value) {
    double number = (double)*value;
    pm_serializer_put(serializer, name, &number, 1);
    *value = (long)number;
}

void pm_serializer_put_int(pm_serializer *serializer, const char *name, int *value) {
    long number = *value;
    pm_serializer_put_long(serializer, name, &number);
    *value = (int)number;
}
