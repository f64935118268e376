// A record is a cursor over an array of numbers.
#include "base/record.h"

#include "base/digest.h"

pm_record pm_record_count(const char *kind) {
    return (pm_record){.layout = pm_digest_text(PM_DIGEST_INIT, kind)};
}

pm_record pm_record_save(const char *kind, double *number) {
    pm_record record = pm_record_count(kind);
    record.to = number;
    return record;
}

pm_record pm_record_restore(const char *kind, const double *number) {
    pm_record record = pm_record_count(kind);
    record.from = number;
    return record;
}

void pm_record_put(pm_record *record, const char *name, double *value, int count) {
    record->layout = pm_digest_integer(pm_digest_text(record->layout, name), count);
    record->count += count;
    if (record->to != NULL) {
        for (int i = 0; i < count; ++i) {
            *record->to++ = value == NULL ? 0 : value[i];
        }
    }
    if (record->from != NULL) {
        for (int i = 0; i < count && value != NULL; ++i) {
            value[i] = record->from[i];
        }
        record->from += count;
    }
}

void pm_record_put_long(pm_record *record, const char *name, long *value) {
    double number = (double)*value;
    pm_record_put(record, name, &number, 1);
    *value = (long)number;
}

void pm_record_put_int(pm_record *record, const char *name, int *value) {
    long number = *value;
    pm_record_put_long(record, name, &number);
    *value = (int)number;
}
