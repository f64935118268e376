// Scores each group of each subsystem separately, where the columns of a scene pool groups of the
// same name.
#include "evaluate/measure.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "inference/black_box.h"
#include "sim/monolithic.h"

#define MOST_STEPS 400 // the most single steps
#define SMALLEST 1e-9  // bounds of the ratio of an error to that of persistence in the mean
#define LARGEST 1e4    // also the ratio of a rollout that is not finite
#define MOST_BLACK 120 // components of a state with which a black box is trained
#define CONSTANT 1e-12 // error of persistence below which a group counts as constant

// Makes one cell, and one group of `columns`, for each group of each subsystem, and measures the
// rollouts.
static pm_status measure_rollouts(pm_measure *m, pm_columns *columns) {
    const pm_evaluation *e = m->evaluation;
    const pm_scene *scene = e->system->scene;
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        m->ncell += scene->physics.subsystem[i].layout.ngroup;
    }
    *columns = e->columns;
    columns->ngroup = m->ncell;
    columns->group = pm_arena_array(&m->arena, (size_t)scene->physics.nz, sizeof *columns->group);
    m->cell = pm_arena_array(&m->arena, (size_t)m->ncell, sizeof *m->cell);
    PM_TRY(pm_arena_status(&m->arena, "scores"));
    int cell = 0;
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_scene_subsystem *s = &scene->physics.subsystem[i];
        for (int g = 0; g < s->layout.ngroup; ++g, ++cell) {
            const pm_group *group = &s->layout.group[g];
            m->cell[cell] =
                (pm_measure_cell){.part = s->name, .group = group->name, .one_step = NAN};
            for (int c = 0; c < group->size; ++c) {
                columns->group[s->first + group->first + c] = cell;
            }
        }
    }
    const int ntime = e->truth->ntime, ncolumn = e->truth->ncolumn;
    const size_t n = (size_t)e->count, size = n * (size_t)m->ncell;
    double *error = pm_arena_array(&m->arena, size, sizeof *error);             // [count][ncell]
    double *persistence = pm_arena_array(&m->arena, size, sizeof *persistence); // likewise
    double *one = pm_arena_array(&m->arena, n, sizeof *one);
    double *still = pm_arena_array(&m->arena, (size_t)ntime * (size_t)ncolumn, sizeof *still);
    m->each = pm_arena_array(&m->arena, n, sizeof *m->each);
    PM_TRY(pm_arena_status(&m->arena, "scores"));
    for (int i = 0; i < e->count; ++i) {
        const double *truth = pm_dataset_state(e->truth, e->rollout[i].trajectory, 0);
        double *own = error + (ptrdiff_t)i * m->ncell;
        const int length = e->rollout[i].length;
        pm_score(columns, length, ncolumn, pm_dataset_state(e->predicted, i, 0), truth, own, NULL);
        for (int j = 0; j < length; ++j) {
            memcpy(still + (ptrdiff_t)j * ncolumn, truth, (size_t)ncolumn * sizeof *still);
        }
        pm_score(columns, length, ncolumn, still, truth, persistence + (ptrdiff_t)i * m->ncell,
                 NULL);
        for (int c = 0; c < m->ncell; ++c) {
            own[c] = e->rollout[i].reached < length || isnan(own[c]) ? INFINITY : own[c];
        }
    }
    double sum = 0;
    long moving = 0;
    for (size_t i = 0; i < n; ++i) {
        long own = 0;
        for (size_t k = i * (size_t)m->ncell; k < (i + 1) * (size_t)m->ncell; ++k) {
            if (persistence[k] > CONSTANT) {
                m->each[i] += log(fmin(fmax(error[k] / persistence[k], SMALLEST), LARGEST));
                ++own;
            }
        }
        sum += m->each[i];
        moving += own;
        m->each[i] /= own > 0 ? (double)own : 1;
    }
    m->score = exp(moving > 0 ? sum / (double)moving : 0);
    for (int c = 0; c < m->ncell; ++c) {
        for (int i = 0; i < e->count; ++i) {
            one[i] = error[(ptrdiff_t)i * m->ncell + c];
        }
        m->cell[c].rollout = pm_box_of(e->count, one);
        for (int i = 0; i < e->count; ++i) {
            one[i] = persistence[(ptrdiff_t)i * m->ncell + c];
        }
        m->cell[c].persistence = pm_box_of(e->count, one);
    }
    m->failures = pm_evaluation_failures(e);
    return PM_OK;
}

