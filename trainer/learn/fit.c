// A fit from its training file to its last stage: loads and divides the data, chooses the initial
// weights, runs the stages, and saves and validates between iterations.
#include "learn/fit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/digest.h"
#include "base/options.h"
#include "learn/fit_measured.h"
#include "learn/normalization.h"
#include "learn/spectrum.h"
#include "learn/start.h"

// Training begins again with other initial weights if the best rollouts on the validation part have
// more than this fraction of the error of persistence.
#define UNLUCKY 0.02
#define MOST_ATTEMPTS 3
// The number of substeps is doubled at most so often.
#define MOST_FINER 6
// The difference between the seeds of two attempts.
#define SEED_STRIDE 7000003

double pm_fit_processor_time(const pm_fit *f) {
    return (double)clock() / CLOCKS_PER_SEC - f->processor;
}

// --- reports from optimisers ---

static bool is_over(pm_fit *f) {
    const double limit = f->arguments->limit;
    f->expired = limit > 0 && pm_fit_processor_time(f) > limit;
    return f->expired;
}

static pm_status report(void *context, const pm_optimisation *o, double loss) {
    pm_fit *f = context;
    char detail[64];
    snprintf(detail, sizeof detail, "loss %.3e", loss);
    pm_progress_update(&f->progress, o->done, detail);
    f->position[PM_FIT_DONE] = o->done;
    f->position[PM_FIT_BATCHES] = o->batches;
    f->position[PM_FIT_LOSS] = o->loss;
    f->loss = loss;
    if (o->batches == 0) {
        double score = NAN;
        const bool last = o->done >= o->schedule.iterations; // validated when the stage has ended
        if (o->done % f->interval == 0 && !last) {
            PM_TRY(pm_fit_validate(f, &score));
        }
        if (!last) {
            pm_fit_write_curves(f, f->training->stage[f->stage].optimiser->name, loss, score);
        }
    }
    if (pm_team_any(f->arguments->team, *f->stop)) {
        PM_TRY(pm_fit_save(f, false));
        return pm_fail(PM_EINTERRUPTED, "interrupted; continue with --resume");
    }
    if (is_over(f)) {
        return pm_fail(PM_EINTERRUPTED, "the time for training is over");
    }
    return pm_clock() - f->saved > PM_FIT_CHECKPOINT_INTERVAL ? pm_fit_save(f, false) : PM_OK;
}

// --- stages ---

// Prepares a stage that begins or is resumed: sets the weights and the robust scale.
static pm_status take_up(pm_fit *f, pm_objective *objective) {
    pm_objective_set_weights(objective, f->theta);
    pm_objective_evaluate(objective, 0, NULL, NULL); // so that all residuals are up to date
    if (f->position[PM_FIT_DONE] > 0 || f->position[PM_FIT_BATCHES] > 0) { // resumed
        pm_objective_set_robust_square(objective, f->position[PM_FIT_ROBUST]);
    } else {
        PM_TRY(pm_objective_rescale(objective, 0, NULL));
        f->position[PM_FIT_ROBUST] = pm_objective_robust_square(objective);
    }
    return PM_OK;
}

