// Draws of the weights, and short fits of them to derivatives.
#include "fit/start.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/progress.h"
#include "base/rng.h"
#include "data/trained.h"
#include "fit/dissipative_modes.h"
#include "fit/normalization.h"
#include "loss/objective.h"
#include "optimise/optimiser.h"
#include "optimise/successive_halving.h"

// The number of residuals per weight in a batch of a short fit, and the fewest samples in it.
#define RESIDUALS_PER_WEIGHT 8
#define SMALLEST_BATCH 512
// The number of samples on which candidates are compared.
#define COMPARED 2048
// The most iterations with which the strengths of dissipative processes are fitted, over those of
// the first round of draws.
#define STRENGTH_ITERATIONS 6
// The difference between the seeds of two candidates.
#define SEED_STRIDE 1000003

typedef struct search {
    pm_training *training;
    pm_objective *objective;
    int size, left; // weights; draws in the race
    pm_lateness early;
    uint64_t seed;
    double *theta, *moment; // [tries][size], [tries][2][size]
    int *done;              // [tries] iterations so far
    const volatile sig_atomic_t *stop;
    pm_progress progress;
    int iterations; // of all draws so far
} search;

static void draw(pm_training *t, uint64_t seed, double *theta) {
    for (int i = 0; i < pm_system_components(t->system); ++i) {
        pm_rng rng;
        pm_rng_init(&rng, seed, (uint64_t)i);
        pm_params_randomise(pm_system_params(t->system, i), &rng);
    }
    pm_trained_gather(t->system, theta);
}

void pm_start_draw(pm_training *training, int id, double *theta) {
    draw(training, training->seed + SEED_STRIDE * (uint64_t)id, theta);
}

static pm_status report(void *context, const pm_optimisation *o, double loss) {
    search *s = context;
    char detail[64];
    (void)o;
    snprintf(detail, sizeof detail, "%d starts left, loss %.3e", s->left, loss);
    pm_progress_update(&s->progress, ++s->iterations, detail);
    const pm_team *team = s->training->stage[0].loss.team;
    return pm_team_any(team, *s->stop)
               ? pm_fail(PM_EINTERRUPTED, "interrupted while choosing the initial weights")
               : PM_OK;
}

// Runs some more iterations of one draw and computes its loss after them.
static pm_status advance(void *context, int id, int left, int iterations, double *loss) {
    search *s = context;
    const pm_samples *samples = pm_objective_context(s->objective).samples;
    const int wanted = RESIDUALS_PER_WEIGHT * s->size / samples->nz;
    double *theta = s->theta + (ptrdiff_t)id * s->size;
    pm_optimisation o = {.objective = s->objective,
                         .schedule = {.iterations = s->done[id] + iterations,
                                      .batch = wanted > SMALLEST_BATCH ? wanted : SMALLEST_BATCH,
                                      .guarded = true,
                                      .early = s->early},
                         .seed = s->seed,
                         .theta = theta,
                         .moment = s->moment + (ptrdiff_t)id * 2 * s->size,
                         .done = s->done[id],
                         .report = report,
                         .context = s};
    s->left = left;
    pm_objective_set_weights(s->objective, theta);
    const pm_status status = pm_optimiser_find("gauss_newton")->run(&o);
    s->done[id] = o.done;
    *loss = INFINITY; // a draw that cannot be evaluated is dropped
    PM_TRY(status == PM_ENUMERIC ? PM_OK : status);
    if (status == PM_OK) {
        const int step = samples->count > COMPARED ? samples->count / COMPARED : 1;
        int index[COMPARED], n = 0;
        for (; n < COMPARED && n * step < samples->count; ++n) {
            index[n] = n * step;
        }
        const double value = pm_objective_evaluate(s->objective, n, index, NULL);
        *loss = isfinite(value) ? value : INFINITY;
    }
    return PM_OK;
}

