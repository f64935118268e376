// Memory of multiple shooting, the division of tracks into windows, their integration and normal
// equations, and the steps. Windows are dealt to the lanes in a fixed order, one thread each, so
// that the result does not depend on the processors.
#include "shooting/shooting.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "data/trained.h"
#include "optimise/levenberg_marquardt.h"

// Residuals beyond this many deviations of the noise count less: 95 % efficient with normal noise.
#define HUBER 1.345
// The least diagonal in relation to the largest, for unknowns on which nothing depends.
#define LEAST_DIAGONAL 1e-12
#define LEAST_MATRIX 1e-14
static const pm_damping damping_of_starts = {
    .first = 1e-2, .smallest = 1e-14, .largest = 1e10, .relax = 0.2, .stiffen = 5};
// Fewer windows than these are linearised along their paths, since the programs work on many states
// at a time.
#define FEW (PM_SENSITIVITY_BATCH / 2)
// The factor of the damping after a step to where derivatives are not finite.
#define SHORTER 1e4
// The curvature of a step is measured at this part of it. A step is bent unless its curvature is
// larger than this in relation to it (Transtrum, Sethna, arXiv:1201.5885, 4.4).
#define PROBE 0.1
#define MOST_BENT 0.75

typedef struct pm_shooting_lane {
    pm_shooting *shooting;
    // Programs without derivatives, with derivatives with respect to starts and weights, and with
    // derivatives with respect to starts alone. NULL: no evaluation needed it yet.
    pm_sensitivity *value, *derivative, *start_alone;
    pm_sensitivity_work work[3]; // of these
    pm_sensitivity *sensitivity; // that of the present evaluation
    int id;
    bool derivatives;
    const double *start; // [nwindow][nz] of the present evaluation
    double objective;
    double *matrix; // [nborder][nborder]
    pm_sensitivity_item item[PM_SENSITIVITY_BATCH];
    double *y;          // [PM_SENSITIVITY_BATCH][ny]
    double *by_start;   // [PM_SENSITIVITY_BATCH][ny][nz]
    double *by_weights; // [PM_SENSITIVITY_BATCH][ny][nweight]
    double *rows;       // [PM_SENSITIVITY_BATCH][larger of ny and nz][nborder]
} pm_shooting_lane;

static int lane_count(void) {
    return pm_team_lanes(NULL).own;
}

static void close_lanes(pm_shooting *s) {
    for (int i = 0; s->lane != NULL && i < lane_count(); ++i) {
        pm_shooting_lane *l = &s->lane[i];
        pm_sensitivity_close(l->value);
        pm_sensitivity_close(l->derivative);
        pm_sensitivity_close(l->start_alone);
        l->value = l->derivative = l->start_alone = NULL;
    }
}

void pm_shooting_set_substeps(pm_shooting *s, int substeps) {
    close_lanes(s);
    s->how.substeps = substeps;
}

pm_status pm_shooting_open(pm_shooting *s, const pm_sensitivity_how *how, const pm_tracks *tracks) {
    *s = (pm_shooting){.how = *how,
                       .tracks = tracks,
                       .observation = how->observation,
                       .nz = how->system->scene->physics.nz,
                       .ny = how->observation->count,
                       .nweight = how->fixed ? 0 : pm_trained_count(how->system),
                       .terms = {.huber = HUBER}};
    s->nborder = s->nweight + 1;
    s->stride = 1;
    s->nrow = s->nz + s->nborder + 1;
    const size_t nz = (size_t)s->nz, ny = (size_t)s->ny, border = (size_t)s->nborder;
    const size_t batch = PM_SENSITIVITY_BATCH, lanes = (size_t)lane_count();
    pm_arena *arena = &s->arena;
    s->terms.noise = pm_arena_array(arena, ny, sizeof *s->terms.noise);
    s->terms.gap = pm_arena_array(arena, nz, sizeof *s->terms.gap);
    s->terms.prior = pm_arena_array(arena, nz, sizeof *s->terms.prior);
    s->terms.later = pm_arena_array(arena, nz, sizeof *s->terms.later);
    s->terms.first_weight = pm_arena_array(arena, border, sizeof *s->terms.first_weight);
    s->terms.reach = pm_arena_array(arena, border, sizeof *s->terms.reach);
    s->terms.early_reach = pm_arena_array(arena, border, sizeof *s->terms.early_reach);
    s->blocks.matrix = pm_arena_array(arena, border * border, sizeof *s->blocks.matrix);
    s->blocks.reduced = pm_arena_array(arena, border * border, sizeof *s->blocks.reduced);
    s->theta = pm_arena_array(arena, border, sizeof *s->theta);
    s->residual = pm_arena_array(arena, (size_t)tracks->count, sizeof *s->residual);
    s->state = pm_arena_array(arena, (size_t)tracks->count, sizeof *s->state);
    s->row = pm_arena_array(arena, (size_t)tracks->count, sizeof *s->row);
    s->path = pm_arena_array(arena, (size_t)tracks->count, sizeof *s->path);
    s->lane = pm_arena_array(arena, lanes, sizeof *s->lane);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(arena, "multiple shooting"));
    for (int i = 0; i < tracks->count; ++i) {
        const size_t samples = (size_t)tracks->track[i].count;
        s->residual[i] = pm_arena_array(arena, samples * ny, sizeof **s->residual);
        s->state[i] = pm_arena_array(arena, samples * nz, sizeof **s->state);
        s->row[i] = pm_arena_array(arena, samples * ny * (size_t)s->nrow, sizeof **s->row);
        s->path[i] = pm_arena_array(
            arena, (size_t)tracks->track[i].first_step[samples - 1] * nz + 1, sizeof **s->path);
    }
    for (size_t i = 0; i < lanes; ++i) {
        pm_shooting_lane *l = &s->lane[i];
        l->shooting = s;
        l->id = (int)i;
        l->matrix = pm_arena_array(arena, border * border, sizeof *l->matrix);
        l->y = pm_arena_array(arena, batch * ny, sizeof *l->y);
        l->by_start = pm_arena_array(arena, batch * ny * nz, sizeof *l->by_start);
        l->by_weights = pm_arena_array(arena, batch * ny * border, sizeof *l->by_weights);
        l->rows = pm_arena_array(arena, batch * (ny > nz ? ny : nz) * border, sizeof *l->rows);
        pm_sensitivity_allocate((int)batch, l->item, nz, (size_t)s->nweight, arena);
    }
    PM_TRY_DONE(pm_arena_status(arena, "multiple shooting"));
    for (size_t c = 0; c < ny; ++c) {
        s->terms.noise[c] = 1;
    }
    for (size_t c = 0; c < nz; ++c) {
        s->terms.gap[c] = 1;
    }
