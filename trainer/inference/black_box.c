// Candidates differ in the number of past rows that they read and in their features. Free runs on
// the series that did not train decide, as they do about the weights of a model.
#include "inference/black_box.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "base/arena.h"
#include "base/linalg.h"
#include "base/rng.h"

#define MOST_DEGREE 7
#define MOST_FEATURES 500
#define MOST_LAGS 8
#define MOST_CANDIDATES 48
#define UNITS 240           // random hidden units of the larger candidate
#define SLOPE 1.5           // deviation of their weights, times the root of the number of inputs
#define ROWS_PER_FEATURE 40 // of training, at most
#define LEAST_PER_FEATURE 2 // rows, at least
#define CHUNK 256           // rows of features at a time
#define SPEED 1.5e9         // multiply-adds in a second
#define OVERHEAD 12         // operations of a feature beside its products
#define BEYOND 1.1          // features of higher degree see no number further outside the range
#define SMALLEST 1e-9       // bounds of the ratio of an error to that of persistence
#define LARGEST 1e4         // also of a run that is not finite
#define RUNAWAY 1e3         // times the range of the data: a run is not finite from here on
static const double ridges[] = {1e-13, 1e-9, 1e-5}; // times the mean diagonal

typedef struct box_candidate {
    int lags, degree, units; // degree 0: random units beside a linear form
    int nfeature;
    double cost; // operations of training and of the runs
} box_candidate;

typedef struct regression {
    const pm_black_box_data *data;
    pm_arena arena, own;     // own: what depends on the candidate
    int width;               // nvalue + ninput
    double *centre, *radius; // [width] of the training rows
    double *step;            // [nvalue] root mean square change from row to row
    long rows;               // of training
    box_candidate c;
    int nx;              // numbers that a prediction reads
    short *factor;       // [nfeature][degree] variables of a product; -1: none
    double *unit;        // [units][nx + 1]
    double *table;       // [nx][degree + 1] Chebyshev polynomials
    double *x;           // [nx]
    double *coefficient; // [nfeature][nvalue]
    double *work;        // [longest][width] rows of a run
} regression;

static bool is_predicted(const pm_black_box_data *d, int i) {
    return d->ntraining == d->count || i >= d->ntraining;
}

// --- features ---

static int count_inputs(const pm_black_box_data *d, int lags) {
    return lags * d->nvalue + (d->ninput > 0 ? (lags + 1) * d->ninput : 0);
}

// Computes the numbers x that the prediction of row k + 1 reads. Returns false if one is missing.
static bool read_inputs(const regression *r, const double *rows, int k) {
    const pm_black_box_data *d = r->data;
    int n = 0;
    bool known = true;
    for (int lag = d->ninput > 0 ? -1 : 0; lag < r->c.lags; ++lag) {
        const double *row = rows + (ptrdiff_t)(k - lag) * r->width;
        for (int c = lag < 0 ? d->nvalue : 0; c < r->width; ++c) {
            r->x[n] = (row[c] - r->centre[c]) / r->radius[c];
            known = known && isfinite(r->x[n]);
            ++n;
        }
    }
    return known;
}

static void compute_features(const regression *r, double *phi) {
    const int degree = r->c.degree;
    if (degree == 0) {
        phi[0] = 1;
        memcpy(phi + 1, r->x, (size_t)r->nx * sizeof *phi);
        for (int u = 0; u < r->c.units; ++u) {
            const double *w = r->unit + (ptrdiff_t)u * (r->nx + 1);
            double sum = w[r->nx];
            for (int i = 0; i < r->nx; ++i) {
                sum += w[i] * r->x[i];
            }
            phi[1 + r->nx + u] = tanh(sum);
        }
        return;
    }
    for (int i = 0; i < r->nx; ++i) {
        double *t = r->table + (ptrdiff_t)i * (degree + 1);
        const double x = fmin(fmax(r->x[i], -BEYOND), BEYOND);
        t[0] = 1;
        t[1] = x;
        for (int k = 2; k <= degree; ++k) {
            t[k] = 2 * x * t[k - 1] - t[k - 2];
        }
    }
    for (int f = 0; f < r->c.nfeature; ++f) {
        const short *factor = r->factor + (ptrdiff_t)f * degree;
        double product = 1;
        if (factor[degree - 1] >= 0 && (degree == 1 || factor[degree - 2] < 0)) {
            product = r->x[factor[degree - 1]]; // linear, also far outside
        } else {
            for (int k = 0, power = 1; k < degree; ++k, ++power) {
                if (k + 1 == degree || factor[k + 1] != factor[k]) {
                    product *= factor[k] < 0 ? 1 : r->table[factor[k] * (degree + 1) + power];
                    power = 0;
                }
            }
        }
        phi[f] = product;
    }
}

