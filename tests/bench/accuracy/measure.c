// Computes rollouts with evaluate/evaluate.h, one-step residuals with loss/objective.h, and
// energy, momentum and entropy with the simulator.
#include "measure.h"

#include <math.h>
#include <stdlib.h>

#include "evaluate/evaluate.h"
#include "evaluate/evaluate_plot.h"
#include "fit/training.h"
#include "sim/score.h"

#define THREADS 2
// J/K; the entropies are of order 1 and summed over 1600 integrator steps: beyond rounding.
#define SMALLEST_FALL 1e-13

static const double fractions[STUDY_TIMES] = {0.1, 0.25, 0.5, 1};

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for a score");
}

// --- laws ---

// Of one predicted trajectory: how far energy and momentum stray, and steps on which entropy falls.
typedef struct account {
    double energy, momentum, fall;
    long falls, steps;
} account;

static account take_account(const pm_truth_model *model, int reached, const double *z) {
    double start[PM_TRUTH_MAX_CONSERVED], value[PM_TRUTH_MAX_CONSERVED];
    account a = {.steps = reached - 1};
    model->conserve(model->ode.data, z, start);
    double before = model->entropy(model->ode.data, z);
    for (int i = 1; i < reached; ++i) {
        z += model->ode.nz;
        model->conserve(model->ode.data, z, value);
        a.energy = fmax(a.energy, fabs(value[0] - start[0]));
        if (model->nconserved > 1) {
            a.momentum = fmax(a.momentum, fabs(value[1] - start[1]));
        }
        const double entropy = model->entropy(model->ode.data, z);
        a.falls += entropy < before - SMALLEST_FALL;
        a.fall = fmax(a.fall, before - entropy);
        before = entropy;
    }
    return a;
}

// Returns the median and the largest of `value` [count], which become sorted.
static void take_extremes(int count, double *value, double *median, double *worst) {
    *median = pm_box_of(count, value).median;
    *worst = value[count - 1];
}

static pm_status measure_laws(const pm_evaluation *e, const pm_truth *truth, study_laws *laws) {
    const bool has_energy = pm_system_without_energy(e->system) < 0;
    double *energy = calloc(3 * (size_t)e->count, sizeof *energy);
    if (energy == NULL) {
        return no_memory();
    }
    double *momentum = energy + e->count, *own = momentum + e->count;
    long falls = 0, steps = 0;
    *laws = (study_laws){.fall = 0};
    for (int i = 0; i < e->count; ++i) {
        const account a = take_account(&truth->model, e->rollout[i].reached,
                                       pm_dataset_state(e->predicted, i, 0));
        energy[i] = a.energy;
        momentum[i] = a.momentum;
        own[i] = has_energy ? e->rollout[i].ledger.energy_drift : NAN;
        falls += a.falls;
        steps += a.steps;
        laws->fall = fmax(laws->fall, a.fall);
    }
    take_extremes(e->count, energy, &laws->energy_median, &laws->energy_worst);
    take_extremes(e->count, momentum, &laws->momentum_median, &laws->momentum_worst);
    take_extremes(e->count, own, &laws->own_median, &laws->own_worst);
    laws->falls = steps > 0 ? (double)falls / (double)steps : 0;
    free(energy);
    return PM_OK;
}

// --- errors ---

// The rollouts cut after a part of their length. error [STUDY_GROUPS][count] is work space.
static void measure_growth(const pm_evaluation *e, int k, double *error, study_score *score) {
    const int last = (int)lround(fractions[k] * (e->truth->ntime - 1));
    double one[STUDY_GROUPS];
    score->time[k] = e->truth->t[last] - e->truth->t[0];
    for (int i = 0; i < e->count; ++i) {
        pm_score(&e->columns, last + 1, e->truth->ncolumn, pm_dataset_state(e->predicted, i, 0),
                 pm_dataset_state(e->truth, e->rollout[i].trajectory, 0), one, NULL);
        for (int g = 0; g < STUDY_GROUPS; ++g) {
            error[g * e->count + i] = e->rollout[i].reached > last ? one[g] : INFINITY;
        }
    }
    for (int g = 0; g < STUDY_GROUPS; ++g) {
        score->growth[k][g] = pm_box_of(e->count, error + g * e->count).median;
    }
}

static pm_status measure_rollouts(const pm_evaluation *e, const pm_truth *truth,
                                  study_score *score) {
    if (e->columns.ngroup != STUDY_GROUPS) {
        return pm_fail(PM_ECONFIG, "%s: %d groups of variables, expected %d",
                       e->system->scene->path, e->columns.ngroup, STUDY_GROUPS);
    }
    double *error = calloc(STUDY_GROUPS * (size_t)e->count, sizeof *error);
    if (error == NULL) {
        return no_memory();
    }
    for (int k = 0; k < STUDY_TIMES; ++k) {
        measure_growth(e, k, error, score);
    }
    free(error);
    for (int g = 0; g < STUDY_GROUPS; ++g) {
        score->median[g] = e->trajectory[g].median;
        score->mean[g] = e->trajectory[g].mean;
    }
    score->failures = pm_evaluation_failures(e);
    return measure_laws(e, truth, &score->laws);
}

// The residuals that every training of the scene would best have made small, whatever it did.
static pm_status measure_step(pm_system *system, const pm_dataset *dataset, study_score *score) {
    const pm_scene *scene = system->scene;
    const pm_loss loss = {.residual = PM_RESIDUAL_STEP,
                          .integrator = scene->physics.integrator,
                          .substeps = scene->physics.substeps};
    pm_samples samples = {.count = 0};
    pm_objective *objective = NULL;
    double *gradient = NULL;
    pm_status status;
    PM_TRY_DONE(pm_samples_make(&samples, scene, dataset, 0, dataset->ntrajectory, loss.residual, 1,
                                pm_loss_input_order(&loss)));
    PM_TRY_DONE(pm_objective_open(&objective, system, &samples, &loss));
    score->weights = pm_objective_size(objective);
    gradient = calloc((size_t)score->weights + 1, sizeof *gradient);
    if (gradient == NULL) {
        status = no_memory();
        goto done;
    }
    pm_objective_evaluate(objective, 0, NULL, gradient);
    PM_TRY_DONE(pm_objective_residuals(objective, &score->step_median, &score->step_mean));
done:
    free(gradient);
    pm_objective_close(objective);
    pm_samples_free(&samples);
    return status;
}

pm_status study_measure(const char *config, const char *folder, const study_truth *truth,
                        const char *pictures, study_score *score) {
    const pm_evaluate_how how = {.threads = THREADS};
    pm_training *training = NULL;
    pm_system *system = NULL;
    pm_evaluation *evaluation = NULL;
    pm_status status;
    PM_TRY_DONE(pm_training_load(&training, config));
    PM_TRY_DONE(pm_system_load(&system, training->scene, folder));
    PM_TRY_DONE(
        pm_evaluate(&evaluation, system, truth->dataset, 0, truth->dataset->ntrajectory, &how));
    PM_TRY_DONE(measure_rollouts(evaluation, truth->physics, score));
    PM_TRY_DONE(measure_step(system, truth->dataset, score));
    if (pictures != NULL) {
        PM_TRY_DONE(pm_evaluation_plot(evaluation, NULL, pictures));
    }
done:
    pm_evaluation_free(evaluation);
    pm_system_free(system);
    pm_training_free(training);
    return status;
}