done:
    if (status != PM_OK) {
        pm_shooting_close(s);
    }
    return status;
}

void pm_shooting_clear(pm_shooting *s) {
    pm_arena_free(&s->divided);
    s->nwindow = 0;
    s->stride = 1;
}

void pm_shooting_close(pm_shooting *s) {
    close_lanes(s);
    pm_arena_free(&s->divided);
    pm_arena_free(&s->arena);
    *s = (pm_shooting){0};
}

// --- windows ---

// Lists the windows of tracks and returns how many there are. A window begins at a multiple of
// `length` after which at least half as many samples follow, so that longer windows begin where
// shorter ones did.
static int list_windows(const pm_shooting *s, int length, pm_window *window) {
    const pm_tracks *tracks = s->tracks;
    int count = 0;
    for (int i = 0; i < tracks->count; i += s->stride) {
        const int samples = tracks->track[i].count;
        for (int first = 0; first < samples; first += length) {
            if (first > 0 && 2 * (samples - first) < length) {
                break;
            }
            const int next = first + length;
            const bool ends = next >= samples || 2 * (samples - next) < length;
            if (window != NULL) {
                window[count] = (pm_window){i, first, ends ? samples : next, first > 0, ends};
            }
            ++count;
        }
    }
    return count;
}

pm_status pm_shooting_divide(pm_shooting *s, int length) {
    pm_arena old = s->divided;
    const pm_window *before = s->window;
    const double *z = s->z;
    const int nbefore = s->nwindow, count = list_windows(s, length, NULL);
    const size_t n = (size_t)count, nz = (size_t)s->nz, border = (size_t)s->nborder;
    s->divided = (pm_arena){0};
    pm_arena *arena = &s->divided;
    s->window = pm_arena_array(arena, n, sizeof *s->window);
    s->z = pm_arena_array(arena, n * nz, sizeof *s->z);
    s->end = pm_arena_array(arena, n * nz, sizeof *s->end);
    s->blocks.own = pm_arena_array(arena, n * nz * nz, sizeof *s->blocks.own);
    s->blocks.border = pm_arena_array(arena, n * nz * border, sizeof *s->blocks.border);
    s->blocks.end_by_start = pm_arena_array(arena, n * nz * nz, sizeof *s->blocks.end_by_start);
    s->blocks.end_by_weights =
        pm_arena_array(arena, n * nz * border, sizeof *s->blocks.end_by_weights);
    s->blocks.factor = pm_arena_array(arena, n * nz * nz, sizeof *s->blocks.factor);
    s->blocks.coupling = pm_arena_array(arena, n * nz * nz, sizeof *s->blocks.coupling);
    s->blocks.solved = pm_arena_array(arena, n * nz * border, sizeof *s->blocks.solved);
    const pm_status status = pm_arena_status(arena, "multiple shooting");
    s->nwindow = status == PM_OK ? list_windows(s, length, s->window) : 0;
    for (int w = 0, known = 0; w < s->nwindow; ++w) {
        const pm_window *own = &s->window[w];
        double *start = s->z + (size_t)w * nz;
        while (known < nbefore &&
               (before[known].track < own->track ||
                (before[known].track == own->track && before[known].first < own->first))) {
            ++known;
        }
        if (known < nbefore && before[known].track == own->track &&
            before[known].first == own->first) {
            memcpy(start, z + (size_t)known * nz, nz * sizeof *z);
        } else {
            pm_track_sample_states(s->tracks, own->track, s->how.system->scene, s->observation,
                                   own->first, own->first + 1, start);
        }
    }
    pm_arena_free(&old);
    return status;
}

// --- residuals ---

// Huber's function of a residual in units of its noise, and the root of its weight.
static double huber(double r, double limit, double *root) {
    const double size = fabs(r);
    *root = size <= limit ? 1 : sqrt(limit / size);
    return size <= limit ? 0.5 * r * r : limit * (size - 0.5 * limit);
}

