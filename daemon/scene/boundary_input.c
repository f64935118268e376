// Columns become piecewise polynomials, by Newton's divided differences.
#include "scene/boundary_input.h"

#include <limits.h>
#include <math.h>
#include <string.h>

#include "base/digest.h"
#include "store/names.h"

#define EQUAL 1e-6          // of dt, by which two times that count as equal may differ
#define TIME_TOLERANCE 1e-3 // of the distance of two samples, as in a dataset
#define FEWER 4             // samples of a polynomial where times are uneven or samples are missing

// Whether the times of a trajectory are dt of the dataset apart.
static bool is_even(const pm_dataset *d, int trajectory) {
    const double first = pm_dataset_time(d, trajectory, 0);
    const int length = pm_dataset_length(d, trajectory);
    int j = 0;
    while (j < length &&
           fabs(pm_dataset_time(d, trajectory, j) - first - j * d->dt) <= TIME_TOLERANCE * d->dt) {
        ++j;
    }
    return j == length;
}

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
            boundary_input->hold[owner->first + k] = value->hold;
            boundary_input->delay[owner->first + k] = value->delay;
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

// Checks that every column has a sample in every trajectory.
static pm_status check_samples(const pm_boundary_input *b, const pm_dataset *d) {
    for (int i = 0; i < b->n && d->measured; ++i) {
        for (int k = 0; k < d->ntrajectory && b->column[i] >= 0; ++k) {
            int j = 0;
            while (j < d->ntime && isnan(pm_dataset_state(d, k, j)[b->column[i]])) {
                ++j;
            }
            if (j == d->ntime) {
                return pm_fail(PM_EDATA,
                               "%s: boundary inputs follow the column \"%s\", which has no sample "
                               "in trajectory %d",
                               b->scene->path, d->column[b->column[i]], k);
            }
        }
    }
    return PM_OK;
}

// The number of whole steps of the scene in trajectory i.
static long steps_of(const pm_boundary_input *b, const pm_dataset *d, int i) {
    const int length = pm_dataset_length(d, i);
    const double seconds = pm_dataset_time(d, i, length - 1) - pm_dataset_time(d, i, 0);
    return (long)floor(seconds / b->scene->physics.dt * (1 + 1e-9) + EQUAL);
}

int pm_boundary_input_stride(const pm_scene *scene, const pm_dataset *dataset) {
    const double ratio = dataset->dt / scene->physics.dt, whole = round(ratio);
    bool even = whole >= 1 && whole < 1e6 && fabs(ratio - whole) <= 1e-9 * whole;
    for (int i = 0; i < dataset->ntrajectory && dataset->times != NULL && even; ++i) {
        even = is_even(dataset, i);
    }
    return even ? (int)whole : 0;
}

pm_status pm_boundary_input_bind(pm_boundary_input *boundary_input, const pm_scene *scene,
                                 const pm_dataset *dataset, int stride, pm_arena *arena) {
    const size_t n = (size_t)scene->physics.nprescribed;
    pm_boundary_input *b = boundary_input;
    *b = (pm_boundary_input){.n = scene->physics.nprescribed,
                             .stride = 1,
                             .end = LONG_MAX,
                             .scene = scene,
                             .even = true,
                             .unit = 1};
    b->column = pm_arena_array(arena, n, sizeof *b->column);
    b->hold = pm_arena_array(arena, n, sizeof *b->hold);
    b->delay = pm_arena_array(arena, n, sizeof *b->delay);
    b->value = pm_arena_array(arena, n, sizeof *b->value);
    b->live_id = pm_arena_array(arena, n, sizeof *b->live_id);
    b->samples = pm_arena_array(arena, n, sizeof *b->samples);
    PM_TRY(pm_arena_status(arena, "boundary inputs"));
    bool follows;
    PM_TRY(find_columns(b, dataset, arena, &follows));
    long intervals = 1;
    if (follows) {
        if (dataset->ntime < 2) {
            return pm_fail(PM_EDATA, "%s: a boundary input cannot follow a trajectory of one state",
                           scene->path);
        }
        PM_TRY(check_samples(b, dataset));
        intervals = dataset->ntime - 1;
        for (int i = 0; i < dataset->ntrajectory && stride == 0; ++i) {
            const long steps = steps_of(b, dataset, i);
            intervals = i == 0 || steps > intervals ? steps : intervals;
        }
        intervals = intervals < 1 ? 1 : intervals;
        b->by_step = stride == 0;
        b->stride = b->by_step ? 1 : stride;
        b->end = intervals * b->stride;
        for (size_t i = 0; i < n; ++i) {
            const bool constant = b->column[i] == PM_BOUNDARY_INPUT_CONSTANT;
            const size_t most = constant ? 0 : (size_t)dataset->ntime;
            b->samples[i].at = pm_arena_array(arena, most, sizeof *b->samples[i].at);
            b->samples[i].value = pm_arena_array(arena, most, sizeof *b->samples[i].value);
        }
    }
    b->coefficient = pm_arena_array(arena, (size_t)intervals * PM_BOUNDARY_INPUT_ORDER * n,
                                    sizeof *b->coefficient);
    PM_TRY(pm_arena_status(arena, "boundary inputs"));
    take_numbers(b);
    memcpy(b->coefficient, b->value, n * sizeof *b->value);
    return PM_OK;
}

