// Columns as piecewise polynomials, by Newton's divided differences.
#include "store/load.h"

#include <limits.h>
#include <string.h>

#include "base/digest.h"
#include "store/names.h"

// `names`: of the dataset; NULL: there is none.
static pm_status find_column(const pm_scene_world *owner, const pm_scene_prescribed *value,
                             const pm_names *names, int *column) {
    if (value->column == NULL) {
        *column = -1;
        return PM_OK;
    }
    if (names == NULL) {
        return pm_fail(PM_ECONFIG,
                       "%s: load %s follows the column \"%s\", but there is no `reference`",
                       value->at, owner->name, value->column);
    }
    *column = pm_names_find(names, value->column);
    return *column >= 0 ? PM_OK
                        : pm_fail(PM_EDATA, "%s: load %s: column \"%s\" is not in the dataset",
                                  value->at, owner->name, value->column);
}

static pm_status find_columns(pm_load *load, const pm_dataset *dataset, pm_arena *arena) {
    pm_names names;
    if (dataset != NULL) {
        PM_TRY(pm_names_sort(&names, dataset->column, dataset->ncolumn, arena));
    }
    for (int i = 0; i < load->scene->nload; ++i) {
        const pm_scene_world *owner = &load->scene->load[i];
        for (int k = 0; k < 3 * owner->layout.nz; ++k) {
            PM_TRY(find_column(owner, &owner->value[k], dataset == NULL ? NULL : &names,
                               &load->column[owner->first + k]));
        }
    }
    return PM_OK;
}

static bool has_columns(const pm_load *load) {
    for (int i = 0; i < load->n; ++i) {
        if (load->column[i] >= 0) {
            return true;
        }
    }
    return false;
}

// Fills value [n] with the numbers.
static void take_numbers(const pm_load *load) {
    for (int i = 0; i < load->scene->nload; ++i) {
        const pm_scene_world *owner = &load->scene->load[i];
        for (int k = 0; k < 3 * owner->layout.nz; ++k) {
            load->value[owner->first + k] = owner->value[k].number;
        }
    }
}

pm_status pm_load_bind(pm_load *load, const pm_scene *scene, const pm_dataset *dataset, int stride,
                       pm_arena *arena) {
    const size_t n = (size_t)scene->nprescribed;
    *load = (pm_load){.n = scene->nprescribed, .stride = 1, .end = LONG_MAX, .scene = scene};
    load->column = pm_arena_array(arena, n, sizeof *load->column);
    load->value = pm_arena_array(arena, n, sizeof *load->value);
    if (load->column == NULL || load->value == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for loads");
    }
    PM_TRY(find_columns(load, dataset, arena));
    size_t intervals = 1;
    if (has_columns(load)) {
        if (dataset->ntime < 2) {
            return pm_fail(PM_EDATA, "%s: a load cannot follow a trajectory of one state",
                           scene->path);
        }
        intervals = (size_t)dataset->ntime - 1;
        load->stride = stride;
        load->end = (long)intervals * stride;
    }
    load->coefficient =
        pm_arena_array(arena, intervals * PM_LOAD_ORDER * n, sizeof *load->coefficient);
    if (load->coefficient == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for loads");
    }
    take_numbers(load);
    memcpy(load->coefficient, load->value, n * sizeof *load->value);
    return PM_OK;
}

// --- polynomials ---

// The polynomial through d[i] at x = i - origin, i < n <= PM_LOAD_ORDER, in powers of x. Overwrites
// d with the divided differences.
static void interpolate(int n, int origin, double *d, double power[PM_LOAD_ORDER]) {
    for (int level = 1; level < n; ++level) {
        for (int i = n - 1; i >= level; --i) {
            d[i] = (d[i] - d[i - 1]) / level;
        }
    }
    // Newton's form, from the inside out: power = power * (x - x_i) + d_i.
    memset(power, 0, PM_LOAD_ORDER * sizeof *power);
    for (int i = n - 1; i >= 0; --i) {
        for (int k = PM_LOAD_ORDER - 1; k > 0; --k) {
            power[k] = power[k - 1] - (i - origin) * power[k];
        }
        power[0] = d[i] - (i - origin) * power[0];
    }
}

void pm_load_follow(pm_load *load, const pm_dataset *dataset, int trajectory) {
    const int ntime = load->end == LONG_MAX ? 1 : dataset->ntime;
    const int n = ntime < PM_LOAD_ORDER ? ntime : PM_LOAD_ORDER;
    take_numbers(load);
    for (int j = 0; j < ntime - 1; ++j) {
        // The states before and after the interval, as many on either side as there are.
        int first = j + 1 - n / 2;
        first = first > ntime - n ? ntime - n : first;
        first = first < 0 ? 0 : first;
        double *to = load->coefficient + (ptrdiff_t)j * PM_LOAD_ORDER * load->n;
        for (int i = 0; i < load->n; ++i) {
            double state[PM_LOAD_ORDER], power[PM_LOAD_ORDER] = {load->value[i]};
            if (load->column[i] >= 0) {
                for (int k = 0; k < n; ++k) {
                    state[k] = pm_dataset_state(dataset, trajectory, first + k)[load->column[i]];
                }
                interpolate(n, j - first, state, power);
            }
            for (int k = 0; k < PM_LOAD_ORDER; ++k) {
                to[(ptrdiff_t)k * load->n + i] = power[k];
            }
        }
    }
}

const double *pm_load_interval(const pm_load *load, long interval) {
    return load->coefficient +
           (load->end == LONG_MAX ? 0 : interval) * PM_LOAD_ORDER * (ptrdiff_t)load->n;
}

void pm_load_at(const pm_load *load, long step, double fraction, double *value) {
    const long last = load->end / load->stride - 1;
    const long interval = step / load->stride < last ? step / load->stride : last;
    const double x = ((double)(step - interval * load->stride) + fraction) / load->stride;
    const double *c = pm_load_interval(load, interval) + (PM_LOAD_ORDER - 1) * (ptrdiff_t)load->n;
    memcpy(value, c, (size_t)load->n * sizeof *value);
    for (int k = PM_LOAD_ORDER - 2; k >= 0; --k) {
        c -= load->n;
        for (int i = 0; i < load->n; ++i) {
            value[i] = value[i] * x + c[i];
        }
    }
}

uint64_t pm_load_digest(const pm_load *load, uint64_t digest) {
    const size_t intervals = load->end == LONG_MAX ? 1 : (size_t)(load->end / load->stride);
    return load->n == 0 ? digest
                        : pm_digest_doubles(digest, load->coefficient,
                                            intervals * PM_LOAD_ORDER * (size_t)load->n);
}