// Draws all weights and chooses the best. The first draw of the training's own seed is the present
// weights.
static pm_status run_search(search *s, const double *declared, double *theta, double *loss,
                            pm_arena *arena) {
    const pm_training *t = s->training;
    const size_t n = (size_t)s->size, tries = (size_t)t->tries;
    const pm_successive_halving halving = {t->tries, t->try_iterations, advance, s};
    s->theta = pm_arena_array(arena, tries * n + 1, sizeof *s->theta);
    s->moment = pm_arena_array(arena, tries * 2 * n + 1, sizeof *s->moment);
    s->done = pm_arena_array(arena, tries, sizeof *s->done);
    PM_TRY(pm_arena_status(arena, "%zu starts of %zu weights", tries, n));
    for (size_t k = 0; k < tries; ++k) {
        memcpy(s->theta + k * n, theta, n * sizeof *theta);
        if (k > 0 || s->seed != t->seed) {
            pm_objective_set_weights(s->objective, declared);
            draw(s->training, s->seed + SEED_STRIDE * k, s->theta + k * n);
        }
    }
    const double started = pm_clock();
    int best = 0;
    pm_progress_init(&s->progress, "start", pm_successive_halving_iterations(&halving));
    const pm_status status = pm_successive_halving_run(&halving, &best, loss);
    pm_progress_finish(&s->progress);
    PM_TRY(status);
    memcpy(theta, s->theta + (size_t)best * n, n * sizeof *theta);
    printf("start            %8d iterations %8.1f s   loss %.3e   best of %d, number %d\n",
           s->iterations, pm_clock() - started, *loss, t->tries, best + 1);
    fflush(stdout);
    return PM_OK;
}

pm_status pm_start_search(pm_training *training, const pm_samples *samples, uint64_t seed,
                          const double *declared, double *theta, double *loss,
                          const volatile sig_atomic_t *stop) {
    search s = {.training = training, .seed = seed, .early = PM_LATE, .stop = stop};
    const pm_loss *first = &training->stage[0].loss;
    const pm_loss loss_of_rates = {.residual = PM_RESIDUAL_DERIVATIVE,
                                   .integrator = first->integrator,
                                   .substeps = 1,
                                   .degeneracy = first->degeneracy,
                                   .balance = first->balance,
                                   .team = first->team};
    if (training->tries <= 1) {
        return PM_OK;
    }
    pm_arena arena = {0};
    PM_TRY(pm_objective_open(&s.objective, training->system, samples, &loss_of_rates));
    s.size = pm_objective_size(s.objective);
    pm_status status = run_search(&s, declared, theta, loss, &arena);
    pm_objective_set_weights(s.objective, theta);
    if (status == PM_OK) {
        status = pm_dissipative_modes_separate(training->system);
        pm_objective_weights(s.objective, theta);
    }
    pm_objective_close(s.objective);
    s.objective = NULL;
    // How large co-energies are is known from now on. The draws of another seed keep these
    // constants, since the best weights of the seed before rest on them.
    if (status == PM_OK && seed == training->seed) {
        status = pm_normalization_of_strengths(training->system, samples);
    }
    bool late = false; // some weights wait for the choice of the initial ones
    for (int i = 0; i < pm_system_components(training->system); ++i) {
        const pm_params *params = pm_system_params(training->system, i);
        for (int k = 0; k < params->count; ++k) {
            late = late || (params->entry[k].trained && params->entry[k].late == PM_LATE);
        }
    }
    if (status == PM_OK && late) {
        // Strengths are fitted first. Layers of energies would otherwise bend where a strength
        // varies, and never straighten again.
        s.early = PM_LATE_LAYERS;
        s.theta = theta;
        memset(s.moment, 0, 2 * (size_t)s.size * sizeof *s.moment);
        s.done[0] = 0;
        const int iterations = STRENGTH_ITERATIONS * training->try_iterations;
        status = pm_objective_open(&s.objective, training->system, samples, &loss_of_rates);
        pm_progress_init(&s.progress, "strengths", iterations);
        s.iterations = 0;
        status = status == PM_OK ? advance(&s, 0, 1, iterations, loss) : status;
        pm_progress_finish(&s.progress);
        pm_objective_close(s.objective);
        printf("strengths        %8d iterations   loss %.3e\n", s.done[0], *loss);
    }
    pm_arena_free(&arena);
    return status;
}
