// The fields of a checkpoint, put into a record one after another.
#include "store/checkpoint.h"

#include <stdlib.h>

#include "base/record.h"
#include "store/snapshot.h"

static void put_fields(pm_record *record, int nfield, const pm_checkpoint_field *field) {
    for (int i = 0; i < nfield; ++i) {
        pm_record_put(record, field[i].name, field[i].value, field[i].count);
    }
}

// Counts the numbers and allocates them; the caller frees. PM_ENOMEM.
static pm_status prepare(const char *path, const char *kind, uint64_t digest, int nfield,
                         const pm_checkpoint_field *field, pm_snapshot_key *key, double **number) {
    pm_record record = pm_record_count(kind);
    put_fields(&record, nfield, field);
    *key = (pm_snapshot_key){digest, record.layout, record.count};
    *number = malloc(((size_t)record.count + 1) * sizeof **number);
    return *number != NULL
               ? PM_OK
               : pm_fail(PM_ENOMEM, "%s: out of memory for %d numbers", path, record.count);
}

pm_status pm_checkpoint_save(const char *path, const char *kind, uint64_t digest, int nfield,
                             const pm_checkpoint_field *field) {
    pm_snapshot_key key;
    double *number;
    PM_TRY(prepare(path, kind, digest, nfield, field, &key, &number));
    pm_record record = pm_record_save(kind, number);
    put_fields(&record, nfield, field);
    const pm_status status = pm_snapshot_save_synced(path, &key, 0, number);
    free(number);
    return status;
}

pm_status pm_checkpoint_load(const char *path, const char *kind, uint64_t digest, int nfield,
                             const pm_checkpoint_field *field) {
    pm_snapshot_key key;
    double *number;
    int64_t session;
    bool found;
    PM_TRY(prepare(path, kind, digest, nfield, field, &key, &number));
    pm_status status = pm_snapshot_load(path, &key, &session, number, &found);
    if (status == PM_OK && !found) {
        status = pm_fail(PM_EFILE, "%s: there is no checkpoint to go on from", path);
    }
    if (status == PM_OK) {
        pm_record record = pm_record_restore(kind, number);
        put_fields(&record, nfield, field);
    }
    free(number);
    return status;
}
