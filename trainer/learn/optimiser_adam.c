// Adam on shuffled batches (Kingma, Ba, ICLR 2015), with a learning rate that falls along a cosine,
// and with decay of the weights apart from the gradient (Loshchilov, Hutter, ICLR 2019).
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "learn/optimiser_table.h"

#define BETA1 0.9
#define EPSILON 1e-8

// Returns the learning rate after a fraction of the stage: a half cosine on a logarithmic scale.
static double rate_at(const pm_schedule *s, double fraction) {
    const double weight = 0.5 * (1 + cos(3.141592653589793 * fraction));
    return exp(weight * log(s->first_rate) + (1 - weight) * log(s->last_rate));
}

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
        update(o, gradient, rate_at(s, (double)t / ((double)s->iterations * batches)), t);
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

pm_status pm_adam_run(pm_optimisation *optimisation) {
    pm_optimisation *o = optimisation;
    const int count = pm_objective_samples(o->objective);
    int *index = malloc((size_t)count * sizeof *index);
    double *gradient = malloc(((size_t)pm_objective_size(o->objective) + 1) * sizeof *gradient);
    pm_status status = PM_OK;
    if (index == NULL || gradient == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for adam");
        goto done;
    }
    while (o->done < o->schedule.iterations) {
        double loss = 0;
        PM_TRY_DONE(run_epoch(o, count, index, gradient, &loss));
        if (!isfinite(loss)) {
            status =
                pm_fail(PM_ENUMERIC, "adam: the loss became %g in epoch %d: try a smaller rate",
                        loss, o->done);
            goto done;
        }
        PM_TRY_DONE(o->report(o->context, o, loss));
    }
done:
    free(index);
    free(gradient);
    return status;
}