// Adds one weighted row of the Jacobian with its residual to the equations of a window.
static void add_to_window(const pm_shooting *s, int window, const double *by_start,
                          const double *row) {
    const ptrdiff_t nz = s->nz, border = s->nborder;
    double *own = s->blocks.own + window * nz * nz, *edge = s->blocks.border + window * nz * border;
    for (ptrdiff_t i = 0; i < nz; ++i) {
        const double factor = by_start[i];
        if (factor == 0) {
            continue;
        }
        for (ptrdiff_t k = 0; k < nz; ++k) {
            own[i * nz + k] += factor * by_start[k];
        }
        for (ptrdiff_t k = 0; k < border; ++k) {
            edge[i * border + k] += factor * row[k];
        }
    }
}

// Compares the columns y in state z with a sample of a window. With derivatives, `row` of l->rows
// is the next one; returns the one after those that the sample has filled.
static int add_sample(pm_shooting_lane *l, int window, int sample, const double *z, const double *y,
                      double *by_start, const double *by_weights, int row) {
    const pm_shooting *s = l->shooting;
    const ptrdiff_t ny = s->ny, nz = s->nz, nweight = s->nweight, border = s->nborder;
    const pm_window *w = &s->window[window];
    const double *data = s->tracks->track[w->track].y + sample * ny;
    double *residual = s->residual[w->track] + sample * ny;
    memcpy(s->state[w->track] + sample * nz, z, (size_t)nz * sizeof *z);
    for (ptrdiff_t c = 0; c < ny; ++c) {
        residual[c] = y[c] - data[c];
        if (isnan(data[c])) {
            continue;
        }
        double root = 1;
        const double r = residual[c] / s->terms.noise[c];
        l->objective += huber(r, s->terms.huber, &root);
        if (!l->derivatives) {
            continue;
        }
        double *own = l->rows + row++ * border;
        const double factor = root / s->terms.noise[c];
        for (ptrdiff_t j = 0; j < nweight; ++j) {
            own[j] = s->terms.hold ? 0 : factor * by_weights[c * nweight + j];
        }
        own[nweight] = root * r;
        double *kept = s->row[w->track] + (sample * ny + c) * s->nrow;
        memcpy(kept + nz, own, (size_t)border * sizeof *own);
        kept[nz + border] = factor;
        for (ptrdiff_t j = 0; j < nweight && s->blocks.window_gradient != NULL; ++j) {
            s->blocks.window_gradient[window * nweight + j] += own[j] * own[nweight];
        }
        for (ptrdiff_t j = 0; j < nz; ++j) {
            by_start[c * nz + j] *= factor;
            kept[j] = by_start[c * nz + j];
        }
        add_to_window(s, window, by_start + c * nz, own);
    }
    return row;
}

// Adds the first rows of l->rows to the matrix of the weights.
static void add_rows(pm_shooting_lane *l, int count) {
    if (count > 0 && !l->shooting->terms.hold) {
        pm_gram_add(count, l->shooting->nborder, l->rows, l->matrix);
    }
}

// Compares what is measured in some windows with sample `k` of each window.
static void add_samples(pm_shooting_lane *l, int count, const int *window,
                        pm_sensitivity_item **item, int k) {
    const pm_shooting *s = l->shooting;
    const ptrdiff_t ny = s->ny;
    pm_sensitivity_measure(l->sensitivity, count, item, l->y, l->by_start, l->by_weights);
    int nrow = 0;
    for (int i = 0; i < count; ++i) {
        nrow = add_sample(l, window[i], s->window[window[i]].first + k, item[i]->z, l->y + i * ny,
                          l->by_start + i * ny * s->nz, l->by_weights + i * ny * s->nweight, nrow);
    }
    add_rows(l, nrow);
}

// Compares the end of a window with the start of the next.
static void add_gap(pm_shooting_lane *l, int window, const pm_sensitivity_item *item) {
    const pm_shooting *s = l->shooting;
    const ptrdiff_t nz = s->nz, nweight = s->nweight, border = s->nborder;
    memcpy(s->end + window * nz, item->z, (size_t)nz * sizeof *item->z);
    if (s->window[window].ends) {
        return;
    }
    double *by_start = s->blocks.end_by_start + window * nz * nz;
    double *rows = s->blocks.end_by_weights + window * nz * border;
    for (ptrdiff_t c = 0; c < nz; ++c) {
        const double r = (item->z[c] - l->start[(window + 1) * nz + c]) / s->terms.gap[c];
        l->objective += 0.5 * r * r;
        if (!l->derivatives) {
            continue;
        }
        for (ptrdiff_t j = 0; j < nz; ++j) {
            by_start[c * nz + j] = item->by_start[c * nz + j] / s->terms.gap[c];
        }
        for (ptrdiff_t j = 0; j < nweight; ++j) {
            rows[c * border + j] =
                s->terms.hold ? 0 : item->by_weights[c * nweight + j] / s->terms.gap[c];
        }
        rows[c * border + nweight] = r;
        add_to_window(s, window, by_start + c * nz, rows + c * border);
    }
    if (l->derivatives && !s->terms.hold) {
        pm_gram_add(s->nz, s->nborder, rows, l->matrix);
    }
}

// --- evaluation ---

static int sample_count(const pm_window *w) {
    return w->last - w->first;
}