// --- samples ---

// Returns the last sample at or before a position, or the first sample.
static int sample_before(const pm_boundary_input *b, const pm_boundary_samples *s, double at) {
    const double equal = EQUAL * b->scene->physics.dt / b->unit;
    int low = 0, high = s->count;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        *(s->at[middle] <= at + equal ? &low : &high) = middle;
    }
    return low;
}

double pm_boundary_input_position(const pm_boundary_input *b, double time) {
    const double at = (time - b->origin) / b->unit, whole = round(at);
    return b->even && fabs(at - whole) <= TIME_TOLERANCE ? whole : at;
}

double pm_boundary_input_jump(const pm_boundary_input *b, double from, double end) {
    const double equal = EQUAL * b->scene->physics.dt / b->unit;
    double first = end;
    for (int i = 0; i < b->n; ++i) {
        const pm_boundary_samples *s = &b->samples[i];
        if (b->column[i] < 0 || b->hold[i] != PM_HOLD_PREVIOUS) {
            continue;
        }
        for (int k = sample_before(b, s, from) + 1; k < s->count && s->at[k] < first - equal; ++k) {
            if (s->at[k] > from + equal && s->value[k] != s->value[k - 1]) {
                first = s->at[k];
            }
        }
    }
    return first;
}

// --- polynomials ---

// Writes, in powers of x, the polynomial through the nearest samples, as many before as after the
// interval where there are enough. Samples that are denser than the interval is long are thinned to
// its length.
static void smooth_over(const pm_boundary_samples *s, bool whole, int before, double from,
                        double end, double *power) {
    const int most = whole ? PM_BOUNDARY_INPUT_ORDER : FEWER, last = s->count - 1;
    const int next = before < last ? before + 1 : last;
    const double gap = next > 0 ? s->at[next] - s->at[next - 1] : 1;
    const int every = last == 0 ? 1 : (int)fmin(fmax(1, round((end - from) / gap)), last);
    const int n = last / every + 1 < most ? last / every + 1 : most;
    int first = before - (n / 2 - 1) * every;
    first = first > last - (n - 1) * every ? last - (n - 1) * every : first;
    first = first < 0 ? 0 : first;
    double x[PM_BOUNDARY_INPUT_ORDER], d[PM_BOUNDARY_INPUT_ORDER];
    for (int k = 0; k < n; ++k) {
        x[k] = (s->at[first + k * every] - from) / (end - from);
        d[k] = s->value[first + k * every];
    }
    // Divided differences, and Newton's form from the inside out: power = power * (x - x_i) + d_i.
    for (int level = 1; level < n; ++level) {
        for (int i = n - 1; i >= level; --i) {
            d[i] = (d[i] - d[i - 1]) / (x[i] - x[i - level]);
        }
    }
    for (int i = n - 1; i >= 0; --i) {
        for (int k = PM_BOUNDARY_INPUT_ORDER - 1; k > 0; --k) {
            power[k] = power[k - 1] - x[i] * power[k];
        }
        power[0] = d[i] - x[i] * power[0];
    }
}

// The value on the straight lines between samples; before the first and after the last it stays.
static double linear_at(const pm_boundary_samples *s, int before, double at) {
    if (before + 1 >= s->count || at <= s->at[before]) {
        return s->value[before];
    }
    const double part = (at - s->at[before]) / (s->at[before + 1] - s->at[before]);
    return s->value[before] + part * (s->value[before + 1] - s->value[before]);
}

// The mean of what is held between two positions. A sample that is `equal` to the end lies behind
// it.
static double mean_over(const pm_boundary_samples *s, int before, double from, double end,
                        double equal) {
    const double first = s->value[before];
    double sum = 0;
    for (int k = before; k < s->count && (k == before || s->at[k] < end - equal); ++k) {
        const double next = k + 1 < s->count ? fmin(s->at[k + 1], end) : end;
        sum += (s->value[k] - first) * (next - fmax(s->at[k], from));
    }
    return first + sum / (end - from);
}

// Writes the polynomial of one value between two positions. With `mean`, what is held is the mean
// between them.
static void value_over(const pm_boundary_input *b, int i, double from, double end, bool mean,
                       double power[PM_BOUNDARY_INPUT_ORDER]) {
    const pm_boundary_samples *s = &b->samples[i];
    const pm_hold hold = b->column[i] >= 0 ? b->hold[i] : PM_HOLD_SMOOTH;
    const int before = s->count > 0 ? sample_before(b, s, from) : 0;
    memset(power, 0, PM_BOUNDARY_INPUT_ORDER * sizeof *power);
    if (s->count == 0) {
        power[0] = b->value[i];
    } else if (hold == PM_HOLD_LINEAR) {
        power[0] = linear_at(s, before, from);
        power[1] = linear_at(s, sample_before(b, s, end), end) - power[0];
    } else if (hold == PM_HOLD_PREVIOUS) {
        const double equal = EQUAL * b->scene->physics.dt / b->unit;
        power[0] = mean ? mean_over(s, before, from, end, equal) : s->value[before];
    } else if (b->delay[i] != 0 && (from < s->at[0] || before == s->count - 1)) {
        power[0] = s->value[before];
    } else {
        smooth_over(s, b->even && s->count == b->length, before, from, end, power);
    }
}

