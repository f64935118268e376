// Levenberg-Marquardt: Gauss-Newton steps with damping scaled by the diagonal (Marquardt, J. SIAM
// 11 (1963) 431), on a fresh random batch of samples each iteration. The data are free of noise, so
// that a batch with several times more residuals than weights is enough. The damped equations are
// solved by a Cholesky factorisation of the matrix, or without a matrix by conjugate gradients.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "learn/damped_equations.h"
#include "learn/importance.h"
#include "learn/optimiser_table.h"
#include "learn/residuals.h"

#define FIRST_DAMPING 1e-2
#define SMALLEST_DAMPING 1e-12
#define LARGEST_DAMPING 1e8
#define RELAX 0.3 // factor of the damping after a step that lowered the loss
#define STIFFEN 4 // and after one that did not
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
// the sum of their fourth powers (learn/damped_equations.h). Data that determine such a weight at
// all do so much more strongly. Windows of several steps have no penalty: their loss does not fall
// below the noise of all their states, and the penalty would not disappear.
#define SHRINKAGE 1e-2
// No weight moves by more than this in a guarded step. A longer step may end where a hidden unit is
// saturated or an exponential has vanished, from where no gradient leads back.
#define LONGEST 1.0
// A guarded run ends when this number of iterations has not lowered the loss by this factor.
#define PATIENCE 10
#define PROGRESS 0.98
// Where the moment holds that loss, and the robust scale D^2 at that time.
#define SETTLED 2
#define SETTLED_SCALE 3
// The most weights for which the matrix is formed and factorised, and the most residuals of a
// sample: the matrix takes a reverse pass for each of them, and conjugate gradients take about
// three for each of a hundred iterations.
#define MOST_WEIGHTS_OF_MATRIX 4000
#define MOST_RESIDUALS_OF_MATRIX 300

typedef struct solver {
    pm_optimisation *o;
    pm_damped_equations equations;
    int size, batch, checked;
    double *damping; // lives in the moment of the optimisation, so that a stage can be resumed
    // [samples]; the first `checked` entries judge steps, and the batch is chosen among them
    int *index;
    // The samples of the matrix and their number. A guarded run chooses them among the checked
    // ones, with these chances [samples] and importances [samples] (learn/importance.h).
    int *chosen, nchosen; // [batch + 1]
    double *chance, *importance;
    bool *frozen;         // [size] weights that stay as they are
    double *step, *trial; // [size]
} solver;

// Moves a fresh random batch to the front of the index, and behind it further samples that judge
// its step.
static void draw_batch(solver *s, int count) {
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
}

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

// Stores the loss after a step and the weights before it in the moment of the optimisation, behind
// the damping, for guess_step in the next iteration.
static void keep(solver *s, double loss) {
    if (s->o->schedule.guarded && s->size > 1) {
        s->o->moment[1] = loss;
        memcpy(s->o->moment + s->size, s->o->theta, (size_t)s->size * sizeof(double));
    }
}

// Guesses the step from the one before, where it is known.
static void guess_step(solver *s) {
    const pm_optimisation *o = s->o;
    const bool known = o->schedule.guarded && s->size > 1 && o->moment[1] > 0;
    for (int i = 0; i < s->size; ++i) {
        s->step[i] = known && !s->frozen[i] ? o->theta[i] - o->moment[s->size + i] : 0;
    }
}

// The factor of a step after which no weight moves too far.
static double shorten(const solver *s) {
    double longest = 0;
    for (int i = 0; i < s->size && s->o->schedule.guarded; ++i) {
        longest = fmax(longest, fabs(s->step[i]));
    }
    return longest > LONGEST ? LONGEST / longest : 1;
}

// Tries the step, and without a matrix also shorter ones, because a loss costs far less than
// another solution of the equations. Returns the fraction of the step that lowered the loss to
// *after, relative to the longest one allowed, with the weights in `trial`, or 0.
static double try_step(solver *s, double before, double *after) {
    const int tries = s->equations.product == NULL ? 1 : MOST_FRACTIONS;
    const double allowed = shorten(s);
    double fraction = 1;
    for (int k = 0; k < tries; ++k, fraction *= SHORTEN) {
        for (int i = 0; i < s->size; ++i) {
            s->trial[i] = s->o->theta[i] + allowed * fraction * s->step[i];
        }
        *after = loss_at(s, s->trial);
        const pm_damped_equations *e = &s->equations;
        if (*after + pm_damped_equations_penalty(e, s->trial) <
            before + pm_damped_equations_penalty(e, s->o->theta)) {
            return fraction;
        }
    }
    return 0;
}

// The number of conjugate gradients grows during a stage: far from a minimum the loss differs from
// its quadratic model, and many cheap steps get further than few exact ones. On a black box of
// 11,152 weights 10 reached the loss in 4 s for which 100 took 16 s.
static int effort(const solver *s) {
    const int most = FIRST_EFFORT + s->o->done * MORE_EFFORT;
    return most < PM_MOST_CONJUGATE_GRADIENTS ? most : PM_MOST_CONJUGATE_GRADIENTS;
}