// Returns the boundary inputs at a sample of a track.
static const double *now_at(const pm_shooting *s, const pm_track *t, int sample) {
    return t->now == NULL ? NULL
                          : t->now + (ptrdiff_t)sample * s->how.system->scene->physics.nprescribed;
}

// Integrates windows side by side, with their derivatives if there are any.
static void run_beside(pm_shooting_lane *l, int first, int count) {
    const pm_shooting *s = l->shooting;
    const pm_track *track[PM_SENSITIVITY_BATCH];
    int longest = 0;
    for (int i = 0; i < count; ++i) {
        const pm_window *w = &s->window[first + i];
        pm_sensitivity_start(l->sensitivity, &l->item[i]);
        track[i] = &s->tracks->track[w->track];
        longest = sample_count(w) > longest ? sample_count(w) : longest;
    }
    for (int k = 0; k < longest; ++k) {
        pm_sensitivity_item *looking[PM_SENSITIVITY_BATCH];
        int which[PM_SENSITIVITY_BATCH], sample[PM_SENSITIVITY_BATCH], n = 0;
        for (int i = 0; i < count; ++i) {
            const pm_window *w = &s->window[first + i];
            const int intervals = sample_count(w) - (w->ends ? 1 : 0);
            sample[i] = k < intervals ? w->first + k : -1;
            if (k < sample_count(w)) {
                l->item[i].now = now_at(s, track[i], w->first + k);
                looking[n] = &l->item[i];
                which[n++] = first + i;
            }
        }
        add_samples(l, n, which, looking, k);
        pm_sensitivity_advance(l->sensitivity, count, l->item, track, sample);
    }
}

// The windows that a lane integrates along their paths.
typedef struct followed_windows {
    pm_shooting_lane *lane;
    int first; // window
} followed_windows;

static void visit(void *context, int id, int sample, const double *z, const double *y,
                  double *by_start, const double *by_weights) {
    const followed_windows *f = context;
    add_rows(f->lane, add_sample(f->lane, f->first + id, sample, z, y, by_start, by_weights, 0));
}

static void run_batch(pm_shooting_lane *l, int first, int count) {
    const pm_shooting *s = l->shooting;
    for (int i = 0; i < count; ++i) {
        memcpy(l->item[i].z, l->start + (ptrdiff_t)(first + i) * s->nz,
               (size_t)s->nz * sizeof(double));
        // Adds the prior of the first start of a track, or of all starts with their own deviations.
        const ptrdiff_t nz = s->nz, window = first + i;
        const pm_window *w = &s->window[window];
        const double *prior = w->follows ? s->terms.later : s->terms.prior;
        for (ptrdiff_t c = 0; c < nz && (s->terms.everywhere || !w->follows); ++c) {
            if (!(prior[c] > 0)) {
                continue;
            }
            const double r = (l->start[window * nz + c] - s->observation->guess[c]) / prior[c];
            l->objective += 0.5 * r * r;
            if (l->derivatives) {
                s->blocks.own[window * nz * nz + c * (nz + 1)] += 1 / (prior[c] * prior[c]);
                s->blocks.border[(window * nz + c) * s->nborder + s->nweight] += r / prior[c];
            }
        }
    }
    if (l->derivatives && count < FEW) {
        const pm_track *track[FEW] = {NULL};
        int begin[FEW] = {0}, end[FEW] = {0};
        double *path[FEW] = {NULL};
        for (int i = 0; i < count; ++i) {
            const pm_window *w = &s->window[first + i];
            track[i] = &s->tracks->track[w->track];
            path[i] = s->path[w->track];
            begin[i] = w->first;
            end[i] = w->ends ? w->last - 1 : w->last;
        }
        pm_sensitivity_along(l->sensitivity, l->value, count, l->item, track, begin, end, path,
                             visit, &(followed_windows){l, first});
        for (int i = 0; i < count; ++i) { // the last samples of trajectories
            pm_sensitivity_item *item = &l->item[i];
            const int window = first + i;
            item->now = now_at(s, track[i], end[i]);
            if (s->window[window].ends) {
                add_samples(l, 1, &window, &item, end[i] - begin[i]);
            }
        }
    } else {
        run_beside(l, first, count);
    }
    for (int i = 0; i < count; ++i) {
        add_gap(l, first + i, &l->item[i]);
    }
}

// Batches of equal size, so that all lanes have about the same number of windows.
static int batch_size(const pm_shooting *s) {
    const int most = lane_count() * PM_SENSITIVITY_BATCH;
    const int runs = lane_count() * ((s->nwindow + most - 1) / most);
    return (s->nwindow + runs - 1) / runs;
}

static void *work(void *context) {
    pm_shooting_lane *l = context;
    const pm_shooting *s = l->shooting;
    const int batch = batch_size(s);
    l->objective = 0;
    memset(l->matrix, 0, (size_t)s->nborder * (size_t)s->nborder * sizeof *l->matrix);
    for (int first = l->id * batch; first < s->nwindow; first += lane_count() * batch) {
        run_batch(l, first, s->nwindow - first < batch ? s->nwindow - first : batch);
    }
    return NULL;
}

