// Noise and missing samples, each trajectory with random numbers of its own.
#include "command/truth_noise.h"

#include <math.h>
#include <string.h>

#include "base/rng.h"

static double deviation_of(const pm_dataset *d, int column) {
    const size_t n = (size_t)d->ntrajectory * (size_t)d->ntime;
    double mean = 0, square = 0;
    for (size_t i = 0; i < n; ++i) {
        mean += d->z[i * (size_t)d->ncolumn + (size_t)column] / (double)n;
    }
    for (size_t i = 0; i < n; ++i) {
        const double x = d->z[i * (size_t)d->ncolumn + (size_t)column] - mean;
        square += x * x / (double)n;
    }
    return sqrt(square);
}

static void add_noise(pm_dataset *d, int trajectory, int stream, double noise, int seed,
                      const double *deviation) {
    pm_rng rng;
    pm_rng_init(&rng, (uint64_t)seed, 2 * (uint64_t)stream);
    for (int j = 0; j < d->ntime; ++j) {
        double *state = pm_dataset_state(d, trajectory, j);
        for (int c = 0; c < d->ncolumn; ++c) {
            state[c] += noise * deviation[c] * pm_rng_normal(&rng);
        }
    }
}

// Leaves out states of one trajectory. The first two that are left stay in any case.
static void leave_out(pm_dataset *d, int trajectory, int stream, double missing, int seed) {
    pm_rng rng;
    pm_rng_init(&rng, (uint64_t)seed, 2 * (uint64_t)stream + 1);
    double *t = d->times + (size_t)trajectory * (size_t)d->ntime;
    int kept = 0;
    for (int j = 0; j < d->ntime; ++j) {
        if (pm_rng_uniform(&rng) >= missing || kept + d->ntime - j <= 2) {
            t[kept] = d->t[j];
            memmove(pm_dataset_state(d, trajectory, kept++), pm_dataset_state(d, trajectory, j),
                    (size_t)d->ncolumn * sizeof(double));
        }
    }
    for (int j = kept; j < d->ntime; ++j) {
        t[j] = NAN;
        for (int c = 0; c < d->ncolumn; ++c) {
            pm_dataset_state(d, trajectory, j)[c] = NAN;
        }
    }
}

pm_status pm_truth_add_noise(pm_dataset *dataset, int first, double noise, double missing,
                             int seed) {
    double *deviation =
        pm_arena_array(&dataset->arena, (size_t)dataset->ncolumn, sizeof *deviation);
    if (deviation == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for noise");
    }
    for (int c = 0; c < dataset->ncolumn; ++c) {
        deviation[c] = deviation_of(dataset, c);
    }
    for (int i = 0; i < dataset->ntrajectory; ++i) {
        add_noise(dataset, i, first + i, noise, seed, deviation);
    }
    if (!(missing > 0)) {
        return PM_OK;
    }
    const size_t n = (size_t)dataset->ntrajectory * (size_t)dataset->ntime;
    dataset->measured = true;
    dataset->times = pm_arena_array(&dataset->arena, n, sizeof *dataset->times);
    if (dataset->times == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for times");
    }
    for (int i = 0; i < dataset->ntrajectory; ++i) {
        leave_out(dataset, i, first + i, missing, seed);
    }
    return PM_OK;
}
