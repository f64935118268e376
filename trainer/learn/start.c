// Successive halving of random draws of the weights (Jamieson, Talwalkar, AISTATS 2016), by short
// fits to derivatives.
#include "learn/start.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/progress.h"
#include "base/rng.h"
#include "learn/objective.h"
#include "learn/optimiser.h"
#include "learn/processes.h"

// The number of residuals per weight in a batch of a short fit, and the fewest samples in it.
#define RESIDUALS_PER_WEIGHT 8
#define SMALLEST_BATCH 512
// The number of samples on which candidates are compared.
#define COMPARED 2048
// The difference between the seeds of two candidates.
#define SEED_STRIDE 1000003

typedef struct candidate {
    int id;
    double loss;
    double *theta, *moment; // [size], [2][size]
    int done;
} candidate;

typedef struct search {
    pm_training *training;
    pm_objective *objective;
    int size, count;
    uint64_t seed;
    candidate *candidate; // the first `count` are still in the race
    const volatile sig_atomic_t *stop;
    pm_progress progress;
    int iterations; // of all candidates so far
} search;

static void draw(pm_training *t, uint64_t seed, double *theta) {
    for (int i = 0; i < pm_system_components(t->system); ++i) {
        pm_rng rng;
        pm_rng_init(&rng, seed, (uint64_t)i);
        pm_params *params = pm_system_params(t->system, i);
        pm_params_randomise(params, &rng);
        pm_params_gather(params, theta);
        theta += pm_params_trained(params);
    }
}

void pm_start_draw(pm_training *training, double *theta) {
    draw(training, training->seed, theta);
}

void pm_start_draw_again(pm_training *training, int id, double *theta) {
    draw(training, training->seed + SEED_STRIDE * (uint64_t)id, theta);
}

static pm_status report(void *context, const pm_optimisation *o, double loss) {
    search *s = context;
    char detail[64];
    (void)o;
    snprintf(detail, sizeof detail, "%d starts left, loss %.3e", s->count, loss);
    pm_progress_update(&s->progress, ++s->iterations, detail);
    const pm_team *team = s->training->stage[0].loss.team;
    return pm_team_any(team, *s->stop)
               ? pm_fail(PM_EINTERRUPTED, "interrupted while choosing the initial weights")
               : PM_OK;
}

// Runs some more iterations of one candidate and computes its loss after them.
static pm_status advance(search *s, candidate *c, int iterations) {
    const pm_loss_context context = pm_objective_context(s->objective);
    const int wanted = RESIDUALS_PER_WEIGHT * s->size / context.samples->nz;
    pm_optimisation o = {.objective = s->objective,
                         .schedule = {.iterations = c->done + iterations,
                                      .batch = wanted > SMALLEST_BATCH ? wanted : SMALLEST_BATCH,
                                      .guarded = true,
                                      .early = true},
                         .seed = s->seed,
                         .theta = c->theta,
                         .moment = c->moment,
                         .done = c->done,
                         .report = report,
                         .context = s};
    pm_objective_set_weights(s->objective, c->theta);
    const pm_status status = pm_optimiser_find("gauss_newton")->run(&o);
    c->done = o.done;
    c->loss = INFINITY; // a candidate that cannot be evaluated is dropped
    PM_TRY(status == PM_ENUMERIC ? PM_OK : status);
    if (status == PM_OK) {
        const int count = context.samples->count;
        const int step = count > COMPARED ? count / COMPARED : 1;
        int index[COMPARED], n = 0;
        for (; n < COMPARED && n * step < count; ++n) {
            index[n] = n * step;
        }
        c->loss = pm_objective_evaluate(s->objective, n, index, NULL);
        c->loss = isfinite(c->loss) ? c->loss : INFINITY;
    }
    return PM_OK;
}

// Compares candidates by loss, then by number, so that the order is unique.
static int compare(const void *a, const void *b) {
    const candidate *x = a, *y = b;
    return x->loss != y->loss ? (x->loss < y->loss ? -1 : 1) : x->id - y->id;
}