static pm_status optimise(pm_fit *f, pm_objective *objective) {
    const pm_stage *stage = &f->training->stage[f->stage];
    PM_TRY(take_up(f, objective));
    pm_optimisation o = {.objective = objective,
                         .schedule = stage->schedule,
                         .seed = f->training->seed + 1000 * (uint64_t)(f->stage + 1),
                         .theta = f->theta,
                         .moment = f->moment,
                         .done = (int)f->position[PM_FIT_DONE],
                         .batches = (int)f->position[PM_FIT_BATCHES],
                         .loss = f->position[PM_FIT_LOSS],
                         .report = report,
                         .context = f};
    char label[64];
    snprintf(label, sizeof label, "stage %d/%d %s", f->stage + 1, f->training->nstage,
             stage->optimiser->name);
    pm_progress_init(&f->progress, label, stage->schedule.iterations);
    const double started = pm_clock();
    const pm_status status = stage->optimiser->run(&o);
    pm_progress_finish(&f->progress);
    PM_TRY(f->expired ? PM_OK : status);
    double score = NAN, median = 0, mean = 0;
    pm_objective_set_weights(objective, f->theta);
    PM_TRY(pm_fit_validate(f, &score));
    pm_fit_write_curves(f, stage->optimiser->name, f->loss, score);
    pm_objective_evaluate(objective, 0, NULL, NULL); // so that all residuals are up to date
    PM_TRY(pm_objective_residuals(objective, &median, &mean));
    printf("%-16s %8d iterations %8.1f s   loss %.3e", label, o.done, pm_clock() - started,
           f->loss);
    if (isfinite(score)) {
        printf("   validation %.3g %% of persistence", 100 * score);
    }
    printf("   squared residual: median %.3e mean %.3e\n", median, mean);
    fflush(stdout);
    return f->training->plain || f->stage < f->training->nstage - 1
               ? PM_OK
               : pm_spectrum_report(objective, stdout);
}

// Makes the samples of the training part.
static pm_status make_samples(pm_fit *f, pm_residual residual, int unroll, int input_order,
                              pm_samples *samples) {
    return pm_samples_make(samples, f->training->scene, f->dataset, 0, f->split.ntraining, residual,
                           unroll, input_order);
}

// Chooses initial weights by the seed of the training and the number of the attempt.
static pm_status search_start(pm_fit *f) {
    pm_samples samples;
    if (f->training->tries <= 1 || (f->measured != NULL && pm_fit_measured_searches(f))) {
        return PM_OK;
    }
    pm_status status = make_samples(f, PM_RESIDUAL_DERIVATIVE, 1, 1, &samples);
    if (status == PM_EDATA) {
        return PM_OK; // the trajectories are too short for rates: keep the first draw
    }
    PM_TRY(status);
    const uint64_t seed = f->training->seed + SEED_STRIDE * (uint64_t)f->position[PM_FIT_ATTEMPT];
    status = pm_start_search(f->training, &samples, seed, f->declared, f->theta, f->stop);
    pm_samples_free(&samples);
    return status;
}

static pm_status run_stage(pm_fit *f) {
    const pm_stage *stage = &f->training->stage[f->stage];
    pm_samples samples;
    PM_TRY(make_samples(f, stage->loss.residual, stage->unroll, pm_loss_input_order(&stage->loss),
                        &samples));
    pm_samples_rescale(&samples, stage->loss.scale);
    pm_objective *objective = NULL;
    f->interval = pm_fit_interval(f, stage);
    pm_status status = pm_objective_open(&objective, f->training->system, &samples, &stage->loss);
    if (status == PM_OK) {
        status = optimise(f, objective);
    }
    pm_objective_close(objective);
    pm_samples_free(&samples);
    return status;
}

// Doubles the number of substeps of all stages of steps.
static void refine(pm_fit *f) {
    for (int i = 0; i < f->training->nstage; ++i) {
        pm_loss *loss = &f->training->stage[i].loss;
        loss->substeps *= loss->residual == PM_RESIDUAL_STEP ? 2 : 1;
    }
}

// Whether the stage has failed in its first iteration, so that its substeps are most likely too
// long for an explicit integrator of the model. What the training file says exactly stays as it is.
static bool may_be_finer(const pm_fit *f) {
    return !f->training->plain && f->position[PM_FIT_DONE] == 0 &&
           f->position[PM_FIT_FINER] < MOST_FINER &&
           f->training->stage[f->stage].loss.residual == PM_RESIDUAL_STEP;
}

