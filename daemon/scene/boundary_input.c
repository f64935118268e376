// Columns become piecewise polynomials, by Newton's divided differences.
#include "scene/boundary_input.h"

#include <limits.h>
#include <math.h>
#include <string.h>

#include "base/digest.h"
#include "store/names.h"

// Finds the dataset column of each prescribed value, or one of the numbers in its place; a live
// value without a column counts as a constant. `any` tells whether a value follows a column or the
// time.
static pm_status find_columns(pm_boundary_input *boundary_input, const pm_dataset *dataset,
                              pm_arena *arena, bool *any) {
    const pm_physics *physics = &boundary_input->scene->physics;
    pm_names names;
    *any = false;
    if (dataset != NULL) {
        PM_TRY(pm_names_sort(&names, dataset->column, dataset->ncolumn, arena));
    }
    for (int i = 0; i < physics->nboundary_input; ++i) {
        const pm_scene_boundary_input *owner = &physics->boundary_input[i];
        for (int k = 0; k < 3 * owner->layout.nz; ++k) {
            const pm_scene_prescribed *value = &owner->value[k];
            const char *name = value->column;
            const int live_id = name == NULL ? -1 : pm_scene_find_live(boundary_input->scene, name);
            int column = PM_BOUNDARY_INPUT_CONSTANT;
            if (name != NULL && dataset != NULL) {
                column = pm_names_find(&names, name);
                if (column < 0 && live_id < 0 && strcmp(name, "time") == 0) {
                    column = PM_BOUNDARY_INPUT_TIME;
                }
            }
            if (name != NULL && live_id < 0 && dataset == NULL) {
                return pm_fail(PM_ECONFIG,
                               "%s: boundary input %s follows the column \"%s\", but there is no "
                               "`reference`",
                               value->at, owner->name, name);
            }
            if (name != NULL && live_id < 0 && column == PM_BOUNDARY_INPUT_CONSTANT) {
                return pm_fail(PM_EDATA,
                               "%s: boundary input %s: column \"%s\" is not in the dataset",
                               value->at, owner->name, name);
            }
            boundary_input->live_id[owner->first + k] = live_id;
            boundary_input->column[owner->first + k] = column;
            *any = *any || column != PM_BOUNDARY_INPUT_CONSTANT;
        }
    }
    return PM_OK;
}

// Writes the prescribed numbers to value [n].
static void take_numbers(const pm_boundary_input *boundary_input) {
    for (int i = 0; i < boundary_input->scene->physics.nboundary_input; ++i) {
        const pm_scene_boundary_input *owner = &boundary_input->scene->physics.boundary_input[i];
        for (int k = 0; k < 3 * owner->layout.nz; ++k) {
            boundary_input->value[owner->first + k] = owner->value[k].number;
        }
    }
}

pm_status pm_boundary_input_bind(pm_boundary_input *boundary_input, const pm_scene *scene,
                                 const pm_dataset *dataset, int stride, pm_arena *arena) {
    const size_t n = (size_t)scene->physics.nprescribed;
    *boundary_input = (pm_boundary_input){
        .n = scene->physics.nprescribed, .stride = 1, .end = LONG_MAX, .scene = scene};
    boundary_input->column = pm_arena_array(arena, n, sizeof *boundary_input->column);
    boundary_input->value = pm_arena_array(arena, n, sizeof *boundary_input->value);
    boundary_input->live_id = pm_arena_array(arena, n, sizeof *boundary_input->live_id);
    PM_TRY(pm_arena_status(arena, "boundary inputs"));
    bool follows;
    PM_TRY(find_columns(boundary_input, dataset, arena, &follows));
    size_t intervals = 1;
    if (follows) {
        if (dataset->ntime < 2) {
            return pm_fail(PM_EDATA, "%s: a boundary input cannot follow a trajectory of one state",
                           scene->path);
        }
        intervals = (size_t)dataset->ntime - 1;
        boundary_input->stride = stride;
        boundary_input->end = (long)intervals * stride;
    }
    boundary_input->coefficient = pm_arena_array(arena, intervals * PM_BOUNDARY_INPUT_ORDER * n,
                                                 sizeof *boundary_input->coefficient);
    PM_TRY(pm_arena_status(arena, "boundary inputs"));
    take_numbers(boundary_input);
    memcpy(boundary_input->coefficient, boundary_input->value, n * sizeof *boundary_input->value);
    return PM_OK;
}

// --- polynomials ---