// Writes the polynomials of all values.
static void write_over(const pm_boundary_input *b, double from, double end, bool mean,
                       double *coefficient) {
    for (int i = 0; i < b->n; ++i) {
        double power[PM_BOUNDARY_INPUT_ORDER];
        value_over(b, i, from, end, mean, power);
        for (int k = 0; k < PM_BOUNDARY_INPUT_ORDER; ++k) {
            coefficient[(ptrdiff_t)k * b->n + i] = power[k];
        }
    }
}

double pm_boundary_input_of(const pm_boundary_input *b, int i, double time) {
    double power[PM_BOUNDARY_INPUT_ORDER];
    const double at = pm_boundary_input_position(b, time);
    value_over(b, i, at, at + b->scene->physics.dt / b->unit, false, power);
    return power[0];
}

void pm_boundary_input_over(const pm_boundary_input *boundary_input, double from, double end,
                            double *coefficient) {
    write_over(boundary_input, from, end, false, coefficient);
}

void pm_boundary_input_follow(pm_boundary_input *boundary_input, const pm_dataset *dataset,
                              int trajectory) {
    pm_boundary_input *b = boundary_input;
    const ptrdiff_t width = (ptrdiff_t)PM_BOUNDARY_INPUT_ORDER * b->n;
    take_numbers(b);
    if (b->end == LONG_MAX) {
        memcpy(b->coefficient, b->value, (size_t)b->n * sizeof *b->value);
        return;
    }
    // Collects the samples of all columns along the trajectory, and finds what positions are.
    b->length = pm_dataset_length(dataset, trajectory);
    b->even = dataset->times == NULL || is_even(dataset, trajectory);
    b->unit = b->even ? dataset->dt : 1;
    b->origin = pm_dataset_time(dataset, trajectory, 0);
    for (int i = 0; i < b->n; ++i) {
        pm_boundary_samples *s = &b->samples[i];
        const double shift = b->delay[i] / b->unit, whole = round(shift);
        const double later = b->even && fabs(shift - whole) <= TIME_TOLERANCE ? whole : shift;
        s->count = 0;
        for (int j = 0; j < b->length && b->column[i] != PM_BOUNDARY_INPUT_CONSTANT; ++j) {
            const double time = pm_dataset_time(dataset, trajectory, j) - b->origin;
            const double value = b->column[i] == PM_BOUNDARY_INPUT_TIME
                                     ? time
                                     : pm_dataset_state(dataset, trajectory, j)[b->column[i]];
            if (!isnan(value)) {
                s->at[s->count] = (b->even ? j : time) + later;
                s->value[s->count++] = value;
            }
        }
    }
    const long intervals = b->by_step ? steps_of(b, dataset, trajectory) : b->length - 1;
    const double step = b->by_step ? b->scene->physics.dt / b->unit : 1;
    b->end = intervals * b->stride;
    for (long j = 0; j < intervals; ++j) {
        write_over(b, (double)j * step, (double)(j + 1) * step, true, b->coefficient + j * width);
    }
}

const double *pm_boundary_input_interval(const pm_boundary_input *boundary_input, long interval) {
    return boundary_input->coefficient + (boundary_input->end == LONG_MAX ? 0 : interval) *
                                             PM_BOUNDARY_INPUT_ORDER * (ptrdiff_t)boundary_input->n;
}

const pm_scene_boundary_input *pm_boundary_input_ending(const pm_boundary_input *boundary_input,
                                                        long step) {
    if (step < boundary_input->end || boundary_input->n == 0) {
        return NULL;
    }
    const pm_physics *physics = &boundary_input->scene->physics;
    for (int input_id = 0; input_id < physics->nboundary_input; ++input_id) {
        const pm_scene_boundary_input *owner = &physics->boundary_input[input_id];
        for (int k = 0; k < 3 * owner->layout.nz; ++k) {
            const int i = owner->first + k;
            const bool held = boundary_input->held != NULL && !isnan(boundary_input->held[i]);
            const bool live = boundary_input->live != NULL && boundary_input->live_id[i] >= 0;
            if (boundary_input->column[i] != PM_BOUNDARY_INPUT_CONSTANT && !held && !live) {
                return owner;
            }
        }
    }
    return NULL;
}

bool pm_boundary_input_covers(const pm_boundary_input *boundary_input, long step) {
    return pm_boundary_input_ending(boundary_input, step) == NULL;
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
