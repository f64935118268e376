// Integrates windows in two lanes, one thread each, and sums up the normal equations. Windows are
// dealt to the lanes in a fixed order, so that the result does not depend on the processors.
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "learn/shooting.h"

struct pm_shooting_lane {
    pm_shooting *shooting;
    pm_flow *flow;
    int id;
    bool derivatives;
    const double *start; // [nwindow][nz] of the present evaluation
    double objective;
    double *matrix; // [nborder][nborder]
    pm_flow_item item[PM_FLOW_BATCH];
    double *y;          // [PM_FLOW_BATCH][ny]
    double *by_start;   // [PM_FLOW_BATCH][ny][nz]
    double *by_weights; // [PM_FLOW_BATCH][ny][nweight]
    double *rows;       // [PM_FLOW_BATCH][larger of ny and nz][nborder]
};

// --- memory ---

static pm_status open_lane(pm_shooting *s, int id) {
    const size_t nz = (size_t)s->nz, ny = (size_t)s->ny, nweight = (size_t)s->nweight;
    const size_t border = (size_t)s->nborder, batch = PM_FLOW_BATCH;
    pm_shooting_lane *l = pm_arena_array(&s->arena, 1, sizeof *l);
    s->lane[id] = l;
    if (l == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for multiple shooting");
    }
    l->shooting = s;
    l->id = id;
    l->matrix = pm_arena_array(&s->arena, border * border, sizeof *l->matrix);
    l->y = pm_arena_array(&s->arena, batch * ny, sizeof *l->y);
    l->by_start = pm_arena_array(&s->arena, batch * ny * nz, sizeof *l->by_start);
    l->by_weights = pm_arena_array(&s->arena, batch * ny * nweight + 1, sizeof *l->by_weights);
    l->rows = pm_arena_array(&s->arena, batch * (ny > nz ? ny : nz) * border, sizeof *l->rows);
    bool complete = l->matrix != NULL && l->y != NULL && l->by_start != NULL &&
                    l->by_weights != NULL && l->rows != NULL;
    for (size_t i = 0; i < batch; ++i) {
        pm_flow_item *item = &l->item[i];
        item->z = pm_arena_array(&s->arena, nz, sizeof *item->z);
        item->by_start = pm_arena_array(&s->arena, nz * nz, sizeof *item->by_start);
        item->by_weights = pm_arena_array(&s->arena, nz * nweight + 1, sizeof *item->by_weights);
        complete =
            complete && item->z != NULL && item->by_start != NULL && item->by_weights != NULL;
    }
    return complete ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for multiple shooting");
}

pm_status pm_shooting_open_lanes(pm_shooting *s) {
    for (int i = 0; i < PM_SHOOTING_LANES; ++i) {
        PM_TRY(open_lane(s, i));
    }
    return PM_OK;
}

void pm_shooting_set_substeps(pm_shooting *s, int substeps) {
    pm_shooting_close_lanes(s);
    s->how.substeps = substeps;
}

// Gives a lane the flow that an evaluation needs, and opens it if none needed it before: compiling
// a flow can take longer than all its steps.
static pm_status choose_flow(pm_shooting *s, pm_shooting_lane *l) {
    pm_flow_how how = s->how;
    how.fixed = how.fixed || (l->derivatives && s->hold);
    pm_flow **flow = !l->derivatives ? &s->value[l->id]
                     : how.fixed     ? &s->start[l->id]
                                     : &s->derivative[l->id];
    PM_TRY(*flow != NULL ? PM_OK : pm_flow_open(flow, &how, l->derivatives));
    l->flow = *flow;
    return PM_OK;
}

