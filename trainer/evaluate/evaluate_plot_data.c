// Writes errors, states and laws as text columns. Errors that a logarithmic axis cannot show are
// moved to the ends of its range.
#include "evaluate/evaluate_plot_data.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SMALLEST 1e-12
#define LARGEST 1e3 // per cent: the end of the axis

pm_status pm_plot_open(FILE **file, const char *folder, const char *name) {
    char path[4096];
    if ((size_t)snprintf(path, sizeof path, "%s/%s", folder, name) >= sizeof path) {
        return pm_fail(PM_EFILE, "%s: the path is too long", folder);
    }
    *file = fopen(path, "w");
    return *file != NULL ? PM_OK : pm_fail(PM_EFILE, "%s: %s", path, strerror(errno));
}

pm_status pm_plot_close(FILE *file, const char *folder) {
    const int failed = ferror(file);
    return fclose(file) == 0 && !failed ? PM_OK : pm_fail(PM_EFILE, "%s: cannot write", folder);
}

static double per_cent(double error) {
    return fmin(fmax(100 * error, SMALLEST), LARGEST);
}

static pm_status write_errors(const pm_evaluation *e, const char *folder, const char *name,
                              bool snapshots) {
    FILE *file;
    PM_TRY(pm_plot_open(&file, folder, name));
    const int ngroup = e->columns.ngroup;
    for (int i = 0; i < e->count; ++i) {
        const pm_rollout *r = &e->rollout[i];
        for (int j = snapshots ? 1 : 0; j < (snapshots ? e->truth->ntime : 1); ++j) {
            fprintf(file, "%d %.9g", r->trajectory, e->truth->t[j]);
            for (int g = 0; g < ngroup; ++g) {
                fprintf(file, " %.9g",
                        per_cent(snapshots ? r->snapshot[j * ngroup + g] : r->error[g]));
            }
            fputc('\n', file);
        }
    }
    return pm_plot_close(file, folder);
}

static pm_status write_states(const pm_evaluation *e, const char *folder) {
    FILE *file;
    PM_TRY(pm_plot_open(&file, folder, "states.txt"));
    for (int j = 0; j < e->truth->ntime; ++j) {
        const double *row[2] = {pm_dataset_state(e->truth, e->rollout[0].trajectory, j),
                                pm_dataset_state(e->predicted, 0, j)};
        fprintf(file, "%.9g", e->truth->t[j]);
        for (int k = 0; k < 2; ++k) {
            for (int i = 0; i < e->columns.nz; ++i) {
                const int column = e->columns.column[i];
                fprintf(file, " %.9g", column < 0 ? 0 : row[k][column]);
            }
        }
        fputc('\n', file);
    }
    return pm_plot_close(file, folder);
}

// Sorts the values of all rollouts and writes the columns of their distribution.
static void write_spread(FILE *file, int count, double *value) {
    const pm_box box = pm_box_of(count, value);
    fprintf(file, " %.9g %.9g %.9g %.9g %.9g", value[0], box.first_quartile, box.median,
            box.third_quartile, value[count - 1]);
}

// Writes growth.txt. `value` [count] is work space.
static pm_status write_growth(const pm_evaluation *e, const char *folder, double *value) {
    FILE *file;
    PM_TRY(pm_plot_open(&file, folder, "growth.txt"));
    const int ngroup = e->columns.ngroup;
    for (int j = 1; j < e->truth->ntime; ++j) {
        fprintf(file, "%.9g", e->truth->t[j] - e->truth->t[0]);
        for (int g = 0; g < ngroup; ++g) {
            for (int i = 0; i < e->count; ++i) {
                value[i] = per_cent(e->rollout[i].snapshot[j * ngroup + g]);
            }
            write_spread(file, e->count, value);
        }
        fputc('\n', file);
    }
    return pm_plot_close(file, folder);
}

// Writes laws.txt. `value` [count] is work space. At each time, rollouts that are no longer finite
// are left out.
static pm_status write_laws(const pm_evaluation *e, const char *folder, double *value) {
    FILE *file;
    PM_TRY(pm_plot_open(&file, folder, "laws.txt"));
    for (int j = 1; j < e->truth->ntime; ++j) {
        for (int k = 0; k < 2; ++k) {
            int count = 0;
            for (int i = 0; i < e->count; ++i) {
                const pm_rollout *r = &e->rollout[i];
                const double *total = k == 0 ? r->energy : r->entropy;
                const double change = total[j] - total[0];
                if (j < r->reached) {
                    value[count++] = k == 0 ? fmax(fabs(change), SMALLEST) : change;
                }
            }
            if (count == 0) {
                continue;
            }
            if (k == 0) {
                fprintf(file, "%.9g", e->truth->t[j] - e->truth->t[0]);
            }
            write_spread(file, count, value);
        }
        fputc('\n', file);
    }
    return pm_plot_close(file, folder);
}

pm_status pm_plot_write_data(const pm_evaluation *e, const pm_evaluation *trained,
                             const char *folder) {
    double *value = calloc((size_t)e->count, sizeof *value);
    if (value == NULL) {
        return pm_fail(PM_ENOMEM, "plot: out of memory");
    }
    pm_status status;
    PM_TRY_DONE(write_errors(e, folder, "trajectories.txt", false));
    PM_TRY_DONE(write_errors(e, folder, "snapshots.txt", true));
    if (trained != NULL) {
        PM_TRY_DONE(write_errors(trained, folder, "trained_trajectories.txt", false));
        PM_TRY_DONE(write_errors(trained, folder, "trained_snapshots.txt", true));
    }
    PM_TRY_DONE(write_states(e, folder));
    PM_TRY_DONE(write_growth(e, folder, value));
    if (pm_system_without_energy(e->system) < 0) {
        PM_TRY_DONE(write_laws(e, folder, value));
    }
done:
    free(value);
    return status;
}
