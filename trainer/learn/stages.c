// Derivatives first, which are cheap and have a wide basin; then one step of the integrator, whose
// residuals know nothing of the error of differences; at last steps about as they are served.
// Batches grow: the few samples that decide rollouts must be among them. A loss that is robust from
// three times the median on left rare samples of two of seven circuits off by 1e5 times the median,
// and rollouts through them by 5 and 18 %; a plain one leaves the median sample 50 times worse, so
// the last one is robust from farther out.
#include "learn/stages.h"

// Gauss-Newton needs the normal equations of all weights; beyond so many, Adam.
#define MOST_WEIGHTS 4000
// Residuals for each weight in a batch of the three stages.
#define FIRST_RESIDUALS 4
#define SECOND_RESIDUALS 8
#define LAST_RESIDUALS 12
#define ROBUST 20 // times the median, at the end
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
    const int second = batch_of(SECOND_RESIDUALS, weights, nz);
    const int last = batch_of(LAST_RESIDUALS, weights, nz);
    add(t, common, "gauss_newton", 60 * often, first)->loss.residual = PM_RESIDUAL_DERIVATIVE;
    add(t, common, "gauss_newton", 40 * often, second)->loss.substeps = 1;
    pm_stage *end = add(t, common, "gauss_newton", 20 * often, last);
    end->loss.substeps = (common->loss.substeps + 1) / 2;
    end->loss.robust = common->loss.robust > 0 ? common->loss.robust : ROBUST;
}
