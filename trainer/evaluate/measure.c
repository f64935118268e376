// Scores each group of each subsystem separately, where the columns of a scene pool groups of the
// same name.
#include "evaluate/measure.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sim/monolithic.h"

#define MOST_STEPS 400 // the most single steps
#define SMALLEST 1e-9  // bounds of the ratio of an error to that of persistence in the mean
#define LARGEST 1e4    // also the ratio of a rollout that is not finite
#define CONSTANT 1e-12 // error of persistence below which a group counts as constant

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for scores");
}

// Makes one cell, and one group of `columns`, for each group of each subsystem.
static pm_status make_cells(pm_measure *m, pm_columns *columns) {
    const pm_scene *scene = m->evaluation->system->scene;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        m->ncell += scene->subsystem[i].layout.ngroup;
    }
    m->cell = pm_arena_array(&m->arena, (size_t)m->ncell, sizeof *m->cell);
    *columns = m->evaluation->columns;
    columns->group = pm_arena_array(&m->arena, (size_t)scene->nz, sizeof *columns->group);
    columns->ngroup = m->ncell;
    if (m->cell == NULL || columns->group == NULL) {
        return no_memory();
    }
    int cell = 0;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_scene_subsystem *s = &scene->subsystem[i];
        for (int g = 0; g < s->layout.ngroup; ++g, ++cell) {
            const pm_group *group = &s->layout.group[g];
            m->cell[cell] =
                (pm_measure_cell){.part = s->name, .group = group->name, .one_step = NAN};
            for (int c = 0; c < group->size; ++c) {
                columns->group[s->first + group->first + c] = cell;
            }
        }
    }
    return PM_OK;
}

// --- rollouts ---

// Writes error and persistence [count][ncell]. `still` [ntime][ncolumn] is work space.
static void score_rollouts(const pm_measure *m, const pm_columns *columns, double *error,
                           double *persistence, double *still) {
    const pm_evaluation *e = m->evaluation;
    const int ntime = e->truth->ntime, ncolumn = e->truth->ncolumn;
    for (int i = 0; i < e->count; ++i) {
        const double *truth = pm_dataset_state(e->truth, e->rollout[i].trajectory, 0);
        double *own = error + (ptrdiff_t)i * m->ncell;
        pm_score(columns, ntime, ncolumn, pm_dataset_state(e->predicted, i, 0), truth, own, NULL);
        for (int j = 0; j < ntime; ++j) {
            memcpy(still + (ptrdiff_t)j * ncolumn, truth, (size_t)ncolumn * sizeof *still);
        }
        pm_score(columns, ntime, ncolumn, still, truth, persistence + (ptrdiff_t)i * m->ncell,
                 NULL);
        for (int c = 0; c < m->ncell; ++c) {
            own[c] = e->rollout[i].reached < ntime || isnan(own[c]) ? INFINITY : own[c];
        }
    }
}

static double mean_logarithm(const pm_measure *m, const double *error, const double *persistence) {
    double sum = 0;
    long n = 0;
    for (long i = 0; i < (long)m->evaluation->count * m->ncell; ++i) {
        if (persistence[i] > CONSTANT) {
            sum += log(fmin(fmax(error[i] / persistence[i], SMALLEST), LARGEST));
            ++n;
        }
    }
    return n > 0 ? sum / (double)n : 0;
}

static pm_status measure_rollouts(pm_measure *m, const pm_columns *columns) {
    const pm_evaluation *e = m->evaluation;
    const size_t n = (size_t)e->count, size = n * (size_t)m->ncell;
    double *error = pm_arena_array(&m->arena, size, sizeof *error);
    double *persistence = pm_arena_array(&m->arena, size, sizeof *persistence);
    double *one = pm_arena_array(&m->arena, n, sizeof *one);
    double *still = pm_arena_array(&m->arena, (size_t)e->truth->ntime * (size_t)e->truth->ncolumn,
                                   sizeof *still);
    if (error == NULL || persistence == NULL || one == NULL || still == NULL) {
        return no_memory();
    }
    score_rollouts(m, columns, error, persistence, still);
    m->score = exp(mean_logarithm(m, error, persistence));
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

// --- single steps ---

// Adds the squared error and the squared length of one step from a true state, for each cell.
static pm_status add_step(const pm_measure *m, const pm_columns *columns, pm_monolithic *assembly,
                          const double *from, const double *to, double *work, double *square) {
    const pm_evaluation *e = m->evaluation;
    const int nz = columns->nz;
    double *z = work, *next = work + nz;
    pm_columns_to_state(columns, from, z);
    pm_columns_to_state(columns, to, next);
    pm_monolithic_set_state(assembly, z);
    for (int k = 0; k < e->stride; ++k) {
        PM_TRY(pm_monolithic_step(assembly));
    }
    const double *reached = pm_monolithic_sample(assembly)->z;
    for (int i = 0; i < nz; ++i) {
        const double error = reached[i] - next[i], moved = next[i] - z[i];
        square[2 * columns->group[i]] += error * error;
        square[2 * columns->group[i] + 1] += moved * moved;
    }
    return PM_OK;
}

static pm_status take_steps(pm_measure *m, const pm_columns *columns, pm_monolithic *assembly,
                            double *square, double *work) {
    const pm_evaluation *e = m->evaluation;
    const int last = e->truth->ntime - 1;
    const long all = (long)e->count * last, stride = all / MOST_STEPS + 1;
    bool finite = true;
    for (long k = 0; k < all && finite; k += stride) {
        const int i = e->rollout[k / last].trajectory, j = (int)(k % last);
        finite = add_step(m, columns, assembly, pm_dataset_state(e->truth, i, j),
                          pm_dataset_state(e->truth, i, j + 1), work, square) == PM_OK;
    }
    for (int c = 0; c < m->ncell; ++c) {
        const double moved = square[2 * c + 1];
        m->cell[c].one_step = finite ? sqrt(square[2 * c] / (moved > 0 ? moved : 1)) : INFINITY;
    }
    return PM_OK;
}

static pm_status measure_steps(pm_measure *m, const pm_columns *columns) {
    const pm_system *system = m->evaluation->system;
    double *square = pm_arena_array(&m->arena, 2 * (size_t)m->ncell, sizeof *square);
    double *work = pm_arena_array(&m->arena, 2 * (size_t)columns->nz, sizeof *work);
    if (square == NULL || work == NULL) {
        return no_memory();
    }
    if (system->scene->nboundary_input > 0) {
        return PM_OK; // boundary inputs are integrated from the beginning of trajectories only
    }
    pm_monolithic *assembly = NULL;
    PM_TRY(pm_monolithic_open(&assembly, system));
    const pm_status status = take_steps(m, columns, assembly, square, work);
    pm_monolithic_close(assembly);
    return status;
}

static pm_status measure_all(pm_measure *m, bool thorough) {
    pm_columns columns;
    PM_TRY(make_cells(m, &columns));
    PM_TRY(measure_rollouts(m, &columns));
    if (thorough) {
        PM_TRY(measure_steps(m, &columns));
        PM_TRY(pm_thermo_make(&m->thermo, m->evaluation));
    }
    return PM_OK;
}

pm_status pm_measure_make(pm_measure *measure, const pm_system *system, const pm_dataset *dataset,
                          int first, int end, bool thorough, const pm_evaluate_how *how) {
    *measure = (pm_measure){.ncell = 0};
    pm_status status = pm_evaluate(&measure->evaluation, system, dataset, first, end, how);
    if (status == PM_OK) {
        status = measure_all(measure, thorough);
    }
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
