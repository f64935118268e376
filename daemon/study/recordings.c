// Goes through the groups of a recording, and through the series of each.
#include "study/recordings.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "store/hdf5_io.h"

typedef struct recording_pair {
    pm_hdf5 *file[2];
    bool beginning;
    int sample; // the earliest one that differs; -1: none
    char *difference;
    int size;
} recording_pair;

// Reads a series to *number, which the caller frees: [extent[0]] rows of *width numbers.
static pm_status read_series(const pm_hdf5 *file, const char *name, int *extent, int *rank,
                             size_t *width, double **number) {
    pm_status status = PM_EFILE;
    for (*rank = 1; *rank <= PM_HDF5_MAX_RANK && status != PM_OK; ++*rank) {
        status = pm_hdf5_shape(file, name, *rank, extent);
    }
    PM_TRY(status);
    *rank -= 1;
    *width = 1;
    for (int i = 1; i < *rank; ++i) {
        *width *= (size_t)extent[i];
    }
    *number = calloc((size_t)extent[0] * *width, sizeof **number);
    return *number == NULL ? pm_fail(PM_ENOMEM, "out of memory for a recording")
                           : pm_hdf5_read(file, name, *rank, extent, *number);
}

// Compares a series. The first difference is described by its variable if it is a state, and by its
// member if the series is that of many subsystems or ports.
static pm_status compare_series(recording_pair *c, const char *group, const char *series) {
    double *number[2] = {NULL, NULL};
    int extent[2][PM_HDF5_MAX_RANK] = {{0}}, rank[2];
    size_t width[2];
    pm_arena arena = {0};
    pm_status status = PM_OK;
    for (int i = 0; i < 2; ++i) {
        PM_TRY_DONE(read_series(c->file[i], series, extent[i], &rank[i], &width[i], &number[i]));
    }
    const bool fits = c->beginning ? extent[1][0] <= extent[0][0] : extent[1][0] == extent[0][0];
    if (width[0] != width[1] || !fits) {
        c->sample = 0;
        snprintf(c->difference, (size_t)c->size, "%s: %d and %d samples of %zu and %zu numbers",
                 series, extent[0][0], extent[1][0], width[0], width[1]);
        goto done;
    }
    for (size_t i = 0; i < (size_t)extent[1][0] * width[0]; ++i) {
        const int sample = (int)(i / width[0]);
        if (c->sample >= 0 && sample >= c->sample) {
            break;
        }
        if (memcmp(&number[0][i], &number[1][i], sizeof **number) != 0) {
            const char *what = strrchr(series, '/') + 1, **name = NULL;
            const bool is_state = strcmp(what, "z") == 0;
            const size_t last = is_state ? (size_t)extent[0][rank[0] - 1] : 1, k = i % width[0];
            char component[64] = "", member[32] = "";
            int count = 0;
            if (is_state && pm_hdf5_read_texts(c->file[0], series, "variables", &arena, &count,
                                               &name) == PM_OK) {
                snprintf(component, sizeof component, " %s",
                         (size_t)count == last ? name[k % last] : "");
            }
            if (rank[0] > (is_state ? 2 : 1)) {
                snprintf(member, sizeof member, " member %zu", k / last);
            }
            c->sample = sample;
            snprintf(c->difference, (size_t)c->size, "%s%s, %s%s at step %d: %.17g and %.17g",
                     group + 1, member, what, component, sample, number[0][i], number[1][i]);
            break;
        }
    }
done:
    pm_arena_free(&arena);
    free(number[0]);
    free(number[1]);
    return status;
}

// Compares the series of a group, or with `nested` those of its members. States come first, so that
// a difference names a state where one differs.
static pm_status compare_group(recording_pair *c, const char *group, bool nested) {
    pm_arena arena = {0};
    int count[2] = {0};
    const char **name[2] = {NULL};
    pm_status status = PM_OK;
    for (int i = 0; i < 2; ++i) {
        if (pm_hdf5_has(c->file[i], group)) {
            PM_TRY_DONE(pm_hdf5_members(c->file[i], group, &arena, &count[i], &name[i]));
        }
    }
    bool same = count[0] == count[1];
    for (int i = 0; i < count[0] && same; ++i) {
        same = strcmp(name[0][i], name[1][i]) == 0;
    }
    if (!same) {
        c->sample = 0;
        snprintf(c->difference, (size_t)c->size, "%s: other series", group);
        goto done;
    }
    for (int i = count[0] - 1; i >= 0; --i) { // "z" is the last in the alphabet
        char path[256];
        snprintf(path, sizeof path, "%s/%s", group, name[0][i]);
        PM_TRY_DONE(nested ? compare_group(c, path, false) : compare_series(c, group, path));
    }
done:
    pm_arena_free(&arena);
    return status;
}

static pm_status compare(const char *path_a, const char *path_b, bool beginning, char *difference,
                         int size) {
    recording_pair c = {
        .sample = -1, .beginning = beginning, .difference = difference, .size = size};
    pm_status status;
    difference[0] = '\0';
    PM_TRY_DONE(pm_hdf5_open(&c.file[0], path_a, PM_HDF5_ANY, PM_EFILE));
    PM_TRY_DONE(pm_hdf5_open(&c.file[1], path_b, PM_HDF5_ANY, PM_EFILE));
    PM_TRY_DONE(compare_group(&c, "/subsystems", true));
    PM_TRY_DONE(compare_group(&c, "/ports", true));
    PM_TRY_DONE(compare_group(&c, "/live", false));
    PM_TRY_DONE(compare_group(&c, "/ledger", false));
done:
    pm_hdf5_close(c.file[0]);
    pm_hdf5_close(c.file[1]);
    return status;
}

static void try_compare(const void *path) {
    char difference[256];
    (void)compare(path, path, false, difference, sizeof difference);
}

pm_status pm_recordings_compare(const char *path_a, const char *path_b, bool beginning,
                                char *difference, int size) {
    PM_TRY(pm_hdf5_try(path_a, try_compare, path_a));
    PM_TRY(pm_hdf5_try(path_b, try_compare, path_b));
    return compare(path_a, path_b, beginning, difference, size);
}
