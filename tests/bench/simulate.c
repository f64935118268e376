// Runs a truth simulator for the benches of training.
#include "simulate.h"

#include <stdlib.h>

#include "truth/truth.h"

pm_status bench_simulate(pm_dataset **dataset, const char *path, int count) {
    pm_truth *truth = NULL;
    double *check = NULL;
    pm_status status;
    PM_TRY_DONE(pm_truth_load(&truth, path, NULL));
    PM_TRY_DONE(pm_dataset_new(dataset, count, truth->ntime, truth->model.ode.nz, truth->dt,
                               truth->model.column));
    check = calloc((size_t)truth->ntime * (size_t)(*dataset)->ncolumn, sizeof *check);
    if (check == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory");
        goto done;
    }
    for (int i = 0; i < count; ++i) {
        PM_TRY_DONE(pm_truth_run(truth, i, pm_dataset_state(*dataset, i, 0), check));
    }
done:
    free(check);
    pm_truth_free(truth);
    return status;
}