void pm_shooting_close_lanes(pm_shooting *s) {
    for (int i = 0; i < PM_SHOOTING_LANES; ++i) {
        pm_flow_close(s->value[i]);
        pm_flow_close(s->derivative[i]);
        pm_flow_close(s->start[i]);
        s->value[i] = s->derivative[i] = s->start[i] = NULL;
    }
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
    double *own = s->own + window * nz * nz, *edge = s->border + window * nz * border;
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

// Compares what is measured in some windows with sample `k` of each window.
static void add_samples(pm_shooting_lane *l, int count, const int *window, pm_flow_item **item,
                        int k) {
    const pm_shooting *s = l->shooting;
    const ptrdiff_t ny = s->ny, nz = s->nz, nweight = s->nweight, border = s->nborder;
    pm_flow_look(l->flow, count, item, l->y, l->by_start, l->by_weights);
    int nrow = 0;
    for (int i = 0; i < count; ++i) {
        const pm_window *w = &s->window[window[i]];
        const ptrdiff_t sample = w->first + k;
        const double *data = s->tracks->track[w->track].y + sample * ny;
        double *residual = s->residual[w->track] + sample * ny;
        for (ptrdiff_t c = 0; c < ny; ++c) {
            residual[c] = l->y[i * ny + c] - data[c];
            if (isnan(data[c])) {
                continue;
            }
            double root = 1;
            const double r = residual[c] / s->noise[c];
            l->objective += huber(r, s->huber, &root);
            if (!l->derivatives) {
                continue;
            }
            double *row = l->rows + nrow++ * border, *by_start = l->by_start + (i * ny + c) * nz;
            const double factor = root / s->noise[c];
            for (ptrdiff_t j = 0; j < nweight; ++j) {
                row[j] = s->hold ? 0 : factor * l->by_weights[(i * ny + c) * nweight + j];
            }
            row[nweight] = root * r;
            for (ptrdiff_t j = 0; j < nweight && s->window_gradient != NULL; ++j) {
                s->window_gradient[window[i] * nweight + j] += row[j] * row[nweight];
            }
            for (ptrdiff_t j = 0; j < nz; ++j) {
                by_start[j] *= factor;
            }
            add_to_window(s, window[i], by_start, row);
        }
    }
    if (nrow > 0 && !s->hold) {
        pm_gram_add(nrow, s->nborder, l->rows, l->matrix);
    }
}

// Compares the end of a window with the start of the next.
static void add_gap(pm_shooting_lane *l, int window, const pm_flow_item *item) {
    const pm_shooting *s = l->shooting;
    const ptrdiff_t nz = s->nz, nweight = s->nweight, border = s->nborder;
    memcpy(s->end + window * nz, item->z, (size_t)nz * sizeof *item->z);
    if (s->window[window].ends) {
        return;
    }
    double *by_start = s->end_by_start + window * nz * nz;
    double *rows = s->end_by_weights + window * nz * border;
    for (ptrdiff_t c = 0; c < nz; ++c) {
        const double r = (item->z[c] - l->start[(window + 1) * nz + c]) / s->gap[c];
        l->objective += 0.5 * r * r;
        if (!l->derivatives) {
            continue;
        }
        for (ptrdiff_t j = 0; j < nz; ++j) {
            by_start[c * nz + j] = item->by_start[c * nz + j] / s->gap[c];
        }
        for (ptrdiff_t j = 0; j < nweight; ++j) {
            rows[c * border + j] = s->hold ? 0 : item->by_weights[c * nweight + j] / s->gap[c];
        }
        rows[c * border + nweight] = r;
        add_to_window(s, window, by_start + c * nz, rows + c * border);
    }
    if (l->derivatives && !s->hold) {
        pm_gram_add(s->nz, s->nborder, rows, l->matrix);
    }
}

// Adds the prior of the first start of a track, or of all starts with their own deviations.
static void add_prior(pm_shooting_lane *l, int window) {
    const pm_shooting *s = l->shooting;
    const ptrdiff_t nz = s->nz;
    if (s->window[window].follows && !s->everywhere) {
        return;
    }
    const double *prior = s->window[window].follows ? s->later : s->prior;
    for (ptrdiff_t c = 0; c < nz; ++c) {
        if (!(prior[c] > 0)) {
            continue;
        }
        const double r = (l->start[window * nz + c] - s->observation->guess[c]) / prior[c];
        l->objective += 0.5 * r * r;
        if (l->derivatives) {
            s->own[window * nz * nz + c * (nz + 1)] += 1 / (prior[c] * prior[c]);
            s->border[(window * nz + c) * s->nborder + s->nweight] += r / prior[c];
        }
    }
}

// --- windows ---

static int sample_count(const pm_window *w) {
    return w->last - w->first;
}

// The number of sample intervals over which a window integrates.
static int interval_count(const pm_window *w) {
    return w->last - w->first - (w->ends ? 1 : 0);
}

// Takes windows from their sample k to the next one.
static void advance(pm_shooting_lane *l, int count, const int *window, int k) {
    const pm_shooting *s = l->shooting;
    const ptrdiff_t width = pm_flow_inputs(l->flow);
    pm_flow_item *moving[PM_FLOW_BATCH];
    for (int step = 0;; ++step) {
        int n = 0;
        for (int i = 0; i < count; ++i) {
            const pm_window *w = &s->window[window[i]];
            const pm_track *r = &s->tracks->track[w->track];
            if (k < interval_count(w) && step < r->steps[w->first + k]) {
                l->item[i].duration = r->duration[w->first + k];
                l->item[i].input = r->input == NULL ? NULL : r->input + (w->first + k) * width;
                moving[n++] = &l->item[i];
            }
        }
        if (n == 0) {
            return;
        }
        pm_flow_step(l->flow, n, moving);
    }
}

static void run_batch(pm_shooting_lane *l, int first, int count) {
    const pm_shooting *s = l->shooting;
    int window[PM_FLOW_BATCH], longest = 0;
    for (int i = 0; i < count; ++i) {
        window[i] = first + i;
        memcpy(l->item[i].z, l->start + (ptrdiff_t)(first + i) * s->nz,
               (size_t)s->nz * sizeof(double));
        pm_flow_start(l->flow, &l->item[i]);
        add_prior(l, first + i);
        const int samples = sample_count(&s->window[first + i]);
        longest = samples > longest ? samples : longest;
    }
    for (int k = 0; k < longest; ++k) {
        pm_flow_item *looking[PM_FLOW_BATCH];
        int which[PM_FLOW_BATCH], n = 0;
        for (int i = 0; i < count; ++i) {
            if (k < sample_count(&s->window[first + i])) {
                looking[n] = &l->item[i];
                which[n++] = window[i];
            }
        }
        add_samples(l, n, which, looking, k);
        advance(l, count, window, k);
    }
    for (int i = 0; i < count; ++i) {
        add_gap(l, first + i, &l->item[i]);
    }
}

// Batches of equal size, so that both lanes have about the same number of windows.
static int batch_size(const pm_shooting *s) {
    const int runs = PM_SHOOTING_LANES * ((s->nwindow + PM_SHOOTING_LANES * PM_FLOW_BATCH - 1) /
                                          (PM_SHOOTING_LANES * PM_FLOW_BATCH));
    return (s->nwindow + runs - 1) / runs;
}

static void *work(void *context) {
    pm_shooting_lane *l = context;
    const pm_shooting *s = l->shooting;
    const int batch = batch_size(s);
    l->objective = 0;
    memset(l->matrix, 0, (size_t)s->nborder * (size_t)s->nborder * sizeof *l->matrix);
    for (int first = l->id * batch; first < s->nwindow; first += PM_SHOOTING_LANES * batch) {
        run_batch(l, first, s->nwindow - first < batch ? s->nwindow - first : batch);
    }
    return NULL;
}

// Prepares all lanes that have windows for an evaluation.
static pm_status prepare(pm_shooting *s, const double *z, bool derivatives) {
    for (int i = 0; i < PM_SHOOTING_LANES; ++i) {
        pm_shooting_lane *l = s->lane[i];
        l->derivatives = derivatives;
        l->start = z;
        PM_TRY(i * batch_size(s) < s->nwindow ? choose_flow(s, l) : PM_OK);
    }
    return PM_OK;
}

// Adds the prior of the weights to the matrix, and returns its part of the objective.
static double add_weight_prior(pm_shooting *s, bool derivatives) {
    double sum = 0;
    size_t at = 0;
    for (int i = 0; i < pm_system_components(s->how.system) && s->nweight > 0; ++i) {
        const pm_params *params = pm_system_params(s->how.system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            for (int j = 0; entry->trained && j < entry->rows * entry->cols; ++j, ++at) {
                const double reach = s->early ? s->early_reach[at] : s->reach[at];
                if (!(reach > 0)) {
                    continue;
                }
                const double r = (entry->value[j] - s->first_weight[at]) / reach;
                sum += 0.5 * r * r;
                if (derivatives) {
                    double *row = s->matrix + at * (size_t)s->nborder;
                    row[at] += 1 / (reach * reach);
                    row[s->nweight] += r / reach;
                }
            }
        }
    }
    return sum;
}

double pm_shooting_evaluate(pm_shooting *s, const double *z, bool derivatives) {
    const size_t windows = (size_t)s->nwindow, nz = (size_t)s->nz, border = (size_t)s->nborder;
    if (derivatives) {
        memset(s->own, 0, windows * nz * nz * sizeof *s->own);
        memset(s->border, 0, windows * nz * border * sizeof *s->border);
    }
    s->failed = prepare(s, z, derivatives);
    if (s->failed != PM_OK) {
        return NAN;
    }
    pthread_t thread[PM_SHOOTING_LANES];
    bool started[PM_SHOOTING_LANES] = {false};
    for (int i = 0; i < PM_SHOOTING_LANES; ++i) {
        if (i > 0) {
            started[i] = pthread_create(&thread[i], NULL, work, s->lane[i]) == 0;
        }
    }
    work(s->lane[0]);
    double objective = s->lane[0]->objective;
    if (derivatives) {
        memcpy(s->matrix, s->lane[0]->matrix, border * border * sizeof *s->matrix);
    }
    for (int i = 1; i < PM_SHOOTING_LANES; ++i) {
        if (started[i]) {
            pthread_join(thread[i], NULL);
        } else {
            work(s->lane[i]); // no thread could be started: compute the same sums here
        }
        objective += s->lane[i]->objective;
        for (size_t k = 0; derivatives && k < border * border; ++k) {
            s->matrix[k] += s->lane[i]->matrix[k];
        }
    }
    return objective + add_weight_prior(s, derivatives);
}
