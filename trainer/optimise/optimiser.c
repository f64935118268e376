// The optimisers and their table.
#include "optimise/optimiser.h"

#include <lbfgs.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "data/trained.h"
#include "optimise/importance.h"
#include "optimise/levenberg_marquardt.h"
#include "optimise/normal_equations.h"

// --- adam: on shuffled batches (Kingma, Ba, Adam: a method for stochastic optimization, ICLR
// 2015), with a learning rate that falls along a cosine, and with decay of the weights apart from
// the gradient (Loshchilov, Hutter, ICLR 2019) ---

#define BETA1 0.9
#define EPSILON 1e-8

// Fills index [count] with all samples in random order.
static void shuffle(int *index, int count, uint64_t seed, int epoch) {
    pm_rng rng;
    pm_rng_init(&rng, seed, (uint64_t)epoch);
    for (int i = 0; i < count; ++i) {
        index[i] = i;
    }
    for (int i = count - 1; i > 0; --i) {
        const int j = (int)pm_rng_below(&rng, (uint64_t)i + 1);
        const int kept = index[i];
        index[i] = index[j];
        index[j] = kept;
    }
}

static void update(pm_optimisation *o, const double *gradient, double rate, long t) {
    const int n = pm_objective_size(o->objective);
    double *first = o->moment, *second = o->moment + n;
    const double unbias1 = 1 / (1 - pow(BETA1, (double)t)),
                 unbias2 = 1 / (1 - pow(o->schedule.beta2, (double)t));
    for (int i = 0; i < n; ++i) {
        first[i] = BETA1 * first[i] + (1 - BETA1) * gradient[i];
        second[i] =
            o->schedule.beta2 * second[i] + (1 - o->schedule.beta2) * gradient[i] * gradient[i];
        o->theta[i] -= rate * (first[i] * unbias1 / (sqrt(second[i] * unbias2) + EPSILON) +
                               o->schedule.decay * o->theta[i]);
    }
    pm_objective_set_weights(o->objective, o->theta);
}

// Runs the batches of the epoch that are left, and returns the mean loss over the whole epoch.
static pm_status run_epoch(pm_optimisation *o, int count, int *index, double *gradient,
                           double *loss) {
    const pm_schedule *s = &o->schedule;
    const int batches = (count + s->batch - 1) / s->batch;
    shuffle(index, count, o->seed, o->done);
    while (o->batches < batches) {
        const int first = o->batches * s->batch;
        const int size = count - first < s->batch ? count - first : s->batch;
        o->loss += size * pm_objective_evaluate(o->objective, size, index + first, gradient);
        const long t = (long)o->done * batches + ++o->batches;
        // The learning rate falls as a half cosine on a logarithmic scale.
        const double fraction = (double)t / ((double)s->iterations * batches);
        const double weight = 0.5 * (1 + cos(3.141592653589793 * fraction));
        const double rate = exp(weight * log(s->first_rate) + (1 - weight) * log(s->last_rate));
        update(o, gradient, rate, t);
        if (o->batches < batches) {
            PM_TRY(o->report(o->context, o, o->loss / (first + size)));
        }
    }
    *loss = o->loss / count;
    o->loss = 0;
    o->batches = 0;
    ++o->done;
    return PM_OK;
}

static pm_status run_adam(pm_optimisation *o) {
    const int count = pm_objective_samples(o->objective);
    int *index = malloc((size_t)count * sizeof *index);
    double *gradient = malloc(((size_t)pm_objective_size(o->objective) + 1) * sizeof *gradient);
    pm_status status = PM_OK;
    if (index == NULL || gradient == NULL) {
        PM_TRY_DONE(pm_fail(PM_ENOMEM, "out of memory for adam"));
    }
    while (o->done < o->schedule.iterations) {
        double loss = 0;
        PM_TRY_DONE(run_epoch(o, count, index, gradient, &loss));
        if (!isfinite(loss)) {
            PM_TRY_DONE(pm_fail(PM_ENUMERIC,
                                "adam: the loss became %g in epoch %d: try a smaller rate", loss,
                                o->done));
        }
        PM_TRY_DONE(o->report(o->context, o, loss));
    }
done:
    free(index);
    free(gradient);
    return status;
}

// --- lbfgs: by libLBFGS (Liu, Nocedal, Math. Program. 45 (1989) 503) on all samples at once. After
// an interruption it resumes with an empty memory ---

