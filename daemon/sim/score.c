// Relative errors of predicted trajectories, and the numbers of a box plot.
#include "sim/score.h"

#include <assert.h>
#include <math.h>

#include "base/linalg.h"

// The fraction of its group's root mean square below which a snapshot counts as zero.
#define NOTHING 1e-9

void pm_score_add(const pm_columns *columns, int group, const double *predicted,
                  const double *truth, pm_score_sums *sums) {
    for (int i = 0; i < columns->nz; ++i) {
        if (columns->group[i] == group) {
            const int k = columns->column[i];
            const double difference = predicted[k] - truth[k];
            sums->error += difference * difference;
            sums->norm += truth[k] * truth[k];
        }
    }
}

double pm_score_of(const pm_score_sums *sums) {
    return sqrt(sums->error) / (sums->norm > 0 ? sqrt(sums->norm) : 1);
}

// Sums up one group over the rows [first, last).
static pm_score_sums sums_of(const pm_columns *columns, int group, int ncolumn, int first, int last,
                             const double *predicted, const double *truth) {
    pm_score_sums sums = {0};
    for (int j = first; j < last; ++j) {
        const size_t row = (size_t)j * (size_t)ncolumn;
        pm_score_add(columns, group, predicted + row, truth + row, &sums);
    }
    return sums;
}

void pm_score(const pm_columns *columns, int ntime, int ncolumn, const double *predicted,
              const double *truth, double *trajectory, double *snapshot) {
    const int ngroup = columns->ngroup;
    for (int g = 0; g < ngroup; ++g) {
        const pm_score_sums whole = sums_of(columns, g, ncolumn, 0, ntime, predicted, truth);
        const double mean = whole.norm / ntime;
        trajectory[g] = pm_score_of(&whole);
        for (int j = 0; snapshot != NULL && j < ntime; ++j) {
            pm_score_sums one = sums_of(columns, g, ncolumn, j, j + 1, predicted, truth);
            one.norm = one.norm > NOTHING * NOTHING * mean ? one.norm : mean;
            snapshot[(size_t)j * (size_t)ngroup + (size_t)g] = pm_score_of(&one);
        }
    }
}

// Returns the value below which the fraction p of n sorted values lies.
static double quantile(int n, const double *value, double p) {
    const double position = p * (n - 1);
    const int i = (int)position;
    const double weight = position - i;
    return weight > 0 ? (1 - weight) * value[i] + weight * value[i + 1] : value[i];
}

pm_box pm_box_of(int n, double *value) {
    assert(n > 0);
    pm_sort((size_t)n, value);
    pm_box box = {.first_quartile = quantile(n, value, 0.25),
                  .median = quantile(n, value, 0.5),
                  .third_quartile = quantile(n, value, 0.75)};
    const double reach = 1.5 * (box.third_quartile - box.first_quartile);
    box.low = box.first_quartile;
    box.high = box.third_quartile;
    box.largest = value[n - 1];
    for (int i = 0; i < n; ++i) {
        box.mean += value[i] / n;
        if (value[i] < box.low && value[i] >= box.first_quartile - reach) {
            box.low = value[i];
        }
        if (value[i] > box.high && value[i] <= box.third_quartile + reach) {
            box.high = value[i];
        }
    }
    return box;
}