// Steps from at most MOST_STEPS true states. Boundary inputs are integrated from the beginning of
// trajectories only, so that a scene with some has no such errors.
static pm_status measure_steps(pm_measure *m, const pm_columns *columns) {
    const pm_evaluation *e = m->evaluation;
    const int nz = columns->nz, last = e->truth->ntime - 1;
    const long all = (long)e->count * last, stride = all / MOST_STEPS + 1;
    if (e->system->scene->physics.nboundary_input > 0) {
        return PM_OK;
    }
    // For each cell the squares of the errors and of the steps.
    double *square = pm_arena_array(&m->arena, 2 * (size_t)m->ncell, sizeof *square);
    double *z = pm_arena_array(&m->arena, (size_t)nz, sizeof *z);
    double *next = pm_arena_array(&m->arena, (size_t)nz, sizeof *next);
    PM_TRY(pm_arena_status(&m->arena, "scores"));
    pm_monolithic *assembly = NULL;
    PM_TRY(pm_monolithic_open(&assembly, e->system));
    bool finite = true;
    for (long k = 0; k < all && finite; k += stride) {
        const int i = e->rollout[k / last].trajectory, j = (int)(k % last);
        if (j + 1 >= e->rollout[k / last].length) {
            continue;
        }
        pm_columns_to_state(columns, pm_dataset_state(e->truth, i, j), z);
        pm_columns_to_state(columns, pm_dataset_state(e->truth, i, j + 1), next);
        pm_monolithic_set_state(assembly, z);
        for (int step = 0; step < e->stride && finite; ++step) {
            finite = pm_monolithic_step(assembly) == PM_OK;
        }
        const double *reached = pm_monolithic_sample(assembly)->z;
        for (int c = 0; c < nz && finite; ++c) {
            const double error = reached[c] - next[c], moved = next[c] - z[c];
            square[2 * columns->group[c]] += error * error;
            square[2 * columns->group[c] + 1] += moved * moved;
        }
    }
    for (int c = 0; c < m->ncell; ++c) {
        const double moved = square[2 * c + 1];
        m->cell[c].one_step = finite ? sqrt(square[2 * c] / (moved > 0 ? moved : 1)) : INFINITY;
    }
    pm_monolithic_close(assembly);
    return PM_OK;
}

pm_status pm_measure_make(pm_measure *measure, const pm_system *system, const pm_dataset *dataset,
                          int first, int end, bool thorough, const pm_evaluate_how *how) {
    *measure = (pm_measure){.ncell = 0};
    pm_columns columns;
    pm_status status;
    PM_TRY_DONE(pm_evaluate(&measure->evaluation, system, dataset, first, end, how));
    PM_TRY_DONE(measure_rollouts(measure, &columns));
    if (thorough) {
        PM_TRY_DONE(measure_steps(measure, &columns));
        PM_TRY_DONE(pm_thermo_make(&measure->thermo, measure->evaluation));
    }
done:
    if (status != PM_OK) {
        pm_measure_free(measure);
    }
    return status;
}