// One iteration: tries steps with increasing damping until one lowers the loss of the batch.
static pm_status iterate(solver *s, double *loss) {
    pm_optimisation *o = s->o;
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
    guess_step(s);
    while (*s->damping < LARGEST_DAMPING) {
        if (pm_damped_equations_solve(&s->equations, o->theta, *s->damping, effort(s), s->step)) {
            double after = 0;
            const double fraction = try_step(s, before, &after);
            if (fraction > 0) {
                keep(s, after);
                memcpy(o->theta, s->trial, (size_t)s->size * sizeof *o->theta);
                *s->damping = fraction == 1 ? fmax(*s->damping * RELAX, SMALLEST_DAMPING)
                                            : *s->damping * STIFFEN;
                *loss = after;
                return PM_OK;
            }
        }
        *s->damping *= STIFFEN;
    }
    pm_objective_set_weights(o->objective, o->theta);
    *s->damping = FIRST_DAMPING;
    *loss = before;
    return PM_OK;
}

// Whether the last PATIENCE iterations were in vain: neither the loss has fallen nor, with a robust
// loss, the median of the residuals. The loss of a few samples with large residuals varies from
// batch to batch while the others still improve. The values before these iterations are stored in
// the moment of the optimisation, behind the damping.
static bool is_settled(const solver *s, double loss) {
    pm_optimisation *o = s->o;
    if (!o->schedule.guarded || s->size <= SETTLED_SCALE || o->done % PATIENCE != 0) {
        return false;
    }
    const double before = o->moment[SETTLED], scale_before = o->moment[SETTLED_SCALE];
    const double scale = pm_objective_robust_square(o->objective);
    o->moment[SETTLED] = loss;
    o->moment[SETTLED_SCALE] = scale;
    return before > 0 && loss > PROGRESS * before && scale >= PROGRESS * scale_before;
}

// Marks the weights that an early run leaves as they are.
static void mark_frozen(solver *s) {
    pm_system *system = pm_objective_context(s->o->objective).system;
    bool *frozen = s->frozen;
    for (int i = 0; i < pm_system_components(system); ++i) {
        const pm_params *params = pm_system_params(system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            for (int c = 0; entry->trained && c < entry->rows * entry->cols; ++c) {
                *frozen++ = entry->late && s->o->schedule.early;
            }
        }
    }
}

static pm_status open_solver(solver *s, pm_optimisation *o, bool matrix) {
    const int count = pm_objective_samples(o->objective);
    const size_t n = (size_t)pm_objective_size(o->objective);
    *s = (solver){.o = o, .size = (int)n, .damping = o->moment};
    if (*s->damping == 0) {
        *s->damping = FIRST_DAMPING;
    }
    s->batch = o->schedule.batch < count ? o->schedule.batch : count;
    s->checked = !o->schedule.guarded         ? s->batch
                 : s->batch < count / CHECKED ? CHECKED * s->batch
                                              : count;
    s->index = malloc((size_t)count * sizeof *s->index);
    s->chosen = malloc((size_t)(s->batch + 1) * sizeof *s->chosen);
    s->chance = malloc((size_t)count * sizeof *s->chance);
    s->importance = malloc((size_t)count * sizeof *s->importance);
    s->step = malloc(n * sizeof *s->step);
    s->trial = malloc(n * sizeof *s->trial);
    s->frozen = malloc(n * sizeof *s->frozen);
    if (s->index == NULL || s->chosen == NULL || s->chance == NULL || s->importance == NULL ||
        s->frozen == NULL || s->step == NULL || s->trial == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for Gauss-Newton with %zu weights", n);
    }
    mark_frozen(s);
    PM_TRY(pm_damped_equations_open(&s->equations, o->objective, matrix));
    s->equations.frozen = s->frozen;
    return PM_OK;
}

static void close_solver(solver *s) {
    pm_damped_equations_close(&s->equations);
    pm_objective_set_importance(s->o->objective, NULL);
    free(s->index);
    free(s->chosen);
    free(s->chance);
    free(s->importance);
    free(s->frozen);
    free(s->step);
    free(s->trial);
}

static pm_status run(pm_optimisation *o, bool matrix) {
    if (pm_objective_size(o->objective) == 0) {
        return PM_OK;
    }
    solver s;
    pm_status status = open_solver(&s, o, matrix);
    bool settled = false;
    while (status == PM_OK && o->done < o->schedule.iterations && !settled) {
        draw_batch(&s, pm_objective_samples(o->objective));
        double loss = 0;
        status = iterate(&s, &loss);
        if (status != PM_OK) {
            break;
        }
        ++o->done;
        settled = is_settled(&s, loss);
        status = isfinite(loss) ? o->report(o->context, o, loss)
                                : pm_fail(PM_ENUMERIC, "gauss_newton: the loss became %g", loss);
    }
    pm_objective_set_weights(o->objective, o->theta);
    close_solver(&s);
    return status;
}

pm_status pm_gauss_newton_run(pm_optimisation *optimisation) {
    const pm_objective *objective = optimisation->objective;
    return run(optimisation, pm_objective_size(objective) <= MOST_WEIGHTS_OF_MATRIX &&
                                 pm_residuals_count(objective) <= MOST_RESIDUALS_OF_MATRIX);
}

pm_status pm_gauss_newton_cg_run(pm_optimisation *optimisation) {
    return run(optimisation, false);
}