static pm_status halve(search *s) {
    int iterations = s->training->try_iterations;
    while (s->count > 1) {
        for (int i = 0; i < s->count; ++i) {
            PM_TRY(advance(s, &s->candidate[i], iterations));
        }
        qsort(s->candidate, (size_t)s->count, sizeof *s->candidate, compare);
        s->count = (s->count + 1) / 2;
        iterations += iterations / 2;
    }
    return PM_OK;
}

// Returns the number of iterations in all rounds.
static int count_iterations(int tries, int iterations) {
    int sum = 0;
    for (; tries > 1; tries = (tries + 1) / 2) {
        sum += tries * iterations;
        iterations += iterations / 2;
    }
    return sum;
}

// Draws all candidates. The first one of the training's own seed is the present weights.
static pm_status open_candidates(search *s, const double *declared, const double *theta) {
    pm_training *t = s->training;
    const size_t n = (size_t)s->size;
    for (int k = 0; k < s->count; ++k) {
        candidate *c = &s->candidate[k];
        c->id = k;
        c->theta = malloc((n + 1) * sizeof *c->theta);
        c->moment = calloc(2 * n + 1, sizeof *c->moment);
        if (c->theta == NULL || c->moment == NULL) {
            return pm_fail(PM_ENOMEM, "out of memory for %d starts of %d weights", s->count,
                           s->size);
        }
        memcpy(c->theta, theta, n * sizeof *theta);
        if (k > 0 || s->seed != t->seed) {
            pm_objective_set_weights(s->objective, declared);
            draw(t, s->seed + SEED_STRIDE * (uint64_t)k, c->theta);
        }
    }
    return PM_OK;
}

static pm_status run_search(search *s, const double *declared, double *theta) {
    pm_status status = open_candidates(s, declared, theta);
    const double started = pm_clock();
    const int tries = s->count;
    if (status == PM_OK) {
        pm_progress_init(&s->progress, "start",
                         count_iterations(tries, s->training->try_iterations));
        status = halve(s);
        pm_progress_finish(&s->progress);
    }
    if (status == PM_OK) {
        const candidate *best = &s->candidate[0];
        memcpy(theta, best->theta, (size_t)s->size * sizeof *theta);
        printf("start            %8d iterations %8.1f s   loss %.3e   best of %d, number %d\n",
               s->iterations, pm_clock() - started, best->loss, tries, best->id + 1);
        fflush(stdout);
    }
    return status;
}

pm_status pm_start_search(pm_training *training, const pm_samples *samples, uint64_t seed,
                          const double *declared, double *theta,
                          const volatile sig_atomic_t *stop) {
    search s = {.training = training, .count = training->tries, .seed = seed, .stop = stop};
    const pm_loss loss = {.residual = PM_RESIDUAL_DERIVATIVE,
                          .integrator = training->stage[0].loss.integrator,
                          .substeps = 1,
                          .degeneracy = training->stage[0].loss.degeneracy,
                          .balance = training->stage[0].loss.balance,
                          .team = training->stage[0].loss.team};
    if (s.count <= 1) {
        return PM_OK;
    }
    PM_TRY(pm_objective_open(&s.objective, training->system, samples, &loss));
    s.size = pm_objective_size(s.objective);
    s.candidate = calloc((size_t)s.count, sizeof *s.candidate);
    pm_status status = s.candidate == NULL ? pm_fail(PM_ENOMEM, "out of memory for starts")
                                           : run_search(&s, declared, theta);
    for (int k = 0; k < training->tries && s.candidate != NULL; ++k) {
        free(s.candidate[k].theta);
        free(s.candidate[k].moment);
    }
    free(s.candidate);
    pm_objective_set_weights(s.objective, theta);
    if (status == PM_OK) {
        status = pm_processes_separate(training->system);
        pm_objective_weights(s.objective, theta);
    }
    pm_objective_close(s.objective);
    return status;
}