// --- training ---

// Adds n rows of features and changes to the normal equations.
static void add_rows(const regression *r, int n, const double *phi, const double *y, double *h,
                     double *b, double *part) {
    const int nf = r->c.nfeature, nv = r->data->nvalue;
    pm_gram_add(n, nf, phi, h);
    pm_gemm(true, false, nf, nv, n, phi, y, part);
    for (int j = 0; j < nf * nv; ++j) {
        b[j] += part[j];
    }
}

// Computes the normal equations of the changes from row to row: h [nfeature][nfeature], upper
// triangle, and b [nfeature][nvalue].
static void accumulate(regression *r, double *h, double *b, double *phi, double *y, double *part) {
    const pm_black_box_data *d = r->data;
    const int nf = r->c.nfeature, nv = d->nvalue;
    const long most = (long)ROWS_PER_FEATURE * nf, stride = (r->rows + most - 1) / most;
    long at = 0;
    int n = 0;
    for (int i = 0; i < d->ntraining; ++i) {
        for (int k = r->c.lags - 1; k + 1 < d->ntime[i]; ++k, ++at) {
            const double *row = d->row[i] + (ptrdiff_t)k * r->width;
            if (at % stride != 0 || !read_inputs(r, d->row[i], k)) {
                continue;
            }
            bool known = true;
            for (int c = 0; c < nv; ++c) {
                y[n * nv + c] = (row[r->width + c] - row[c]) / r->step[c];
                known = known && isfinite(y[n * nv + c]);
            }
            if (known) {
                compute_features(r, phi + (ptrdiff_t)n++ * nf);
            }
            if (n == CHUNK) {
                add_rows(r, n, phi, y, h, b, part);
                n = 0;
            }
        }
    }
    if (n > 0) {
        add_rows(r, n, phi, y, h, b, part);
    }
}

// --- free runs ---

// Runs series i freely from its known rows on, and writes the values to `out` [ntime][nvalue]. Adds
// the logarithms of their errors, relative to persistence.
static void run(const regression *r, int i, double *phi, double *out, double *sum, long *count) {
    const pm_black_box_data *d = r->data;
    const int nf = r->c.nfeature, nv = d->nvalue, ntime = d->ntime[i];
    memcpy(r->work, d->row[i], (size_t)ntime * (size_t)r->width * sizeof *r->work);
    bool finite = true;
    for (int k = 0; k < ntime; ++k) {
        double *row = r->work + (ptrdiff_t)k * r->width;
        for (int c = 0; c < r->width; ++c) { // what is missing stays as it was
            const bool fill = k > 0 && !isfinite(row[c]) && (c >= nv || k < d->given[i]);
            row[c] = fill ? row[c - r->width] : row[c];
        }
        if (k >= d->given[i]) {
            finite = finite && read_inputs(r, r->work, k - 1);
            if (finite) {
                compute_features(r, phi);
            }
            for (int c = 0; c < nv; ++c) {
                double change = 0;
                for (int f = 0; f < nf && finite; ++f) {
                    change += phi[f] * r->coefficient[(ptrdiff_t)f * nv + c];
                }
                row[c] = finite ? row[c - r->width] + r->step[c] * change : NAN;
                finite = finite && fabs(row[c] - r->centre[c]) < RUNAWAY * r->radius[c];
            }
        }
        memcpy(out + (ptrdiff_t)k * nv, row, (size_t)nv * sizeof *out);
    }
    for (int c = 0; c < nv; ++c) {
        double miss = 0, still = 0;
        const double first = out[(ptrdiff_t)(d->given[i] - 1) * nv + c];
        for (int k = d->given[i]; k < ntime; ++k) {
            const double truth = d->row[i][(ptrdiff_t)k * r->width + c];
            const double error = out[(ptrdiff_t)k * nv + c] - truth;
            miss += isfinite(truth) ? error * error : 0;
            still += isfinite(truth) ? (first - truth) * (first - truth) : 0;
        }
        if (still > 0) {
            const double ratio = isfinite(miss) ? sqrt(miss / still) : LARGEST;
            *sum += log(fmin(fmax(ratio, SMALLEST), LARGEST));
            ++*count;
        }
    }
}

// --- the choice ---