typedef struct lbfgs_run {
    pm_optimisation *o;
    pm_status status;
} lbfgs_run;

static lbfgsfloatval_t evaluate_lbfgs(void *instance, const lbfgsfloatval_t *x,
                                      lbfgsfloatval_t *gradient, const int n,
                                      const lbfgsfloatval_t step) {
    (void)n, (void)step;
    const lbfgs_run *r = instance;
    pm_objective_set_weights(r->o->objective, x);
    const double loss = pm_objective_evaluate(r->o->objective, 0, NULL, gradient);
    // A line search that goes too far must see a large number, not a NaN.
    return isfinite(loss) ? loss : 1e300;
}

static int report_lbfgs(void *instance, const lbfgsfloatval_t *x, const lbfgsfloatval_t *gradient,
                        const lbfgsfloatval_t loss, const lbfgsfloatval_t xnorm,
                        const lbfgsfloatval_t gnorm, const lbfgsfloatval_t step, int n, int k,
                        int evaluations) {
    (void)gradient, (void)xnorm, (void)gnorm, (void)step, (void)k, (void)evaluations;
    lbfgs_run *r = instance;
    memcpy(r->o->theta, x, (size_t)n * sizeof *x);
    ++r->o->done;
    r->status = r->o->report(r->o->context, r->o, loss);
    return r->status != PM_OK;
}

static pm_status run_lbfgs(pm_optimisation *o) {
    const int n = pm_objective_size(o->objective);
    if (o->done >= o->schedule.iterations || n == 0) {
        return PM_OK;
    }
    lbfgsfloatval_t *x = lbfgs_malloc(n);
    PM_TRY(pm_allocated(x, "L-BFGS"));
    memcpy(x, o->theta, (size_t)n * sizeof *x);
    lbfgs_parameter_t parameter;
    lbfgs_parameter_init(&parameter);
    parameter.m = o->schedule.memory;
    parameter.max_iterations = o->schedule.iterations - o->done;
    parameter.epsilon = 1e-14; // the stage ends by its iterations, or when rounding stops progress
    parameter.max_linesearch = 40;
    // Halving the step works where the loss is not finite; the default interpolation fails there.
    parameter.linesearch = LBFGS_LINESEARCH_BACKTRACKING_STRONG_WOLFE;
    lbfgs_run r = {o, PM_OK};
    // The return value says why it ended, and is ignored: theta holds the best weights so far in
    // any case, and the next stage continues from them.
    lbfgs(n, x, NULL, evaluate_lbfgs, report_lbfgs, &r, &parameter);
    lbfgs_free(x);
    pm_objective_set_weights(o->objective, o->theta);
    return r.status;
}

// --- gauss_newton and gauss_newton_cg: Gauss-Newton steps with damping scaled by the diagonal
// (Marquardt, J. SIAM 11 (1963) 431), on a fresh random batch of samples each iteration. The data
// are free of noise, so that a batch with several times more residuals than weights is enough. The
// damped equations are solved by a Cholesky factorisation of the matrix where it is small, or
// without a matrix by conjugate gradients, for any number of weights (Martens, ICML 2010) ---

static const pm_damping damping_of_weights = {
    .first = 1e-2, .smallest = 1e-12, .largest = 1e8, .relax = 0.3, .stiffen = 4};

#define FIRST_EFFORT 10
#define MORE_EFFORT 3
#define MOST_FRACTIONS 4
#define SHORTEN 0.3
// A guarded step must lower the loss of this many times as many samples as are in the batch.
#define CHECKED 4
// A guarded step also has the damping NEARNESS times the loss, in the units of the weights: a step
// of length 1 must be worth this fraction of the loss. Directions that hardly change the residuals
// would otherwise be taken as far as the equations allow. With a damping in proportion to the loss
// the convergence stays quadratic, also where the matrix is singular (Yamashita, Fukushima,
// Computing Suppl. 15 (2001) 239).
#define NEARNESS 1e-4
// In a guarded run the weights of hidden layers have a penalty of SHRINKAGE/4 times the loss times
// the sum of their fourth powers (optimise/normal_equations.h). Data that determine such a weight
// at all do so much more strongly. Windows of several steps have no penalty: their loss does not
// fall below the noise of all their states, and the penalty would not disappear.
#define SHRINKAGE 1e-2
// No weight moves by more than this in a guarded step. A longer step may end where a hidden unit is
// saturated or an exponential has vanished, from where no gradient leads back.
#define LONGEST 1.0
// A guarded run settles when this number of iterations has not lowered the loss by this factor.
// A thorough run then accelerates its steps, and its batch grows by GROWTH until it has settled on
// all samples. Far from a minimum the acceleration misleads.
#define PATIENCE 10
#define PROGRESS 0.98
#define GROWTH 4
// Places in the moment: of the loss that PATIENCE compares with, of the robust scale D^2 at the
// time of that loss, and of the number of times that the batch has grown.
#define SETTLED 2
#define SETTLED_SCALE 3
#define GROWN 4
// The most weights, and the most residuals of a sample, for which the matrix is formed. It takes a
// reverse pass for each residual. Conjugate gradients take about three hundred passes instead.
#define MOST_WEIGHTS_OF_MATRIX 4000
#define MOST_RESIDUALS_OF_MATRIX 300

