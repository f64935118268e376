// Relative errors of predicted states at the times of measurements.
#include "command/evaluate_truth.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sim/score.h"

#define EQUAL 1e-6 // part of dt by which times of measurements and truth may differ

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "evaluate: out of memory for errors against the truth");
}

// Finds the state of the truth at time t of a trajectory.
static pm_status find_state(const pm_dataset *truth, const char *path, int trajectory, double t,
                            const double **row) {
    const double at = (t - truth->t[0]) / truth->dt;
    const double k = floor(at + 0.5);
    if (trajectory >= truth->ntrajectory || k < 0 || k >= truth->ntime || fabs(at - k) > EQUAL) {
        return pm_fail(PM_EDATA, "%s: has no state of trajectory %d at %g s", path, trajectory, t);
    }
    *row = pm_dataset_state(truth, trajectory, (int)k);
    return PM_OK;
}

// Scores estimate number `id`. `row` [truth->ncolumn] is work space.
static pm_status score(pm_truth_errors *e, const pm_columns *columns, const pm_estimate *estimate,
                       const pm_dataset *data, const pm_dataset *truth, const char *path,
                       int trajectory, int id, pm_score_sums *sums, double *row) {
    memset(sums, 0, (size_t)e->ngroup * sizeof *sums);
    for (int k = 0; k < data->ntime; ++k) {
        const double t = pm_dataset_time(data, trajectory, k);
        const double *expected = NULL;
        if (isnan(t)) {
            break;
        }
        PM_TRY(find_state(truth, path, trajectory, t, &expected));
        pm_columns_to_row(columns,
                          estimate->z + ((ptrdiff_t)id * estimate->ntime + k) * estimate->nz, row);
        for (int g = 0; g < e->ngroup; ++g) {
            pm_score_add(columns, g, row, expected, &sums[g]);
        }
    }
    for (int g = 0; g < e->ngroup; ++g) {
        e->error[(ptrdiff_t)g * e->count + id] = pm_score_of(&sums[g]);
    }
    return PM_OK;
}

static pm_status make(pm_truth_errors *e, const pm_scene *scene, const pm_estimate *estimate,
                      const pm_dataset *data, const pm_dataset *truth, const int *which,
                      const char *path) {
    pm_columns columns;
    PM_TRY(pm_columns_bind(&columns, scene, truth, &e->arena));
    e->ngroup = columns.ngroup;
    e->group = columns.group_name;
    const size_t groups = (size_t)e->ngroup;
    e->error = pm_arena_array(&e->arena, groups * (size_t)e->count, sizeof *e->error);
    pm_score_sums *sums = pm_arena_array(&e->arena, groups, sizeof *sums);
    double *row = pm_arena_array(&e->arena, (size_t)truth->ncolumn, sizeof *row);
    if (e->error == NULL || sums == NULL || row == NULL) {
        return no_memory();
    }
    for (int i = 0; i < e->count; ++i) {
        PM_TRY(score(e, &columns, estimate, data, truth, path, which[i], i, sums, row));
    }
    return PM_OK;
}

pm_status pm_truth_errors_make(pm_truth_errors *errors, const pm_scene *scene,
                               const pm_estimate *estimate, const pm_dataset *data,
                               const int *which, const char *path) {
    pm_dataset *truth = NULL;
    *errors = (pm_truth_errors){.count = estimate->count};
    pm_status status = pm_dataset_load(&truth, path);
    if (status == PM_OK) {
        status = make(errors, scene, estimate, data, truth, which, path);
    }
    pm_dataset_free(truth);
    if (status != PM_OK) {
        pm_truth_errors_free(errors);
    }
    return status;
}

void pm_truth_errors_free(pm_truth_errors *errors) {
    pm_arena_free(&errors->arena);
    *errors = (pm_truth_errors){0};
}

pm_status pm_truth_errors_print(const pm_truth_errors *errors) {
    double *sorted = malloc((size_t)errors->count * sizeof *sorted);
    if (sorted == NULL) {
        return no_memory();
    }
    printf("Relative L2 error of all states against the truth, %%\n%-16s %10s %10s %10s\n", "group",
           "median", "mean", "largest");
    for (int g = 0; g < errors->ngroup; ++g) {
        memcpy(sorted, errors->error + (ptrdiff_t)g * errors->count,
               (size_t)errors->count * sizeof *sorted);
        const pm_box box = pm_box_of(errors->count, sorted);
        printf("%-16s %10.3g %10.3g %10.3g\n", errors->group[g], 100 * box.median, 100 * box.mean,
               100 * box.largest);
    }
    free(sorted);
    return PM_OK;
}