// Adds the work of an evaluation: of the steps, of the samples with their part of the normal
// equations, and of the elimination of the starts.
static void count_work(pm_shooting *s, bool derivatives, const pm_sensitivity_work *each) {
    const double border = s->terms.hold ? 1 : s->nborder, nz = s->nz;
    const double half = PM_SENSITIVITY_DENSE / 2; // the matrices are symmetric
    const double equations = derivatives ? half * (nz + border) * (nz + border) : 0;
    for (int w = 0; w < s->nwindow; ++w) {
        const pm_window *window = &s->window[w];
        const int *first = s->tracks->track[window->track].first_step;
        const int end = window->ends ? window->last - 1 : window->last;
        s->work += each->step * (first[end] - first[window->first]) +
                   (each->sample + equations * s->ny) * (window->last - window->first) +
                   equations * nz * (nz + 1);
    }
    s->work += derivatives ? PM_SENSITIVITY_DENSE * border * border * border / 3 : 0;
}

double pm_shooting_evaluate(pm_shooting *s, const double *z, bool derivatives) {
    const size_t windows = (size_t)s->nwindow, nz = (size_t)s->nz, border = (size_t)s->nborder;
    if (derivatives) {
        memset(s->blocks.own, 0, windows * nz * nz * sizeof *s->blocks.own);
        memset(s->blocks.border, 0, windows * nz * border * sizeof *s->blocks.border);
    }
    int kind = 0;
    for (int i = 0; i < lane_count(); ++i) {
        pm_shooting_lane *l = &s->lane[i];
        pm_sensitivity_how how = s->how;
        how.fixed = how.fixed || (derivatives && s->terms.hold);
        kind = !derivatives ? 0 : how.fixed ? 2 : 1;
        pm_sensitivity **const all[] = {&l->value, &l->derivative, &l->start_alone};
        pm_sensitivity **const own = all[kind];
        // Compiling the programs can take longer than all their steps: only those that are needed.
        const bool works = i * batch_size(s) < s->nwindow;
        s->failed = works && *own == NULL
                        ? pm_sensitivity_open(own, &how, derivatives, &l->work[kind])
                        : PM_OK;
        if (s->failed == PM_OK && works && derivatives && l->value == NULL) {
            s->failed = pm_sensitivity_open(&l->value, &how, false, &l->work[0]);
        }
        if (s->failed != PM_OK) {
            return NAN;
        }
        l->derivatives = derivatives;
        l->start = z;
        l->sensitivity = *own;
    }
    count_work(s, derivatives, &s->lane[0].work[kind]);
    pm_team_run(NULL, work, s->lane, sizeof *s->lane);
    double objective = s->lane[0].objective;
    if (derivatives) {
        memcpy(s->blocks.matrix, s->lane[0].matrix, border * border * sizeof *s->blocks.matrix);
    }
    for (int i = 1; i < lane_count(); ++i) {
        objective += s->lane[i].objective;
        for (size_t k = 0; derivatives && k < border * border; ++k) {
            s->blocks.matrix[k] += s->lane[i].matrix[k];
        }
    }
    pm_shooting_weights(s, s->theta);
    // The prior of the weights.
    const double *reach = s->terms.early ? s->terms.early_reach : s->terms.reach;
    double sum = 0;
    for (int i = 0; i < s->nweight; ++i) {
        if (reach[i] > 0) {
            const double r = (s->theta[i] - s->terms.first_weight[i]) / reach[i];
            sum += 0.5 * r * r;
            if (derivatives) {
                double *row = s->blocks.matrix + (ptrdiff_t)i * s->nborder;
                row[i] += 1 / (reach[i] * reach[i]);
                row[s->nweight] += r / reach[i];
            }
        }
    }
    return objective + sum;
}

// --- solution ---
//
// Starts x_w of neighbouring windows are coupled
// by their gap, and all with the weights theta:
//
//     [ H_1  C_1            B_1 ]      H_w  starts of window w, with its own gap and that before
//     [ C_1' H_2  C_2       B_2 ]      C_w  = -(d end_w / d x_w)' / gap^2
//     [      C_2' ...       ... ]      B_w  starts with weights
//     [ B_1' B_2' ...        T  ]      T    weights
//
// The starts are eliminated from the first window on, by a block Cholesky factorisation whose last
// block is the Schur complement on the weights. Cost and memory grow linearly with the windows.

// Solves u' x = b for `count` right-hand sides, b [n][count].
static void forward(int n, const double *u, int count, double *b) {
    for (ptrdiff_t i = 0; i < n; ++i) {
        for (ptrdiff_t l = 0; l < i; ++l) {
            const double factor = u[l * n + i];
            for (ptrdiff_t k = 0; k < count; ++k) {
                b[i * count + k] -= factor * b[l * count + k];
            }
        }
        const double scale = 1 / u[i * n + i];
        for (ptrdiff_t k = 0; k < count; ++k) {
            b[i * count + k] *= scale;
        }
    }
}