typedef struct solver {
    pm_arena arena; // owns the arrays
    pm_optimisation *o;
    pm_damped_equations equations;
    int size, batch, checked;
    bool settled;
    // [samples]; the first `checked` entries judge steps, and the batch is chosen among them
    int *index;
    // The samples of the matrix and their number. A guarded run chooses them among the checked
    // ones, with these chances [samples] and importances [samples] (optimise/importance.h).
    int *chosen, nchosen; // [samples + 1]
    double *chance, *importance;
    bool *frozen;         // [size] weights that stay as they are
    double *step, *trial; // [size]
} solver;

static double loss_at(solver *s, const double *theta) {
    pm_objective_set_weights(s->o->objective, theta);
    return pm_objective_evaluate(s->o->objective, s->checked, s->index, NULL);
}

// Chooses the samples of the matrix among the checked ones, which have just been evaluated.
static void choose_batch(solver *s) {
    const pm_optimisation *o = s->o;
    s->nchosen = s->batch;
    pm_objective_set_importance(o->objective, NULL);
    if (s->batch == s->checked) {
        memcpy(s->chosen, s->index, (size_t)s->batch * sizeof *s->chosen);
        return;
    }
    pm_rng rng;
    pm_rng_init(&rng, o->seed + 1, (uint64_t)o->done);
    for (int i = 0; i < s->checked; ++i) {
        s->chance[i] = pm_objective_sample_share(o->objective, s->index[i]);
    }
    pm_importance_chances(s->checked, s->chance, s->batch);
    s->nchosen =
        pm_importance_choose(s->checked, s->chance, s->batch, pm_rng_uniform(&rng), s->chosen);
    const int count = pm_objective_samples(o->objective);
    for (int i = 0; i < s->nchosen; ++i) {
        const int sample = s->index[s->chosen[i]];
        s->importance[sample % count] = s->nchosen / (s->checked * s->chance[s->chosen[i]]);
        s->chosen[i] = sample;
    }
    pm_objective_set_importance(o->objective, s->importance);
}

// Tries the step, and without a matrix also shorter ones, because a loss costs far less than
// another solution of the equations. Fractions are relative to the longest step in which no weight
// moves too far. The weights after the step are in `trial`.
static pm_status try_step(void *context, double before, double *after, double *fraction) {
    solver *s = context;
    const pm_damped_equations *e = &s->equations;
    const int tries = e->hessian != NULL ? 1 : MOST_FRACTIONS;
    double longest = 0;
    for (int i = 0; i < s->size && s->o->schedule.guarded; ++i) {
        longest = fmax(longest, fabs(s->step[i]));
    }
    const double allowed = longest > LONGEST ? LONGEST / longest : 1;
    *fraction = 1;
    for (int k = 0; k < tries; ++k, *fraction *= SHORTEN) {
        for (int i = 0; i < s->size; ++i) {
            s->trial[i] = s->o->theta[i] + allowed * *fraction * s->step[i];
        }
        *after = loss_at(s, s->trial);
        if (*after + pm_damped_equations_penalty(e, s->trial) <
            before + pm_damped_equations_penalty(e, s->o->theta)) {
            return PM_OK;
        }
    }
    *fraction = 0;
    return PM_OK;
}

