// The automatic stages. Derivatives come first: they are cheap, and good weights are found from far
// away. Steps that are close to those that are served follow. They include the states whose rates
// are uncertain (learn/samples.h). Their loss is robust from 20 times the median on. From 3
// times on, rare samples of two of seven circuits had residuals of 1e5 times the median and
// rollouts through them errors of 5 and 18 %; without a robust loss the median residual was 50
// times larger.
#include "learn/stages.h"

// The most weights for Gauss-Newton, which solves the normal equations of all weights; Adam beyond.
#define MOST_WEIGHTS 4000
// The number of residuals per weight in a batch of each stage.
#define FIRST_RESIDUALS 64 // all samples, where there are not too many
#define LAST_RESIDUALS 12
#define ROBUST 20 // of the last stage, in medians
// The cost of an iteration grows with the square of the number of weights. Below this number there
// are more iterations.
#define MANY_WEIGHTS 800
#define SMALLEST_BATCH 512
#define LARGEST_BATCH 8192

static int count_weights(const pm_system *system) {
    int count = 0;
    for (int i = 0; i < pm_system_components(system); ++i) {
        count += (int)pm_params_trained(pm_system_params(system, i));
    }
    return count;
}

static int batch_of(int residuals, int weights, int nz) {
    const int wanted = residuals * weights / nz;
    return wanted < SMALLEST_BATCH  ? SMALLEST_BATCH
           : wanted > LARGEST_BATCH ? LARGEST_BATCH
                                    : wanted;
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
    const int nz = t->scene->nz;
    t->nstage = 0;
    if (weights > MOST_WEIGHTS) {
        add(t, common, "adam", 60, 64)->loss.residual = PM_RESIDUAL_DERIVATIVE;
        add(t, common, "adam", 60, 64)->loss.substeps = 1;
        return;
    }
    const int often = weights < MANY_WEIGHTS / 2 ? 3 : weights < MANY_WEIGHTS ? 2 : 1;
    const int first = batch_of(FIRST_RESIDUALS, weights, nz);
    const int last = batch_of(LAST_RESIDUALS, weights, nz);
    add(t, common, "gauss_newton", 60 * often, first)->loss.residual = PM_RESIDUAL_DERIVATIVE;
    pm_stage *end = add(t, common, "gauss_newton", 30 * often, last);
    end->loss.substeps = (common->loss.substeps + 1) / 2;
    end->loss.robust = common->loss.robust > 0 ? common->loss.robust : ROBUST;
}
