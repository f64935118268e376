// Chooses the trajectories of both parts from lists, and reorders a dataset accordingly.
#include "data/split.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/options.h"

#define ONE_IN 5 // one in so many trajectories is kept back for validation by default

// Writes trajectories as a list: runs of neighbours as "A:B", in rising order.
static const char *list_of(int n, const int *which, pm_arena *arena) {
    const char *text = "";
    for (int i = 0; i < n && text != NULL;) {
        int end = i + 1;
        while (end < n && which[end] == which[end - 1] + 1) {
            ++end;
        }
        const char *comma = *text == '\0' ? "" : ",";
        text = end == i + 1
                   ? pm_arena_printf(arena, "%s%s%d", text, comma, which[i])
                   : pm_arena_printf(arena, "%s%s%d:%d", text, comma, which[i], which[end - 1] + 1);
        i = end;
    }
    return text;
}

pm_status pm_split_choose(pm_split *split, int count, const char *trajectories,
                          const char *validation, pm_arena *arena) {
    const size_t size = (size_t)count + 1;
    int *used = pm_arena_array(arena, size, sizeof *used);
    int *work = pm_arena_array(arena, size, sizeof *work);
    bool *kept = pm_arena_array(arena, size, sizeof *kept);
    int *chosen = pm_arena_array(arena, size, sizeof *chosen);
    int nused = 0;
    PM_TRY(pm_arena_status(arena, "trajectories"));
    PM_TRY(pm_options_list(trajectories, count, used, &nused));
    if (validation == NULL) {
        for (int i = ONE_IN - 1; i < nused; i += ONE_IN) {
            kept[used[i]] = true;
        }
    } else if (strcmp(validation, "none") != 0) {
        int nkept = 0;
        PM_TRY(pm_options_list(validation, count, work, &nkept));
        for (int i = 0; i < nkept; ++i) {
            kept[work[i]] = true;
        }
    }
    *split = (pm_split){.trajectory = chosen};
    for (int i = 0; i < nused; ++i) {
        if (!kept[used[i]]) {
            chosen[split->ntraining++] = used[i];
        }
    }
    for (int i = 0; i < count; ++i) {
        if (kept[i]) {
            chosen[split->ntraining + split->nvalidation++] = i;
        }
    }
    if (split->ntraining == 0) {
        return pm_fail(PM_EUSAGE, "trajectories \"%s\" to validate on leave none to train on",
                       validation);
    }
    split->training = list_of(split->ntraining, chosen, arena);
    split->validation = list_of(split->nvalidation, chosen + split->ntraining, arena);
    return pm_arena_status(arena, "trajectories");
}

// Moves the blocks of `size` numbers of the chosen trajectories into their new order. `work` has
// room for all of them.
static void gather(const pm_split *split, size_t size, double *value, double *work) {
    const int n = split->ntraining + split->nvalidation;
    for (int i = 0; i < n; ++i) {
        memcpy(work + (size_t)i * size, value + (size_t)split->trajectory[i] * size,
               size * sizeof *value);
    }
    memcpy(value, work, (size_t)n * size * sizeof *value);
}

pm_status pm_split_reorder(const pm_split *split, pm_dataset *dataset) {
    const int n = split->ntraining + split->nvalidation;
    const size_t size = (size_t)dataset->ntime * (size_t)dataset->ncolumn;
    bool sorted = true;
    for (int i = 0; i < n; ++i) {
        sorted = sorted && split->trajectory[i] == i;
    }
    if (!sorted) {
        double *work = malloc((size_t)n * size * sizeof *work);
        PM_TRY(work != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for trajectories"));
        gather(split, size, dataset->z, work);
        if (dataset->zdot != NULL) {
            gather(split, size, dataset->zdot, work);
        }
        free(work);
    }
    dataset->ntrajectory = n;
    return PM_OK;
}
