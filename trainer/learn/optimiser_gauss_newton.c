// Levenberg-Marquardt: Gauss-Newton steps with damping scaled by the diagonal (Marquardt, J. SIAM
// 11 (1963) 431), on a fresh random batch of samples each iteration. The data are free of noise, so
// that a batch with several times more residuals than weights is enough. The damped equations are
// solved by a Cholesky factorisation of the matrix, or without a matrix by conjugate gradients.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "learn/damped_equations.h"
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
// A step is undone if the loss of the next batch is this many times that of the batch of the step,
// and this many times its own loss before the step.
#define WILD 10
#define WILD_STIFFEN 64
// The most weights for which the matrix is formed and factorised, and the most residuals of a
// sample: the matrix takes a reverse pass for each of them, and conjugate gradients take about
// three for each of a hundred iterations.
#define MOST_WEIGHTS_OF_MATRIX 4000
#define MOST_RESIDUALS_OF_MATRIX 300

typedef struct solver {
    pm_optimisation *o;
    pm_damped_equations equations;
    int size, batch;
    double *damping;      // lives in the moment of the optimisation, so that a stage can be resumed
    int *index;           // [samples]; its first `batch` entries are the batch
    double *step, *trial; // [size], [2][size]
} solver;

// Moves a fresh random batch to the front of the index, each sample as a random symmetric copy.
static void draw_batch(solver *s, int count) {
    const int copies = pm_objective_symmetry_copies(s->o->objective) / count;
    pm_rng rng;
    pm_rng_init(&rng, s->o->seed, (uint64_t)s->o->done);
    for (int i = 0; i < count; ++i) {
        s->index[i] = i;
    }
    for (int i = 0; i < s->batch; ++i) {
        const int j = i + (int)pm_rng_below(&rng, (uint64_t)(count - i));
        const int kept = s->index[i];
        s->index[i] = s->index[j];
        s->index[j] = kept;
    }
    for (int i = 0; i < s->batch && copies > 1; ++i) {
        s->index[i] += count * (int)pm_rng_below(&rng, (uint64_t)copies);
    }
}

static double loss_at(solver *s, const double *theta) {
    pm_objective_set_weights(s->o->objective, theta);
    return pm_objective_evaluate(s->o->objective, s->batch, s->index, s->trial + s->size);
}

// Stores the loss after a step and the weights before it in the moment of the optimisation, behind
// the damping, for undo_wild_step in the next iteration.
static void keep(solver *s, double loss) {
    if (s->o->schedule.guarded && s->size > 1) {
        s->o->moment[1] = loss;
        memcpy(s->o->moment + s->size, s->o->theta, (size_t)s->size * sizeof(double));
    }
}

// Undoes the last step if the present batch shows that it made the loss much larger.
static void undo_wild_step(solver *s) {
    pm_optimisation *o = s->o;
    const double *before = o->moment + s->size;
    if (!o->schedule.guarded || s->size <= 1 || !(o->moment[1] > 0)) {
        return;
    }
    const double now = loss_at(s, o->theta);
    if (isfinite(now) && now <= WILD * o->moment[1]) {
        return;
    }
    const double then = loss_at(s, before);
    if (isfinite(then) && !(now <= WILD * then)) {
        memcpy(o->theta, before, (size_t)s->size * sizeof(double));
        *s->damping *= WILD_STIFFEN;
    }
}

// Guesses the step from the one before, where it is known.
static void guess_step(solver *s) {
    const pm_optimisation *o = s->o;
    const bool known = o->schedule.guarded && s->size > 1 && o->moment[1] > 0;
    for (int i = 0; i < s->size; ++i) {
        s->step[i] = known ? o->theta[i] - o->moment[s->size + i] : 0;
    }
}

// Tries the step, and without a matrix also shorter ones, because a loss costs far less than
// another solution of the equations. Returns the fraction of the step that lowered the loss to
// *after, with the weights in `trial`, or 0.
static double try_step(solver *s, double before, double *after) {
    const int tries = s->equations.product == NULL ? 1 : MOST_FRACTIONS;
    double fraction = 1;
    for (int k = 0; k < tries; ++k, fraction *= SHORTEN) {
        for (int i = 0; i < s->size; ++i) {
            s->trial[i] = s->o->theta[i] + fraction * s->step[i];
        }
        *after = loss_at(s, s->trial);
        if (*after < before) {
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
    undo_wild_step(s);
    // The robust scale follows the residuals. The losses before and after the step use the same
    // scale.
    loss_at(s, o->theta);
    PM_TRY(pm_objective_rescale(o->objective, s->batch, s->index));
    const double before = loss_at(s, o->theta);
    pm_damped_equations_linearise(&s->equations, s->batch, s->index,
                                  s->o->seed + (uint64_t)s->o->done, before);
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

static pm_status open_solver(solver *s, pm_optimisation *o, bool matrix) {
    const int count = pm_objective_samples(o->objective);
    const size_t n = (size_t)pm_objective_size(o->objective);
    *s = (solver){.o = o, .size = (int)n, .damping = o->moment};
    if (*s->damping == 0) {
        *s->damping = FIRST_DAMPING;
    }
    s->batch = o->schedule.batch < count ? o->schedule.batch : count;
    s->index = malloc((size_t)count * sizeof *s->index);
    s->step = malloc(n * sizeof *s->step);
    s->trial =
        malloc(2 * n * sizeof *s->trial); // the second half receives gradients that are not used
    if (s->index == NULL || s->step == NULL || s->trial == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for Gauss-Newton with %zu weights", n);
    }
    return pm_damped_equations_open(&s->equations, o->objective, matrix);
}

static void close_solver(solver *s) {
    pm_damped_equations_close(&s->equations);
    free(s->index);
    free(s->step);
    free(s->trial);
}

static pm_status run(pm_optimisation *o, bool matrix) {
    if (pm_objective_size(o->objective) == 0) {
        return PM_OK;
    }
    solver s;
    pm_status status = open_solver(&s, o, matrix);
    while (status == PM_OK && o->done < o->schedule.iterations) {
        draw_batch(&s, pm_objective_samples(o->objective));
        double loss = 0;
        status = iterate(&s, &loss);
        if (status != PM_OK) {
            break;
        }
        ++o->done;
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