// A stage whose first loss is not finite begins again with more substeps. Later it ends, and
// training goes on from the best weights so far.
static pm_status run_stage_or_return(pm_fit *f) {
    pm_status status = run_stage(f);
    while (status == PM_ENUMERIC && may_be_finer(f)) {
        ++f->position[PM_FIT_FINER];
        refine(f);
        printf("stage %d/%d: %s. The steps are too long for the model: %d substeps are taken.\n",
               f->stage + 1, f->training->nstage, pm_error(),
               f->training->stage[f->stage].loss.substeps);
        status = run_stage(f);
    }
    if (status != PM_ENUMERIC || f->position[PM_FIT_BEST] < 0) {
        return status;
    }
    printf("stage %d/%d ends after %d iterations: %s. Training goes on from the best weights.\n",
           f->stage + 1, f->training->nstage, (int)f->position[PM_FIT_DONE], pm_error());
    memcpy(f->theta, f->best, (size_t)f->size * sizeof *f->theta);
    return PM_OK;
}

static void begin_stage(pm_fit *f, int stage) {
    f->position[PM_FIT_STAGE] = stage;
    f->position[PM_FIT_DONE] = f->position[PM_FIT_BATCHES] = f->position[PM_FIT_LOSS] = 0;
    memset(f->moment, 0, 2 * (size_t)f->size * sizeof *f->moment);
}

// The checkpoint of the last stage remains, so that a longer last stage can be resumed from it.
static pm_status run_stages(pm_fit *f) {
    for (f->stage = (int)f->position[PM_FIT_STAGE]; !f->expired; ++f->stage) {
        PM_TRY(run_stage_or_return(f));
        if (!f->expired) { // also if it has settled before its last iteration
            f->position[PM_FIT_DONE] = f->training->stage[f->stage].schedule.iterations;
        }
        PM_TRY(pm_fit_save(f, false));
        if (f->stage + 1 == f->training->nstage) {
            break;
        }
        begin_stage(f, f->stage + 1);
    }
    return PM_OK;
}

// Whether the best weights so far are so bad on the validation part that other initial weights are
// worth the time.
static bool is_unlucky(const pm_fit *f) {
    return !f->expired && f->training->tries > 1 &&
           f->position[PM_FIT_ATTEMPT] + 1 < MOST_ATTEMPTS && f->position[PM_FIT_BEST] > UNLUCKY;
}

pm_status pm_fit_run(pm_fit *f) {
    pm_status status = f->measured == NULL ? run_stages(f) : pm_fit_measured_run(f);
    while (status == PM_OK && f->measured == NULL && is_unlucky(f)) {
        ++f->position[PM_FIT_ATTEMPT];
        begin_stage(f, 0);
        printf("rollouts on the validation part are bad: other initial weights are tried\n");
        status = search_start(f);
        status = status == PM_OK ? run_stages(f) : status;
    }
    pm_fit_set_weights(f, pm_fit_kept(f));
    if (status == PM_OK && f->measured == NULL && f->position[PM_FIT_BEST] >= 0) {
        printf("Best weights on the validation part: those of stage %d after %d iterations.\n",
               (int)f->position[PM_FIT_BEST_STAGE] + 1, (int)f->position[PM_FIT_BEST_DONE]);
    }
    return status;
}

// --- data ---

static pm_status load_dataset(pm_fit *f, const char *path) {
    f->data = path;
    if (pm_training_is_measured(f->training)) {
        return pm_fit_measured_load(f, path);
    }
    PM_TRY(pm_dataset_load(&f->dataset, path));
    const double dt = f->training->scene->dt;
    if (f->dataset->dt < dt * (1 - 1e-9) || f->dataset->dt > dt * (1 + 1e-9)) {
        return pm_fail(PM_EDATA, "%s: states are %g s apart, the scene %s steps by %g s", path,
                       f->dataset->dt, f->training->scene->path, dt);
    }
    return PM_OK;
}

