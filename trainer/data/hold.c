// Compares samples with what lines and polynomials through their neighbours predict.
#include "data/hold.h"

#include <math.h>
#include <stdlib.h>

#define NEIGHBOURS 6 // samples of the polynomial, half of them on each side
// Samples jump, or are noisy, if the mean square error of a line through their neighbours is at
// least this part of their mean square change.
#define BROKEN 0.2
// Root mean square change, relative to the deviation, of a column that jumps at many samples.
#define LARGE 0.3
#define FEW 0.1          // part of the changes that makes a column jump at few samples,
#define NEARLY_ALL 0.8   // if these changes have so much of the sum of squares
#define MUCH_BETTER 0.25 // ratio of mean squares of polynomial and line of a smooth column

// What is summed over all samples of a column.
typedef struct sums {
    double line, curve, change; // squares of misses and changes
    double mean, square;
    long count, inner; // samples, and those with enough neighbours on both sides
    double *changes;   // their squares
    size_t nchange;
} sums;

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x < y) - (x > y); // the largest first
}

// Predicts y[at] by the polynomial through `half` samples before it and as many after it.
static double predict(const double *t, const double *y, int at, int half) {
    double sum = 0;
    for (int i = at - half; i <= at + half; ++i) {
        double weight = 1;
        for (int j = at - half; j <= at + half && i != at; ++j) {
            weight *= j == i || j == at ? 1 : (t[at] - t[j]) / (t[i] - t[j]);
        }
        sum += i == at ? 0 : weight * y[i];
    }
    return sum;
}

// Returns true if samples jump, and are not only noisy.
static bool jumps(sums *s) {
    const double mean = s->mean / (double)s->count;
    const double variance = fmax(s->square / (double)s->count - mean * mean, 0);
    double all = 0, largest = 0;
    qsort(s->changes, s->nchange, sizeof *s->changes, compare);
    for (size_t k = 0; k < s->nchange; ++k) {
        all += s->changes[k];
        largest += (double)k < FEW * (double)s->nchange ? s->changes[k] : 0;
    }
    return all / (double)s->nchange > LARGE * LARGE * variance || largest > NEARLY_ALL * all;
}

pm_status pm_hold_of_column(const pm_dataset *d, int column, pm_hold *hold) {
    const size_t most = (size_t)d->ntime;
    const int half = NEIGHBOURS / 2;
    pm_arena arena = {0};
    sums s = {.changes = pm_arena_array(&arena, most * (size_t)d->ntrajectory, sizeof *s.changes)};
    double *t = pm_arena_array(&arena, most, sizeof *t);
    double *y = pm_arena_array(&arena, most, sizeof *y);
    const pm_status status = pm_arena_status(&arena, "the samples of a column");
    for (int i = 0; i < d->ntrajectory && status == PM_OK; ++i) {
        const int length = pm_dataset_length(d, i);
        int n = 0;
        for (int j = 0; j < length; ++j) {
            y[n] = pm_dataset_state(d, i, j)[column];
            t[n] = pm_dataset_time(d, i, j);
            n += !isnan(y[n]);
        }
        for (int k = 0; k < n; ++k) {
            const double change = k > 0 ? y[k] - y[k - 1] : 0;
            s.mean += y[k];
            s.square += y[k] * y[k];
            ++s.count;
            if (k > 0) {
                s.changes[s.nchange++] = change * change;
            }
            if (k >= half && k + half < n) {
                const double line = y[k] - predict(t, y, k, 1);
                const double curve = y[k] - predict(t, y, k, half);
                s.line += line * line;
                s.curve += curve * curve;
                s.change += change * change;
                ++s.inner;
            }
        }
    }
    if (status == PM_OK) {
        const bool still = s.inner == 0 || !(s.change > 0);
        *hold = still || s.curve < MUCH_BETTER * s.line    ? PM_HOLD_SMOOTH
                : s.line >= BROKEN * s.change && jumps(&s) ? PM_HOLD_PREVIOUS
                                                           : PM_HOLD_LINEAR;
    }
    pm_arena_free(&arena);
    return status;
}