// Lists the candidates in the order of their costs.
static int list_candidates(const regression *r, box_candidate *list) {
    const pm_black_box_data *d = r->data;
    int known = MOST_LAGS, count = 0;
    double predicted = 0;
    for (int i = 0; i < d->count; ++i) {
        if (is_predicted(d, i)) {
            known = d->given[i] < known ? d->given[i] : known;
            predicted += d->ntime[i];
        }
    }
    for (int lags = 1; lags <= known; lags *= 2) {
        const int nx = count_inputs(d, lags);
        for (int kind = 1; kind <= MOST_DEGREE + 2 && count < MOST_CANDIDATES; ++kind) {
            const int degree = kind <= MOST_DEGREE ? kind : 0;
            const int units = degree > 0 ? 0 : kind == MOST_DEGREE + 1 ? UNITS / 4 : UNITS;
            double features = degree > 0 ? 1 : 1.0 + nx + units;
            for (int i = 1; i <= degree; ++i) { // (nx + degree) over degree
                features = features * (nx + i) / i;
            }
            const double most = fmin((double)r->rows, ROWS_PER_FEATURE * features);
            if (features > MOST_FEATURES || LEAST_PER_FEATURE * features > (double)r->rows) {
                continue;
            }
            const double own = features * (OVERHEAD + (units > 0 ? nx : 0));
            list[count++] = (box_candidate){
                .lags = lags,
                .degree = degree,
                .units = units,
                .nfeature = (int)features,
                .cost = most * (features * (0.5 * features + d->nvalue) + own) +
                        3 * predicted * (features * d->nvalue + own) +
                        features * features * features,
            };
        }
    }
    for (int i = 1; i < count; ++i) { // sorts by insertion
        const box_candidate own = list[i];
        int k = i;
        for (; k > 0 && list[k - 1].cost > own.cost; --k) {
            list[k] = list[k - 1];
        }
        list[k] = own;
    }
    return count;
}

// Trains and runs one candidate, and keeps its runs if they are the best so far. `out` [count] is
// like predicted.
static pm_status try_candidate(regression *r, const box_candidate *c, double *const *predicted,
                               double *const *out, pm_black_box *chosen) {
    const pm_black_box_data *d = r->data;
    pm_arena *a = &r->own;
    pm_arena_free(a);
    *a = (pm_arena){0};
    r->c = *c;
    r->nx = count_inputs(r->data, c->lags);
    const size_t nv = (size_t)d->nvalue;
    const size_t nx = (size_t)r->nx, nf = (size_t)c->nfeature, degree = (size_t)c->degree;
    r->factor = pm_arena_array(a, nf * (degree + 1), sizeof *r->factor);
    r->unit = pm_arena_array(a, (size_t)c->units * (nx + 1) + 1, sizeof *r->unit);
    r->table = pm_arena_array(a, nx * (degree + 1), sizeof *r->table);
    r->x = pm_arena_array(a, nx, sizeof *r->x);
    r->coefficient = pm_arena_array(a, nf * (size_t)r->data->nvalue, sizeof *r->coefficient);
    PM_TRY(pm_arena_status(a, "a black box"));
    // Lists all products of at most `degree` variables, each with its variables in rising order.
    for (int k = 0; k < c->degree; ++k) {
        r->factor[k] = -1;
    }
    for (int f = 1; f < c->nfeature && c->degree > 0; ++f) {
        short *next = r->factor + (size_t)f * degree;
        memcpy(next, next - degree, degree * sizeof *next);
        int k = c->degree - 1;
        while (k > 0 && next[k] == r->nx - 1) {
            --k;
        }
        const short value = (short)(next[k] + 1);
        for (; k < c->degree; ++k) {
            next[k] = value;
        }
    }
    pm_rng rng;
    pm_rng_init(&rng, 1, 0);
    for (int u = 0; u < c->units; ++u) {
        for (int i = 0; i < r->nx; ++i) {
            r->unit[(ptrdiff_t)u * (r->nx + 1) + i] = SLOPE / sqrt(r->nx) * pm_rng_normal(&rng);
        }
        r->unit[(ptrdiff_t)u * (r->nx + 1) + r->nx] = 2 * pm_rng_uniform(&rng) - 1;
    }
    double *h = pm_arena_array(&r->own, nf * nf, sizeof *h);
    double *damped = pm_arena_array(&r->own, nf * nf, sizeof *damped);
    double *b = pm_arena_array(&r->own, nf * nv, sizeof *b);
    double *part = pm_arena_array(&r->own, nf * nv, sizeof *part);
    double *phi = pm_arena_array(&r->own, CHUNK * nf, sizeof *phi);
    double *y = pm_arena_array(&r->own, CHUNK * nv, sizeof *y);
    PM_TRY(pm_arena_status(&r->own, "a black box"));
    accumulate(r, h, b, phi, y, part);
    double trace = 0;
    for (size_t i = 0; i < nf; ++i) {
        trace += h[i * (nf + 1)];
    }
    for (size_t k = 0; k < sizeof ridges / sizeof *ridges; ++k) {
        memcpy(damped, h, nf * nf * sizeof *h);
        memcpy(r->coefficient, b, nf * nv * sizeof *b);
        for (size_t i = 0; i < nf; ++i) {
            damped[i * (nf + 1)] += ridges[k] * trace / (double)nf;
        }
        if (!pm_cholesky_factor(c->nfeature, damped)) {
            continue;
        }
        pm_cholesky_back(c->nfeature, damped, d->nvalue, r->coefficient);
        double sum = 0;
        long count = 0;
        for (int i = 0; i < d->count; ++i) {
            if (is_predicted(d, i)) {
                run(r, i, phi, out[i], &sum, &count);
            }
        }
        const double error = count > 0 ? sum / (double)count : 0;
        if (chosen->tried == 0 || error < chosen->error) {
            chosen->error = error;
            chosen->tried = chosen->tried > 0 ? chosen->tried : 1;
            for (int i = 0; i < d->count; ++i) {
                if (is_predicted(d, i)) {
                    memcpy(predicted[i], out[i], (size_t)d->ntime[i] * nv * sizeof(double));
                }
            }
            const char *form =
                c->degree > 0 ? "polynomials of degree %d, lag %d" : "%d random units, lag %d";
            snprintf(chosen->name, sizeof chosen->name, form, c->degree > 0 ? c->degree : c->units,
                     c->lags);
        }
    }
    return PM_OK;
}