// Takes the lists of the command line, or else those of the training file. Errors in the latter
// name their place in the file.
static pm_status split_data(pm_fit *f) {
    const pm_fit_arguments *a = f->arguments;
    const pm_training *t = f->training;
    const char *used = a->trajectories != NULL ? a->trajectories : t->trajectories;
    const char *kept = a->validation != NULL ? a->validation : t->validation;
    const pm_status status =
        pm_split_choose(&f->split, f->dataset->ntrajectory, used, kept, &f->arena);
    const char *at = a->trajectories == NULL && t->trajectories_at != NULL ? t->trajectories_at
                     : a->validation == NULL                               ? t->validation_at
                                                                           : NULL;
    return status != PM_EUSAGE || at == NULL ? status
                                             : pm_fail(PM_ECONFIG, "%s: %s", at, pm_error());
}

// Leaves out the states after the first seconds of each trajectory. Measurements do this by
// themselves.
static pm_status keep_first_seconds(pm_fit *f) {
    const double steps = f->training->seconds / f->dataset->dt * (1 + 1e-9);
    if (steps < 1) {
        return pm_fail(PM_EDATA, "%s: seconds: %g s are shorter than a step of %g s",
                       f->arguments->config, f->training->seconds, f->dataset->dt);
    }
    if (steps < f->dataset->ntime - 1) {
        pm_dataset_shorten(f->dataset, (int)steps + 1);
    }
    return PM_OK;
}

static pm_status load_data(pm_fit *f) {
    if (f->arguments->data != NULL) {
        PM_TRY(load_dataset(f, f->arguments->data));
    } else if (f->training->data != NULL) {
        const pm_status status = load_dataset(f, f->training->data);
        if (status != PM_OK) {
            return pm_fail(status, "%s: %s", f->training->data_at, pm_error());
        }
    } else {
        return pm_fail(PM_EUSAGE, "%s names no data; name them with --data FILE",
                       f->arguments->config);
    }
    PM_TRY(split_data(f));
    PM_TRY(pm_split_reorder(&f->split, f->dataset));
    f->seen = pm_arena_array(&f->arena, (size_t)f->dataset->ntrajectory, sizeof *f->seen);
    if (f->seen == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for digests of trajectories");
    }
    f->digest = f->training->digest;
    for (int i = 0; i < f->dataset->ntrajectory; ++i) {
        f->seen[i] = f->measured == NULL
                         ? pm_dataset_digest(f->dataset, i)
                         : pm_dataset_digest(f->measured->data, f->split.trajectory[i]);
        f->digest = pm_digest_integer(f->digest, (int64_t)f->seen[i]);
    }
    f->digest = pm_digest_integer(f->digest, f->split.ntraining);
    // After the digests, which are those of whole trajectories.
    return f->measured == NULL ? keep_first_seconds(f) : PM_OK;
}

// --- start ---

static size_t count_weights(const pm_system *system) {
    size_t count = 0;
    for (int i = 0; i < pm_system_components(system); ++i) {
        count += pm_params_trained(pm_system_params(system, i));
    }
    return count;
}

// Draws the weights, fixes the normalisation, and writes the chosen initial weights to theta.
static pm_status initialise(pm_fit *f) {
    pm_system *system = f->training->system;
    double *theta = f->declared;
    for (int i = 0; i < pm_system_components(system); ++i) {
        pm_params_gather(pm_system_params(system, i), theta);
        theta += pm_params_trained(pm_system_params(system, i));
    }
    if (f->measured != NULL) {
        memcpy(f->measured->declared, f->declared, (size_t)f->size * sizeof *f->declared);
    }
    pm_start_draw(f->training, f->theta);
    pm_samples samples;
    pm_status status = make_samples(f, PM_RESIDUAL_STEP, 1, 1, &samples);
    if (status == PM_OK) {
        status = pm_normalization_of_system(system, &samples, f->training->plain);
        pm_samples_free(&samples);
    }
    if (status == PM_OK && !f->arguments->resume) {
        status = search_start(f);
    }
    return status;
}