// The number of conjugate gradients grows during a stage: far from a minimum the loss differs from
// its quadratic model, and many cheap steps get further than few exact ones. On a black box of
// 11,152 weights 10 reached the loss in 4 s for which 100 took 16 s.
static bool solve(void *context, double damping) {
    solver *s = context;
    const int most = FIRST_EFFORT + s->o->done * MORE_EFFORT;
    return pm_damped_equations_solve(
        &s->equations, s->o->theta, damping,
        most < PM_MOST_CONJUGATE_GRADIENTS ? most : PM_MOST_CONJUGATE_GRADIENTS, s->step);
}

// Linearises the loss of a fresh batch.
static pm_status linearise(void *context, double *loss) {
    solver *s = context;
    pm_optimisation *o = s->o;
    // Moves a fresh random batch to the front of the index, and behind it further samples that
    // judge its step.
    const int count = pm_objective_samples(o->objective);
    pm_rng rng;
    pm_rng_init(&rng, s->o->seed, (uint64_t)s->o->done);
    for (int i = 0; i < count; ++i) {
        s->index[i] = i;
    }
    for (int i = 0; i < s->checked; ++i) {
        const int j = i + (int)pm_rng_below(&rng, (uint64_t)(count - i));
        const int kept = s->index[i];
        s->index[i] = s->index[j];
        s->index[j] = kept;
    }
    // The robust scale follows the residuals. The losses before and after the step use the same
    // scale.
    loss_at(s, o->theta);
    PM_TRY(pm_objective_rescale(o->objective, s->checked, s->index));
    const double before = loss_at(s, o->theta);
    choose_batch(s);
    const bool shrinks = o->schedule.guarded && !o->schedule.early &&
                         pm_objective_context(o->objective).samples->unroll == 1;
    s->equations.shrinkage = shrinks ? SHRINKAGE * before : 0;
    pm_damped_equations_linearise(&s->equations, s->nchosen, s->chosen,
                                  s->o->seed + (uint64_t)s->o->done, before, o->theta);
    s->equations.near = o->schedule.guarded ? NEARNESS * before : 0;
    s->equations.accelerates = o->schedule.thorough && s->size > GROWN && o->moment[GROWN] > 0;
    // Guesses the step from the one before, where it is known.
    const bool known = o->schedule.guarded && s->size > 1 && o->moment[1] > 0;
    for (int i = 0; i < s->size; ++i) {
        s->step[i] = known && !s->frozen[i] ? o->theta[i] - o->moment[s->size + i] : 0;
    }
    *loss = before;
    return PM_OK;
}

// Whether the last PATIENCE iterations were in vain: neither the loss has fallen nor, with a robust
// loss, the median of the residuals. The loss of a few samples with large residuals varies from
// batch to batch while the others still improve. The values before these iterations are stored in
// the moment of the optimisation, behind the damping.
static bool is_settled(const solver *s, double loss) {
    pm_optimisation *o = s->o;
    if (!o->schedule.guarded || s->size <= GROWN || o->done % PATIENCE != 0) {
        return false;
    }
    const double before = o->moment[SETTLED], scale_before = o->moment[SETTLED_SCALE];
    const double scale = pm_objective_robust_square(o->objective);
    o->moment[SETTLED] = loss;
    o->moment[SETTLED_SCALE] = scale;
    return before > 0 && loss > PROGRESS * before && scale >= PROGRESS * scale_before;
}

// Sets the sizes of the batch and of what judges its steps.
static void set_batch(solver *s) {
    const pm_optimisation *o = s->o;
    const int count = pm_objective_samples(o->objective);
    const bool grows = o->schedule.thorough && s->size > GROWN;
    const double batch = o->schedule.batch * pow(GROWTH, grows ? o->moment[GROWN] : 0);
    s->batch = batch < count ? (int)batch : count;
    s->checked = !o->schedule.guarded         ? s->batch
                 : s->batch < count / CHECKED ? CHECKED * s->batch
                                              : count;
}

static pm_status finish(void *context, double before, double loss, bool moved) {
    (void)before;
    solver *s = context;
    pm_optimisation *o = s->o;
    if (!moved) {
        pm_objective_set_weights(o->objective, o->theta);
    } else {
        if (o->schedule.guarded && s->size > 1) { // for the guess of the next step
            o->moment[1] = loss;
            memcpy(o->moment + s->size, o->theta, (size_t)s->size * sizeof *o->theta);
        }
        memcpy(o->theta, s->trial, (size_t)s->size * sizeof *o->theta);
    }
    ++o->done;
    s->settled = is_settled(s, loss);
    const bool all = s->batch == pm_objective_samples(o->objective);
    if (s->settled && o->schedule.thorough && (!all || o->moment[GROWN] == 0)) {
        ++o->moment[GROWN];
        o->moment[SETTLED] = 0;
        s->settled = false;
        set_batch(s);
    }
    return isfinite(loss) ? o->report(o->context, o, loss)
                          : pm_fail(PM_ENUMERIC, "gauss_newton: the loss became %g", loss);
}