pm_status pm_black_box_predict(const pm_black_box_data *d, double seconds, double *const *predicted,
                               pm_black_box *chosen) {
    regression own = {.data = d, .width = d->nvalue + d->ninput}, *r = &own;
    pm_status status;
    *chosen = (pm_black_box){.error = log(LARGEST)};
    int longest = 1;
    for (int i = 0; i < d->count; ++i) {
        longest = d->ntime[i] > longest ? d->ntime[i] : longest;
    }
    const size_t width = (size_t)r->width;
    box_candidate list[MOST_CANDIDATES];
    int count = 0;
    double spent = 0;
    r->centre = pm_arena_array(&r->arena, width, sizeof *r->centre);
    r->radius = pm_arena_array(&r->arena, width, sizeof *r->radius);
    r->step = pm_arena_array(&r->arena, width, sizeof *r->step);
    r->work = pm_arena_array(&r->arena, (size_t)longest * width, sizeof *r->work);
    double **out = pm_arena_array(&r->arena, (size_t)d->count, sizeof *out);
    for (int i = 0; i < d->count && out != NULL; ++i) {
        const size_t size = (size_t)d->ntime[i] * (size_t)d->nvalue;
        out[i] = is_predicted(d, i) ? pm_arena_array(&r->arena, size, sizeof **out) : NULL;
    }
    PM_TRY_DONE(pm_arena_status(&r->arena, "a black box"));
    // Finds the range of each column and the typical change of each value over the training rows.
    for (int c = 0; c < r->width; ++c) {
        double low = INFINITY, high = -INFINITY, square = 0;
        long steps = 0;
        for (int i = 0; i < d->ntraining; ++i) {
            for (int k = 0; k < d->ntime[i]; ++k) {
                const double *row = d->row[i] + (ptrdiff_t)k * r->width + c;
                if (!isfinite(*row)) {
                    continue;
                }
                low = fmin(low, *row);
                high = fmax(high, *row);
                const double change = k > 0 ? *row - row[-r->width] : NAN;
                square += isfinite(change) ? change * change : 0;
                steps += isfinite(change);
            }
        }
        r->centre[c] = low <= high ? 0.5 * (low + high) : 0;
        r->radius[c] = high > low ? 0.5 * (high - low) : 1;
        if (c < d->nvalue) {
            r->step[c] = square > 0 ? sqrt(square / (double)steps) : 1;
            r->rows = c == 0 ? steps : r->rows < steps ? r->rows : steps;
        }
    }
    count = r->rows > 0 ? list_candidates(r, list) : 0;
    if (count == 0) {
        PM_TRY_DONE(pm_fail(PM_EDATA, "a black box has too few rows to train on"));
    }
    for (int i = 0; i < count && (i == 0 || spent + list[i].cost < SPEED * seconds); ++i) {
        PM_TRY_DONE(try_candidate(r, &list[i], predicted, out, chosen));
        spent += list[i].cost;
        chosen->tried = i + 1;
    }
done:
    pm_arena_free(&r->own);
    pm_arena_free(&r->arena);
    return status;
}