// Computes, in powers of x, the polynomial through d[i] at x = i - origin for i < n, where
// n <= PM_BOUNDARY_INPUT_ORDER. Overwrites d with the divided differences.
static void interpolate(int n, int origin, double *d, double power[PM_BOUNDARY_INPUT_ORDER]) {
    for (int level = 1; level < n; ++level) {
        for (int i = n - 1; i >= level; --i) {
            d[i] = (d[i] - d[i - 1]) / level;
        }
    }
    // Evaluates Newton's form from the inside out: power = power * (x - x_i) + d_i.
    memset(power, 0, PM_BOUNDARY_INPUT_ORDER * sizeof *power);
    for (int i = n - 1; i >= 0; --i) {
        for (int k = PM_BOUNDARY_INPUT_ORDER - 1; k > 0; --k) {
            power[k] = power[k - 1] - (i - origin) * power[k];
        }
        power[0] = d[i] - (i - origin) * power[0];
    }
}

void pm_boundary_input_follow(pm_boundary_input *boundary_input, const pm_dataset *dataset,
                              int trajectory) {
    const int ntime = boundary_input->end == LONG_MAX ? 1 : dataset->ntime;
    const int n = ntime < PM_BOUNDARY_INPUT_ORDER ? ntime : PM_BOUNDARY_INPUT_ORDER;
    take_numbers(boundary_input);
    for (int j = 0; j < ntime - 1; ++j) {
        // Take the nearest states, as many before as after the interval where there are enough.
        int first = j + 1 - n / 2;
        first = first > ntime - n ? ntime - n : first;
        first = first < 0 ? 0 : first;
        double *to = boundary_input->coefficient +
                     (ptrdiff_t)j * PM_BOUNDARY_INPUT_ORDER * boundary_input->n;
        for (int i = 0; i < boundary_input->n; ++i) {
            double state[PM_BOUNDARY_INPUT_ORDER],
                power[PM_BOUNDARY_INPUT_ORDER] = {boundary_input->value[i]};
            const int column = boundary_input->column[i];
            if (column != PM_BOUNDARY_INPUT_CONSTANT) {
                for (int k = 0; k < n; ++k) {
                    state[k] = column == PM_BOUNDARY_INPUT_TIME
                                   ? dataset->t[first + k] - dataset->t[0]
                                   : pm_dataset_state(dataset, trajectory, first + k)[column];
                }
                interpolate(n, j - first, state, power);
            }
            for (int k = 0; k < PM_BOUNDARY_INPUT_ORDER; ++k) {
                to[(ptrdiff_t)k * boundary_input->n + i] = power[k];
            }
        }
    }
}

const double *pm_boundary_input_interval(const pm_boundary_input *boundary_input, long interval) {
    return boundary_input->coefficient + (boundary_input->end == LONG_MAX ? 0 : interval) *
                                             PM_BOUNDARY_INPUT_ORDER * (ptrdiff_t)boundary_input->n;
}

bool pm_boundary_input_covers(const pm_boundary_input *boundary_input, long step) {
    if (step < boundary_input->end) {
        return true;
    }
    for (int i = 0; i < boundary_input->n; ++i) {
        const bool held = boundary_input->held != NULL && !isnan(boundary_input->held[i]);
        const bool live = boundary_input->live != NULL && boundary_input->live_id[i] >= 0;
        if (boundary_input->column[i] != PM_BOUNDARY_INPUT_CONSTANT && !held && !live) {
            return false;
        }
    }
    return true;
}

void pm_boundary_input_at(const pm_boundary_input *boundary_input, long step, double fraction,
                          double *value) {
    const long last = boundary_input->end / boundary_input->stride - 1;
    const long interval =
        step / boundary_input->stride < last ? step / boundary_input->stride : last;
    const double x =
        ((double)(step - interval * boundary_input->stride) + fraction) / boundary_input->stride;
    const double *c = pm_boundary_input_interval(boundary_input, interval) +
                      (PM_BOUNDARY_INPUT_ORDER - 1) * (ptrdiff_t)boundary_input->n;
    memcpy(value, c, (size_t)boundary_input->n * sizeof *value);
    for (int k = PM_BOUNDARY_INPUT_ORDER - 2; k >= 0; --k) {
        c -= boundary_input->n;
        for (int i = 0; i < boundary_input->n; ++i) {
            value[i] = value[i] * x + c[i];
        }
    }
    for (int i = 0; i < boundary_input->n && boundary_input->live != NULL; ++i) {
        const int live_id = boundary_input->live_id[i];
        value[i] = live_id >= 0 ? boundary_input->live[live_id] : value[i];
    }
    for (int i = 0; i < boundary_input->n && boundary_input->held != NULL; ++i) {
        value[i] = isnan(boundary_input->held[i]) ? value[i] : boundary_input->held[i];
    }
}

uint64_t pm_boundary_input_digest(const pm_boundary_input *boundary_input, uint64_t digest) {
    const size_t intervals = boundary_input->end == LONG_MAX
                                 ? 1
                                 : (size_t)(boundary_input->end / boundary_input->stride);
    return boundary_input->n == 0
               ? digest
               : pm_digest_doubles(digest, boundary_input->coefficient,
                                   intervals * PM_BOUNDARY_INPUT_ORDER * (size_t)boundary_input->n);
}