// Factorises the block of one window and solves for its couplings.
static bool eliminate(pm_shooting *s, int window, double damping) {
    const ptrdiff_t nz = s->nz, nb = s->nborder;
    double *u = s->blocks.factor + window * nz * nz, *c = s->blocks.coupling + window * nz * nz;
    double *b = s->blocks.solved + window * nz * nb;
    memcpy(u, s->blocks.own + window * nz * nz, (size_t)(nz * nz) * sizeof *u);
    memcpy(b, s->blocks.border + window * nz * nb, (size_t)(nz * nb) * sizeof *b);
    const bool follows = s->window[window].follows;
    if (follows) {
        // The start enters the gap before its window with -1/gap.
        const double *rows = s->blocks.end_by_weights + (window - 1) * nz * nb;
        for (ptrdiff_t i = 0; i < nz; ++i) {
            u[i * (nz + 1)] += 1 / (s->terms.gap[i] * s->terms.gap[i]);
            for (ptrdiff_t k = 0; k < nb; ++k) {
                b[i * nb + k] -= rows[i * nb + k] / s->terms.gap[i];
            }
        }
    }
    double largest = 0;
    for (ptrdiff_t i = 0; i < s->nz; ++i) {
        largest = fmax(largest, u[i * (s->nz + 1)]);
    }
    for (ptrdiff_t i = 0; i < s->nz; ++i) {
        u[i * (s->nz + 1)] += damping * u[i * (s->nz + 1)] + LEAST_DIAGONAL * largest;
    }
    if (follows) {
        // Subtracts what elimination of the window before leaves: its solved blocks X_C'[X_C X_B].
        const double *coupling = s->blocks.coupling + (window - 1) * nz * nz;
        const double *solved = s->blocks.solved + (window - 1) * nz * nb;
        for (ptrdiff_t l = 0; l < nz; ++l) {
            for (ptrdiff_t i = 0; i < nz; ++i) {
                const double factor = coupling[l * nz + i];
                for (ptrdiff_t k = 0; k < nz; ++k) {
                    u[i * nz + k] -= factor * coupling[l * nz + k];
                }
                for (ptrdiff_t k = 0; k < nb; ++k) {
                    b[i * nb + k] -= factor * solved[l * nb + k];
                }
            }
        }
    }
    if (!pm_cholesky_factor(s->nz, u)) {
        return false;
    }
    if (!s->window[window].ends) {
        const double *by_start = s->blocks.end_by_start + window * nz * nz;
        for (ptrdiff_t i = 0; i < nz; ++i) {
            for (ptrdiff_t k = 0; k < nz; ++k) {
                c[i * nz + k] = -by_start[k * nz + i] / s->terms.gap[k];
            }
        }
        forward(s->nz, u, s->nz, c);
    }
    forward(s->nz, u, s->nborder, b);
    return true;
}

// The damping of a weight is the geometric mean of its own diagonal, as Marquardt has it, and of
// the largest one. With its own alone, weights on which little depends run away, and a fit ends in
// a valley far from its minimum (Transtrum, Sethna, arXiv:1201.5885).
static double damped(const pm_shooting *s, ptrdiff_t weight, double largest) {
    return sqrt(s->blocks.matrix[weight * (s->nborder + 1)] * largest);
}

static double largest_diagonal(const pm_shooting *s) {
    double largest = 0;
    for (ptrdiff_t i = 0; i < s->nweight; ++i) {
        largest = fmax(largest, s->blocks.matrix[i * (s->nborder + 1)]);
    }
    return largest;
}

// Forms the Schur complement on the weights and solves for them.
static bool solve_weights(pm_shooting *s, double damping, double *weights) {
    const ptrdiff_t nb = s->nborder, n = s->nweight;
    memset(s->blocks.reduced, 0, (size_t)(nb * nb) * sizeof *s->blocks.reduced);
    pm_gram_add(s->nwindow * s->nz, s->nborder, s->blocks.solved, s->blocks.reduced);
    const double largest = largest_diagonal(s);
    double *h = s->blocks.reduced;
    for (ptrdiff_t i = 0; i < n; ++i) {
        for (ptrdiff_t k = i; k < nb; ++k) {
            h[i * nb + k] = s->blocks.matrix[i * nb + k] - h[i * nb + k];
        }
        h[i * (nb + 1)] += damping * damped(s, i, largest) + LEAST_MATRIX * largest;
        weights[i] = -h[i * nb + n];
    }
    // Closes the gap of the last column, so that the rest is a contiguous matrix of the weights.
    for (ptrdiff_t i = 1; i < n; ++i) {
        memmove(h + i * n, h + i * nb, (size_t)n * sizeof *h);
    }
    return n == 0 || pm_cholesky_solve((int)n, h, weights);
}

bool pm_shooting_solve(pm_shooting *s, double damping, double *weights, double *z) {
    for (int w = 0; w < s->nwindow; ++w) {
        if (!eliminate(s, w, damping)) {
            return false;
        }
    }
    if (s->terms.hold) {
        memset(weights, 0, (size_t)s->nweight * sizeof *weights);
    } else if (!solve_weights(s, damping, weights)) {
        return false;
    }
    for (int w = s->nwindow - 1; w >= 0; --w) {
        // Computes the steps of the starts of one track from its last window back.
        const ptrdiff_t nz = s->nz, nb = s->nborder;
        const double *u = s->blocks.factor + w * nz * nz, *c = s->blocks.coupling + w * nz * nz;
        const double *b = s->blocks.solved + w * nz * nb;
        for (ptrdiff_t i = 0; i < nz; ++i) {
            double sum = -b[i * nb + s->nweight];
            for (ptrdiff_t k = 0; k < s->nweight; ++k) {
                sum -= b[i * nb + k] * weights[k];
            }
            for (ptrdiff_t k = 0; k < nz && !s->window[w].ends; ++k) {
                sum -= c[i * nz + k] * z[(w + 1) * nz + k];
            }
            z[w * nz + i] = sum;
        }
        for (ptrdiff_t i = nz - 1; i >= 0; --i) {
            double sum = z[w * nz + i];
            for (ptrdiff_t k = i + 1; k < nz; ++k) {
                sum -= u[i * nz + k] * z[w * nz + k];
            }
            z[w * nz + i] = sum / u[i * (nz + 1)];
        }
    }
    return true;
}