static bool is_over(void *context) {
    const solver *s = context;
    return s->settled || s->o->done >= s->o->schedule.iterations;
}

static pm_status open_solver(solver *s, pm_optimisation *o, bool matrix) {
    const int count = pm_objective_samples(o->objective);
    const size_t n = (size_t)pm_objective_size(o->objective);
    *s = (solver){.o = o, .size = (int)n};
    set_batch(s);
    const int most = o->schedule.thorough ? count : s->checked;
    const pm_system *system = pm_objective_context(o->objective).system;
    const int nentry = pm_trained_list(system, NULL);
    s->index = pm_arena_array(&s->arena, (size_t)count, sizeof *s->index);
    s->chosen = pm_arena_array(&s->arena, (size_t)most + 1, sizeof *s->chosen);
    s->chance = pm_arena_array(&s->arena, (size_t)count, sizeof *s->chance);
    s->importance = pm_arena_array(&s->arena, (size_t)count, sizeof *s->importance);
    s->step = pm_arena_array(&s->arena, n, sizeof *s->step);
    s->trial = pm_arena_array(&s->arena, n, sizeof *s->trial);
    s->frozen = pm_arena_array(&s->arena, n, sizeof *s->frozen);
    pm_trained *entry = pm_arena_array(&s->arena, (size_t)nentry, sizeof *entry);
    PM_TRY(pm_arena_status(&s->arena, "Gauss-Newton with %zu weights", n));
    // Marks the weights that an early run leaves as they are.
    pm_trained_list(system, entry);
    for (int i = 0; i < nentry; ++i) {
        for (int k = entry[i].first; k < entry[i].first + entry[i].size; ++k) {
            s->frozen[k] =
                o->schedule.early != PM_AT_ONCE && entry[i].entry->late >= o->schedule.early;
        }
    }
    PM_TRY(pm_damped_equations_open(&s->equations, o->objective, o->schedule.thorough ? most : 0,
                                    matrix, s->frozen));
    return PM_OK;
}

static pm_status run_least_squares(pm_optimisation *o, bool matrix) {
    if (pm_objective_size(o->objective) == 0) {
        return PM_OK;
    }
    solver s;
    pm_status status = open_solver(&s, o, matrix);
    if (status == PM_OK) {
        // The damping lives in the moment of the optimisation, so that a stage can be resumed.
        status = pm_levenberg_marquardt(
            &(pm_levenberg_marquardt_problem){is_over, linearise, solve, try_step, finish, &s},
            &damping_of_weights, o->moment);
    }
    pm_objective_set_weights(o->objective, o->theta);
    pm_objective_set_importance(o->objective, NULL);
    pm_damped_equations_close(&s.equations);
    pm_arena_free(&s.arena);
    return status;
}

static pm_status run_gauss_newton(pm_optimisation *o) {
    return run_least_squares(o, pm_objective_size(o->objective) <= MOST_WEIGHTS_OF_MATRIX &&
                                    pm_objective_residual_count(o->objective) <=
                                        MOST_RESIDUALS_OF_MATRIX);
}

static pm_status run_gauss_newton_cg(pm_optimisation *o) {
    return run_least_squares(o, false);
}

// --- the table ---

static const pm_optimiser optimisers[] = {
    {"adam", run_adam, false},
    {"lbfgs", run_lbfgs, false},
    {"gauss_newton", run_gauss_newton, true},
    {"gauss_newton_cg", run_gauss_newton_cg, true},
};

const pm_optimiser *pm_optimiser_find(const char *name) {
    for (size_t i = 0; i < sizeof optimisers / sizeof *optimisers; ++i) {
        if (strcmp(optimisers[i].name, name) == 0) {
            return &optimisers[i];
        }
    }
    return NULL;
}

const char *pm_optimiser_names(void) {
    return "adam, lbfgs, gauss_newton, gauss_newton_cg";
}
