// L-BFGS by libLBFGS (Liu, Nocedal, Math. Program. 45 (1989) 503) on all samples at once. After an
// interruption it resumes with an empty memory.
#include <lbfgs.h>
#include <math.h>
#include <string.h>

#include "learn/optimiser_table.h"

typedef struct run {
    pm_optimisation *o;
    pm_status status;
} run;

static lbfgsfloatval_t evaluate(void *instance, const lbfgsfloatval_t *x, lbfgsfloatval_t *gradient,
                                const int n, const lbfgsfloatval_t step) {
    (void)n, (void)step;
    const run *r = instance;
    pm_objective_set_weights(r->o->objective, x);
    const double loss = pm_objective_evaluate(r->o->objective, 0, NULL, gradient);
    // A line search that goes too far must see a large number, not a NaN.
    return isfinite(loss) ? loss : 1e300;
}

static int progress(void *instance, const lbfgsfloatval_t *x, const lbfgsfloatval_t *gradient,
                    const lbfgsfloatval_t loss, const lbfgsfloatval_t xnorm,
                    const lbfgsfloatval_t gnorm, const lbfgsfloatval_t step, int n, int k,
                    int evaluations) {
    (void)gradient, (void)xnorm, (void)gnorm, (void)step, (void)k, (void)evaluations;
    run *r = instance;
    memcpy(r->o->theta, x, (size_t)n * sizeof *x);
    ++r->o->done;
    r->status = r->o->report(r->o->context, r->o, loss);
    return r->status != PM_OK;
}

pm_status pm_lbfgs_run(pm_optimisation *optimisation) {
    pm_optimisation *o = optimisation;
    const int n = pm_objective_size(o->objective);
    if (o->done >= o->schedule.iterations || n == 0) {
        return PM_OK;
    }
    lbfgsfloatval_t *x = lbfgs_malloc(n);
    if (x == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for L-BFGS");
    }
    memcpy(x, o->theta, (size_t)n * sizeof *x);
    lbfgs_parameter_t parameter;
    lbfgs_parameter_init(&parameter);
    parameter.m = o->schedule.memory;
    parameter.max_iterations = o->schedule.iterations - o->done;
    parameter.epsilon = 1e-14; // the stage ends by its iterations, or when rounding stops progress
    parameter.max_linesearch = 40;
    // Halving the step works where the loss is not finite; the default interpolation fails there.
    parameter.linesearch = LBFGS_LINESEARCH_BACKTRACKING_STRONG_WOLFE;
    run r = {o, PM_OK};
    // The return value says why it ended, and is ignored: theta holds the best weights so far in
    // any case, and the next stage continues from them.
    lbfgs(n, x, NULL, evaluate, progress, &r, &parameter);
    lbfgs_free(x);
    pm_objective_set_weights(o->objective, o->theta);
    return r.status;
}