// --- steps ---

void pm_shooting_weights(const pm_shooting *s, double *theta) {
    if (s->nweight > 0) {
        pm_trained_gather(s->how.system, theta);
    }
}

void pm_shooting_set_weights(const pm_shooting *s, const double *theta) {
    if (s->nweight > 0) {
        pm_trained_scatter(s->how.system, theta);
    }
}

typedef struct window_descent {
    pm_shooting *s;
    const pm_shooting_limits *limits;
    pm_shooting_progress *progress;
    size_t size;                 // of all weights and starts: nweight + nwindow nz
    double *kept, *step, *trial; // [size]
    double *before;              // [size] the point before `kept`
    double *second;              // [size] the second derivative of the unknowns along the step
    // J' r'' along the step: of the weights, of the starts, r'' of the gaps after windows
    double *curve; // [size + nwindow nz]
    bool returns;  // `before` is known
    double *damping;
    bool stuck;
} window_descent;

static bool is_over(void *context) {
    const window_descent *d = context;
    const bool late = d->limits->work > 0 && d->s->work > d->limits->work;
    if (*d->s->label != '\0') {
        pm_progress_update(&d->s->progress, d->progress->iterations, NULL);
    }
    return d->stuck || late || d->progress->iterations >= d->limits->iterations ||
           d->progress->idle >= 2;
}

// Makes `point` [size] the weights and starts.
static void move_to(window_descent *d, const double *point) {
    const size_t nweight = (size_t)d->s->nweight;
    if (point != d->kept) {
        memcpy(d->kept, point, d->size * sizeof *d->kept);
    }
    pm_shooting_set_weights(d->s, d->kept);
    memcpy(d->s->z, d->kept + nweight, (d->size - nweight) * sizeof *d->s->z);
}

static pm_status linearise(void *context, double *objective) {
    window_descent *d = context;
    const pm_shooting_limits *limits = d->limits;
    PM_TRY(limits->keep == NULL ? PM_OK : limits->keep(limits->context, d->progress));
    *objective = pm_shooting_evaluate(d->s, d->s->z, true);
    if (!isfinite(*objective) && d->returns) {
        // The last step led where the objective is finite, but its derivatives are not: it is
        // taken back, and a shorter one follows.
        PM_TRY(d->s->failed);
        move_to(d, d->before);
        d->returns = false;
        *d->damping =
            fmin(fmax(*d->damping, damping_of_starts.first) * SHORTER, damping_of_starts.largest);
        *objective = pm_shooting_evaluate(d->s, d->s->z, true);
    }
    if (!isfinite(*objective)) {
        PM_TRY(d->s->failed);
        return pm_fail(PM_ENUMERIC, "multiple shooting: the objective is %g", *objective);
    }
    d->progress->before = d->progress->iterations == 0 ? *objective : d->progress->before;
    return PM_OK;
}

// The second derivative of a residual along a step, from its change until PROBE of the step and
// from its derivatives.
static double second_derivative(const window_descent *d, int window, double change,
                                const double *by_start, const double *by_weights) {
    const ptrdiff_t nz = d->s->nz, nweight = d->s->nweight;
    const double *start = d->step + nweight + window * nz;
    double slope = 0;
    for (ptrdiff_t i = 0; i < nz; ++i) {
        slope += by_start[i] * start[i];
    }
    for (ptrdiff_t i = 0; i < nweight; ++i) {
        slope += by_weights[i] * d->step[i];
    }
    return 2 / PROBE * (change / PROBE - slope);
}

// Adds the product of r'' with the derivatives of its residual to J' r''.
static void add_curve(const window_descent *d, int window, double r, const double *by_start,
                      const double *by_weights) {
    const ptrdiff_t nz = d->s->nz, nweight = d->s->nweight;
    for (ptrdiff_t i = 0; i < nz; ++i) {
        d->curve[nweight + window * nz + i] += r * by_start[i];
    }
    for (ptrdiff_t i = 0; i < nweight; ++i) {
        d->curve[i] += r * by_weights[i];
    }
}

// Sums J' r'' along the step, from the residuals at PROBE of it.
static void sum_curve(const window_descent *d) {
    const pm_shooting *s = d->s;
    const ptrdiff_t nz = s->nz, ny = s->ny, n = s->nweight, nb = s->nborder;
    memset(d->curve, 0, d->size * sizeof *d->curve);
    for (int w = 0; w < s->nwindow; ++w) {
        const pm_window *window = &s->window[w];
        const double *y = s->tracks->track[window->track].y;
        for (ptrdiff_t i = window->first * ny; i < window->last * ny; ++i) {
            const double *row = s->row[window->track] + i * s->nrow;
            if (!isnan(y[i])) {
                const double change = row[nz + nb] * s->residual[window->track][i] - row[nz + n];
                add_curve(d, w, second_derivative(d, w, change, row, row + nz), row, row + nz);
            }
        }
        for (ptrdiff_t c = w * nz; c < (w + 1) * nz && !window->ends; ++c) {
            const double *by_start = s->blocks.end_by_start + c * nz;
            const double *by_weights = s->blocks.end_by_weights + c * nb;
            // The start of the next window changes linearly, and so it has no part in r''.
            const double gap = (s->end[c] - d->kept[n + nz + c]) / s->terms.gap[c - w * nz];
            const double r = second_derivative(d, w, gap - by_weights[n], by_start, by_weights);
            add_curve(d, w, r, by_start, by_weights);
            d->curve[d->size + (size_t)c] = r;
        }
    }
}