// Fills the rows of the black box, and takes its predictions into the evaluation.
static pm_status predict_black_box(pm_evaluation *e, int ntraining, double seconds, char *name) {
    const pm_dataset *data = e->truth;
    const pm_scene *scene = e->system->scene;
    const bool held = e->rollout[0].trajectory >= ntraining;
    const int nz = scene->physics.nz, count = held ? ntraining + e->count : ntraining;
    pm_arena arena = {0};
    int *input = pm_arena_array(&arena, 3 * (size_t)scene->physics.nprescribed + 1, sizeof *input);
    int *ntime = pm_arena_array(&arena, (size_t)count, sizeof *ntime);
    int *given = pm_arena_array(&arena, (size_t)count, sizeof *given);
    double **row = pm_arena_array(&arena, (size_t)count, sizeof *row);
    double **out = pm_arena_array(&arena, (size_t)count, sizeof *out);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&arena, "a black box"));
    // Lists the columns of the dataset that boundary inputs follow; -1 stands for the time.
    int ninput = 0;
    for (int i = 0; i < scene->physics.nboundary_input; ++i) {
        const pm_scene_boundary_input *b = &scene->physics.boundary_input[i];
        for (int k = 0; k < 3 * b->layout.nz; ++k) {
            int column = 0, known = 0;
            const char *source = b->value[k].column;
            while (source != NULL && column < data->ncolumn &&
                   strcmp(data->column[column], source) != 0) {
                ++column;
            }
            column = column < data->ncolumn ? column : -1;
            while (known < ninput && input[known] != column) {
                ++known;
            }
            if (source != NULL && known == ninput) {
                input[ninput++] = column;
            }
        }
    }
    const int width = nz + ninput;
    for (int i = 0; i < count; ++i) {
        const size_t rows = (size_t)data->ntime;
        row[i] = pm_arena_array(&arena, rows * (size_t)width, sizeof **row);
        out[i] = pm_arena_array(&arena, rows * (size_t)nz, sizeof **out);
        given[i] = 1;
    }
    PM_TRY_DONE(pm_arena_status(&arena, "a black box"));
    for (int i = 0; i < count; ++i) {
        const int from = i < ntraining ? i : e->rollout[i - ntraining].trajectory;
        ntime[i] = pm_dataset_length(data, from);
        for (int j = 0; j < ntime[i]; ++j) {
            const double *state = pm_dataset_state(data, from, j);
            double *own = row[i] + (ptrdiff_t)j * width;
            pm_columns_to_state(&e->columns, state, own);
            for (int k = 0; k < ninput; ++k) {
                own[nz + k] = input[k] < 0 ? j * data->dt : state[input[k]];
            }
        }
    }
    const pm_black_box_data box = {.nvalue = nz,
                                   .ninput = ninput,
                                   .count = count,
                                   .ntraining = ntraining,
                                   .ntime = ntime,
                                   .row = row,
                                   .given = given};
    pm_black_box chosen;
    PM_TRY_DONE(pm_black_box_predict(&box, seconds, out, &chosen));
    snprintf(name, sizeof chosen.name, "%s", chosen.name);
    for (int i = 0; i < e->count; ++i) {
        pm_rollout *r = &e->rollout[i];
        const double *z = out[held ? ntraining + i : r->trajectory];
        bool finite = true;
        for (int j = 0; j < data->ntime; ++j, z += nz) {
            double *to = pm_dataset_state(e->predicted, i, j);
            memcpy(to, pm_dataset_state(data, r->trajectory, j),
                   (size_t)data->ncolumn * sizeof *to);
            for (int c = 0; c < nz; ++c) {
                finite = finite && isfinite(z[c]);
            }
            if (finite && j < r->length) {
                pm_columns_to_row(&e->columns, z, to);
                ++r->reached;
            }
        }
    }
done:
    pm_arena_free(&arena);
    return status;
}

pm_status pm_measure_black_box(pm_measure *measure, const pm_system *system,
                               const pm_dataset *dataset, int ntraining, int first, int end,
                               double seconds, char *name) {
    *measure = (pm_measure){.ncell = 0};
    const int nz = system->scene->physics.nz;
    pm_columns columns;
    int *which = pm_arena_array(&measure->arena, (size_t)(end - first), sizeof *which);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&measure->arena, "a black box"));
    for (int i = first; i < end; ++i) {
        which[i - first] = i;
    }
    PM_TRY_DONE(pm_evaluation_new(&measure->evaluation, system, dataset, end - first, which));
    bool whole = nz <= MOST_BLACK;
    for (int c = 0; c < nz; ++c) {
        whole = whole && measure->evaluation->columns.column[c] >= 0;
    }
    status = whole ? predict_black_box(measure->evaluation, ntraining, seconds, name)
                   : pm_fail(PM_EDATA, "no black box");
    if (status == PM_EDATA) { // there is none to compare with
        pm_measure_free(measure);
        return PM_OK;
    }
    PM_TRY_DONE(status);
    PM_TRY_DONE(measure_rollouts(measure, &columns));
done:
    if (status != PM_OK) {
        pm_measure_free(measure);
    }
    return status;
}

void pm_measure_free(pm_measure *measure) {
    if (measure != NULL) {
        pm_thermo_free(&measure->thermo);
        pm_evaluation_free(measure->evaluation);
        pm_arena_free(&measure->arena);
        *measure = (pm_measure){.ncell = 0};
    }
}