static pm_status allocate(pm_fit *f) {
    f->size = (int)count_weights(f->training->system);
    const size_t size = (size_t)f->size + 1;
    f->checkpoint = pm_arena_printf(&f->arena, "%s/fit.checkpoint", f->arguments->output);
    f->theta = pm_arena_array(&f->arena, size, sizeof *f->theta);
    f->best = pm_arena_array(&f->arena, size, sizeof *f->best);
    f->declared = pm_arena_array(&f->arena, size, sizeof *f->declared);
    f->moment = pm_arena_array(&f->arena, 2 * size, sizeof *f->moment);
    if (f->checkpoint == NULL || f->theta == NULL || f->best == NULL || f->moment == NULL ||
        f->declared == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for %d weights", f->size);
    }
    f->position[PM_FIT_BEST] = -1;
    for (int i = 0; i < PM_MAX_TRAINING_STAGES; ++i) {
        f->position[PM_FIT_DIGEST + i] = f->training->stage_digest[i];
    }
    return PM_OK;
}

static void print_head(const pm_fit *f) {
    const struct pm_fit_measured *m = f->measured;
    printf("%s: %d weights, trajectories %s of %s%d %s", f->arguments->config, f->size,
           f->split.training, m == NULL ? "" : "at most ",
           m == NULL ? f->dataset->ntime : m->data->ntime, m == NULL ? "states" : "samples");
    if (m != NULL && m->used < m->samples) {
        printf(", of which %.0f %% are used, about dt = %g s apart",
               100.0 * (double)m->used / (double)m->samples, f->training->scene->dt);
    }
    if (f->split.nvalidation > 0) {
        printf("; validation on %s", f->split.validation);
    } else {
        printf("; no validation");
    }
    printf("\n");
    fflush(stdout);
}

static pm_status replace_seed(pm_training *training, const char *text) {
    int64_t seed = 0;
    if (text == NULL) {
        return PM_OK;
    }
    PM_TRY(pm_options_count("--seed", text, INT32_MAX, &seed));
    training->seed = (uint64_t)seed;
    training->digest = pm_digest_integer(training->digest, seed);
    return PM_OK;
}

// Lets the team evaluate the losses of all stages.
static pm_status join_team(pm_fit *f) {
    if (f->arguments->team != NULL && pm_training_is_measured(f->training)) {
        return pm_fail(PM_EUSAGE,
                       "measurements are fitted by one process: start it without mpirun");
    }
    for (int i = 0; i < f->training->nstage; ++i) {
        f->training->stage[i].loss.team = f->arguments->team;
    }
    return PM_OK;
}

pm_status pm_fit_open(pm_fit *f, const pm_fit_arguments *arguments,
                      const volatile sig_atomic_t *stop) {
    *f = (pm_fit){.arguments = arguments, .stop = stop};
    f->processor = pm_fit_processor_time(f);
    PM_TRY(pm_training_load(&f->training, arguments->config));
    PM_TRY(replace_seed(f->training, arguments->seed));
    PM_TRY(join_team(f));
    PM_TRY(pm_fit_check_names(f->training->scene));
    PM_TRY(load_data(f));
    PM_TRY(pm_options_folder(arguments->output));
    PM_TRY(allocate(f));
    print_head(f);
    f->saved = pm_clock();
    PM_TRY(initialise(f));
    PM_TRY(arguments->resume ? pm_fit_load(f) : PM_OK);
    for (int i = 0; i < f->position[PM_FIT_FINER]; ++i) {
        refine(f);
    }
    return pm_fit_open_curves(f);
}

void pm_fit_close(pm_fit *f) {
    if (f->curves != NULL) {
        fclose(f->curves);
    }
    pm_training_free(f->training);
    pm_dataset_free(f->dataset);
    pm_fit_measured_close(f->measured);
    pm_arena_free(&f->arena);
}