// Exchanges the right-hand side of the normal equations with `curve`.
static void exchange_sides(const window_descent *d) {
    const pm_shooting_blocks *b = &d->s->blocks;
    const ptrdiff_t n = d->s->nweight, nb = d->s->nborder, size = (ptrdiff_t)d->size;
    for (ptrdiff_t i = 0; i < 2 * size - n; ++i) {
        double *side = i < n      ? b->matrix + i * nb
                       : i < size ? b->border + (i - n) * nb
                                  : b->end_by_weights + (i - size) * nb;
        const double kept = side[n];
        side[n] = d->curve[i];
        d->curve[i] = kept;
    }
}

// Computes the step, and bends it by the second derivative of the residuals along it (geodesic
// acceleration): a valley of the objective that is curved and narrow takes far fewer steps.
static bool solve(void *context, double damping) {
    window_descent *d = context;
    pm_shooting *s = d->s;
    const ptrdiff_t n = s->nweight;
    if (!pm_shooting_solve(s, damping, d->step, d->step + n)) {
        return false;
    }
    for (size_t i = 0; i < d->size; ++i) {
        d->trial[i] = d->kept[i] + PROBE * d->step[i];
    }
    pm_shooting_set_weights(s, d->trial);
    if (!isfinite(pm_shooting_evaluate(s, d->trial + n, false))) {
        return false;
    }
    sum_curve(d);
    exchange_sides(d);
    const bool solved = pm_shooting_solve(s, damping, d->second, d->second + n);
    exchange_sides(d);
    const double largest = largest_diagonal(s);
    double first = 0, second = 0;
    for (ptrdiff_t i = 0; i < n; ++i) {
        first += d->step[i] * d->step[i] * damped(s, i, largest);
        second += d->second[i] * d->second[i] * damped(s, i, largest);
    }
    const bool bent = solved && second <= MOST_BENT * MOST_BENT * first;
    for (size_t i = 0; bent && i < d->size; ++i) {
        d->step[i] += 0.5 * d->second[i];
    }
    return true;
}

static pm_status try_step(void *context, double before, double *after, double *fraction) {
    const window_descent *d = context;
    for (size_t i = 0; i < d->size; ++i) {
        d->trial[i] = d->kept[i] + d->step[i];
    }
    pm_shooting_set_weights(d->s, d->trial);
    *after = pm_shooting_evaluate(d->s, d->trial + d->s->nweight, false);
    *fraction = *after < before;
    return PM_OK;
}

static pm_status finish(void *context, double before, double after, bool moved) {
    window_descent *d = context;
    if (moved) {
        memcpy(d->before, d->kept, d->size * sizeof *d->kept);
        d->returns = true;
    }
    move_to(d, moved ? d->trial : d->kept);
    ++d->progress->iterations;
    d->progress->after = after;
    if (d->limits->stop != NULL && *d->limits->stop) {
        return pm_fail(PM_EINTERRUPTED, "interrupted");
    }
    const bool idle = after > before * (1 - d->limits->enough);
    d->progress->idle = !moved ? d->progress->idle : idle ? d->progress->idle + 1 : 0;
    d->stuck = !moved;
    return PM_OK;
}

pm_status pm_shooting_minimise(pm_shooting *s, const pm_shooting_limits *limits, double *damping,
                               pm_shooting_progress *progress) {
    const size_t starts = (size_t)s->nwindow * (size_t)s->nz, n = (size_t)s->nweight + starts;
    pm_arena arena = {0};
    window_descent d = {.s = s,
                        .limits = limits,
                        .progress = progress,
                        .size = n,
                        .kept = pm_arena_array(&arena, n, sizeof *d.kept),
                        .step = pm_arena_array(&arena, n, sizeof *d.step),
                        .trial = pm_arena_array(&arena, n, sizeof *d.trial),
                        .before = pm_arena_array(&arena, n, sizeof *d.before),
                        .second = pm_arena_array(&arena, n, sizeof *d.second),
                        .curve = pm_arena_array(&arena, n + starts, sizeof *d.curve),
                        .damping = damping};
    pm_status status = pm_arena_status(&arena, "multiple shooting");
    // Many short calls together redraw the bar no more often than a long one.
    const double drawn = s->progress.drawn;
    pm_progress_init(&s->progress, s->label, limits->iterations);
    s->progress.drawn = drawn;
    if (status == PM_OK) {
        pm_shooting_weights(s, d.kept);
        memcpy(d.kept + s->nweight, s->z, starts * sizeof *s->z);
        status = pm_levenberg_marquardt(
            &(pm_levenberg_marquardt_problem){is_over, linearise, solve, try_step, finish, &d},
            &damping_of_starts, damping);
    }
    if (status == PM_OK) {
        pm_shooting_evaluate(s, s->z,
                             false); // residuals and ends of windows are those of the result
        status = s->failed;
    }
    pm_progress_erase(&s->progress);
    pm_arena_free(&arena);
    return status;
}
