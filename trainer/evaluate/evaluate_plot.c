// Writes the numbers of an evaluation as text columns, and calls the program that draws them.
#include "evaluate/evaluate_plot.h"

#include <math.h>
#include <stdio.h>

#include "base/python.h"

// Errors that a logarithmic axis cannot show are moved to the ends of its range, in per cent.
#define SMALLEST 1e-12
#define LARGEST 1e3

// Writes a row for each trajectory, or for each state but the first with `snapshots`.
static pm_status write_errors(const pm_evaluation *e, const char *folder, const char *name,
                              bool snapshots) {
    const int ngroup = e->columns.ngroup;
    const bool energy = pm_system_without_energy(e->system) < 0;
    FILE *file;
    PM_TRY(pm_python_table(&file, folder, name));
    fputs("# trajectory time", file);
    for (int g = 0; g < ngroup; ++g) {
        fprintf(file, " %s", e->columns.group_name[g]);
    }
    fputs(" E S\n", file);
    for (int i = 0; i < e->count; ++i) {
        const pm_rollout *r = &e->rollout[i];
        for (int j = snapshots ? 1 : 0; j < (snapshots ? r->length : 1); ++j) {
            fprintf(file, "%d %.9g", r->trajectory, e->truth->t[j]);
            for (int g = 0; g < ngroup; ++g) {
                const double error = snapshots ? r->snapshot[j * ngroup + g] : r->error[g];
                fprintf(file, " %.9g", fmin(fmax(100 * error, SMALLEST), LARGEST));
            }
            const bool known = energy && j < r->reached;
            fprintf(file, " %.17g %.17g\n", known ? r->energy[j] : NAN,
                    known ? r->entropy[j] : NAN);
        }
    }
    return pm_python_table_close(file, folder);
}

// Writes the first rollout, below its number and the groups with their units, separated by tabs,
// the group of each component, and their columns.
static pm_status write_states(const pm_evaluation *e, const char *folder) {
    const pm_columns *c = &e->columns;
    const pm_physics *physics = &e->system->scene->physics;
    FILE *file;
    PM_TRY(pm_python_table(&file, folder, "/states.txt"));
    fprintf(file, "# %d", e->rollout[0].trajectory);
    for (int g = 0; g < c->ngroup; ++g) {
        const pm_group *group = NULL; // the first group with this name in any subsystem
        for (int i = 0; i < physics->nsubsystem && group == NULL; ++i) {
            group = pm_layout_find(&physics->subsystem[i].layout, c->group_name[g]);
        }
        fprintf(file, "\t%s, %s", c->group_name[g], group == NULL ? "" : group->unit);
    }
    for (int line = 0; line < 2; ++line) {
        fputs("\n#", file);
        for (int i = 0; i < c->nz; ++i) {
            const int column = c->column[i];
            if (line == 0) {
                fprintf(file, " %d", c->group[i]);
            } else {
                fprintf(file, " %s", column < 0 ? "-" : e->truth->column[column]);
            }
        }
    }
    fputc('\n', file);
    for (int j = 0; j < e->rollout[0].length; ++j) {
        const double *row[2] = {pm_dataset_state(e->truth, e->rollout[0].trajectory, j),
                                pm_dataset_state(e->predicted, 0, j)};
        fprintf(file, "%.9g", e->truth->t[j]);
        for (int i = 0; i < 2 * c->nz; ++i) {
            const int column = c->column[i % c->nz];
            fprintf(file, " %.9g", column < 0 ? 0 : row[i / c->nz][column]);
        }
        fputc('\n', file);
    }
    return pm_python_table_close(file, folder);
}

pm_status pm_evaluation_plot(const pm_evaluation *e, const pm_evaluation *trained,
                             const char *folder) {
    PM_TRY(pm_python_folder(folder));
    PM_TRY(write_errors(e, folder, "/trajectories.txt", false));
    PM_TRY(write_errors(e, folder, "/snapshots.txt", true));
    if (trained != NULL) {
        PM_TRY(write_errors(trained, folder, "/trained_trajectories.txt", false));
        PM_TRY(write_errors(trained, folder, "/trained_snapshots.txt", true));
    }
    PM_TRY(write_states(e, folder));
    return pm_python_run(&pm_python_pictures, (const char *[]){"evaluation", folder, NULL}, false);
}
