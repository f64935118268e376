// Derivatives first, which are cheap and have a wide basin; then one step of the integrator, whose
// residuals know nothing of the error of differences; at last steps as they are served, with wild
// samples counting less.
#include "learn/stages.h"

// Gauss-Newton needs the normal equations of all weights; beyond so many, Adam.
#define MOST_WEIGHTS 4000
#define RESIDUALS_PER_WEIGHT 4
// Iterations cost as the square of the weights: of fewer than so many there may be more.
#define MANY_WEIGHTS 800
#define SMALLEST_BATCH 512
#define LARGEST_BATCH 4000

static int count_weights(const pm_system *system) {
    int count = 0;
    for (int i = 0; i < pm_system_components(system); ++i) {
        count += (int)pm_params_trained(pm_system_params(system, i));
    }
    return count;
}

static pm_stage *add(pm_training *t, const pm_stage *common, const char *optimiser, int iterations,
                     int batch) {
    pm_stage *stage = &t->stage[t->nstage++];
    *stage = *common;
    stage->optimiser = pm_optimiser_find(optimiser);
    stage->schedule = (pm_schedule){.iterations = iterations,
                                    .batch = batch,
                                    .first_rate = 3e-3,
                                    .last_rate = 1e-5,
                                    .beta2 = 0.999,
                                    .memory = 30,
                                    .guarded = true};
    return stage;
}

void pm_stages_auto(pm_training *t, const pm_stage *common) {
    const int weights = count_weights(t->system);
    const int wanted = RESIDUALS_PER_WEIGHT * weights / t->scene->nz;
    const int batch = wanted < SMALLEST_BATCH  ? SMALLEST_BATCH
                      : wanted > LARGEST_BATCH ? LARGEST_BATCH
                                               : wanted;
    t->nstage = 0;
    if (weights > MOST_WEIGHTS) {
        add(t, common, "adam", 60, 64)->loss.residual = PM_RESIDUAL_DERIVATIVE;
        add(t, common, "adam", 60, 64)->loss.substeps = 1;
        return;
    }
    const int often = weights < MANY_WEIGHTS / 2 ? 3 : weights < MANY_WEIGHTS ? 2 : 1;
    add(t, common, "gauss_newton", 60 * often, batch)->loss.residual = PM_RESIDUAL_DERIVATIVE;
    add(t, common, "gauss_newton", 30 * often, batch)->loss.substeps = 1;
    pm_stage *last = add(t, common, "gauss_newton", 15 * often, batch);
    last->loss.substeps = (common->loss.substeps + 1) / 2;
    last->loss.robust = 3;
}
