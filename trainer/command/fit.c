// portmet-train fit: trains the models of a scene on a dataset, stage by stage, with checkpoints.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/digest.h"
#include "base/progress.h"
#include "command/commands.h"
#include "command/options.h"
#include "learn/fold_tangent.h"
#include "learn/normalization.h"
#include "learn/symmetry.h"
#include "learn/training.h"
#include "store/checkpoint.h"

#define CHECKPOINT_INTERVAL 30.0 // s

typedef struct arguments {
    const char *config, *data, *output, *trajectories;
    bool resume;
    char line[1024];
} arguments;

// A fit under way.
typedef struct fit {
    const arguments *arguments;
    pm_training *training;
    pm_dataset *dataset;
    int first, end; // trajectories
    const volatile sig_atomic_t *stop;
    char *checkpoint; // path
    uint64_t digest;
    int size;
    double *theta;  // [size]
    double *moment; // [2][size]
    // Stage, iterations done in it, seconds so far, its robust scale squared, batches done of the
    // next iteration, their loss.
    double position[6];
    double saved; // s, monotonic clock, at the last checkpoint
    double loss;
    pm_progress progress;
} fit;

static pm_status read_arguments(int argc, char **argv, arguments *a, bool *helped) {
    const pm_option option[] = {
        {"--data", "-d", "FILE", NULL, &a->data, false, "dataset, instead of the one CONFIG names"},
        {"--output", "-o", "DIR", NULL, &a->output, true,
         "folder for the weights, one file per subsystem and port"},
        {"--trajectories", NULL, "A:B", NULL, &a->trajectories, false,
         "train on trajectories A up to, not including, B"},
        {"--resume", NULL, NULL, &a->resume, NULL, false,
         "go on from DIR/fit.checkpoint, written every 30 s"},
    };
    const pm_options options = {
        .usage = "portmet-train fit CONFIG [--data FILE] -o DIR [options]",
        .summary = "Trains the models that CONFIG gives to the parts of its scene, by its stages, "
                   "and writes\n"
                   "the weights to DIR. The same command gives the same weights.",
        .positional_name = "CONFIG",
        .positional = &a->config,
        .count = sizeof option / sizeof *option,
        .option = option,
    };
    pm_options_line(argc, argv, a->line, (int)sizeof a->line);
    return pm_options_read(&options, argc, argv, helped);
}

// --- checkpoints ---

static void fields_of(fit *f, pm_checkpoint_field field[3]) {
    field[0] = (pm_checkpoint_field){"position", 6, f->position};
    field[1] = (pm_checkpoint_field){"theta", f->size, f->theta};
    field[2] = (pm_checkpoint_field){"moment", 2 * f->size, f->moment};
}

static pm_status save_checkpoint(fit *f) {
    pm_checkpoint_field field[3];
    const double now = pm_clock();
    f->position[2] += now - f->saved;
    f->saved = now;
    fields_of(f, field);
    return pm_checkpoint_save(f->checkpoint, "fit", f->digest, 3, field);
}

static pm_status load_checkpoint(fit *f) {
    pm_checkpoint_field field[3];
    fields_of(f, field);
    return pm_checkpoint_load(f->checkpoint, "fit", f->digest, 3, field);
}

// --- stages ---

static pm_status report(void *context, const pm_optimisation *o, double loss) {
    fit *f = context;
    char detail[64];
    snprintf(detail, sizeof detail, "loss %.3e", loss);
    pm_progress_update(&f->progress, o->done, detail);
    f->position[1] = o->done;
    f->position[4] = o->batches;
    f->position[5] = o->loss;
    f->loss = loss;
    if (*f->stop) {
        PM_TRY(save_checkpoint(f));
        return pm_fail(PM_EINTERRUPTED, "interrupted; go on with --resume");
    }
    return pm_clock() - f->saved > CHECKPOINT_INTERVAL ? save_checkpoint(f) : PM_OK;
}

// Evaluates every sample, for the residuals.
static pm_status evaluate_all(const fit *f, pm_objective *objective) {
    double *gradient = malloc(((size_t)f->size + 1) * sizeof *gradient);
    if (gradient == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a gradient");
    }
    pm_objective_evaluate(objective, 0, NULL, gradient);
    free(gradient);
    return PM_OK;
}

static pm_status optimise(fit *f, pm_objective *objective, int stage_id) {
    const pm_stage *stage = &f->training->stage[stage_id];
    pm_objective_set_weights(objective, f->theta);
    PM_TRY(evaluate_all(f, objective));
    if (f->position[1] > 0 || f->position[4] > 0) { // taken up again
        pm_objective_set_robust_square(objective, f->position[3]);
    } else {
        PM_TRY(pm_objective_rescale(objective, 0, NULL));
        f->position[3] = pm_objective_robust_square(objective);
    }
    pm_optimisation o = {.objective = objective,
                         .schedule = stage->schedule,
                         .seed = f->training->seed + 1000 * (uint64_t)(stage_id + 1),
                         .theta = f->theta,
                         .moment = f->moment,
                         .done = (int)f->position[1],
                         .batches = (int)f->position[4],
                         .loss = f->position[5],
                         .report = report,
                         .context = f};
    char label[64];
    snprintf(label, sizeof label, "stage %d/%d %s", stage_id + 1, f->training->nstage,
             stage->optimiser->name);
    pm_progress_init(&f->progress, label, stage->schedule.iterations);
    const double started = pm_clock();
    const pm_status status = stage->optimiser->run(&o);
    pm_progress_finish(&f->progress);
    PM_TRY(status);
    double median = 0, mean = 0;
    PM_TRY(evaluate_all(f, objective));
    PM_TRY(pm_objective_residuals(objective, &median, &mean));
    printf("%-16s %8d iterations %8.1f s   loss %.3e   squared residual: median %.3e mean %.3e\n",
           label, o.done, pm_clock() - started, f->loss, median, mean);
    fflush(stdout);
    return PM_OK;
}

// With images of them, if the training file says so.
static pm_status make_samples(fit *f, pm_residual residual, int unroll, int input_order,
                              pm_samples *samples) {
    pm_symmetry *symmetry = NULL;
    if (f->training->square) {
        PM_TRY(pm_symmetry_make(&symmetry, f->training->system, unroll, input_order,
                                &f->training->arena));
    }
    PM_TRY(pm_samples_make(samples, f->training->scene, f->dataset, f->first, f->end, residual,
                           unroll, input_order));
    samples->symmetry = symmetry;
    return PM_OK;
}

static pm_status run_stage(fit *f, int stage_id) {
    const pm_stage *stage = &f->training->stage[stage_id];
    pm_samples samples;
    PM_TRY(make_samples(f, stage->loss.residual, stage->unroll, pm_loss_load_order(&stage->loss),
                        &samples));
    pm_samples_rescale(&samples, stage->loss.scale);
    pm_objective *objective = NULL;
    pm_status status = pm_objective_open(&objective, f->training->system, &samples, &stage->loss);
    if (status == PM_OK) {
        status = optimise(f, objective, stage_id);
    }
    pm_objective_close(objective);
    pm_samples_free(&samples);
    return status;
}

static pm_status run_stages(fit *f) {
    for (int stage = (int)f->position[0]; stage < f->training->nstage; ++stage) {
        PM_TRY(run_stage(f, stage));
        f->position[0] = stage + 1;
        f->position[1] = f->position[4] = f->position[5] = 0;
        memset(f->moment, 0, 2 * (size_t)f->size * sizeof *f->moment);
        PM_TRY(save_checkpoint(f));
    }
    return PM_OK;
}

// --- weights ---

static const char *base_name(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash == NULL ? path : slash + 1;
}

// Of all parts, then all ports; NULL: its model is known.
static const char *weights_of(const pm_scene *scene, int component) {
    const int n = scene->nsubsystem;
    return component < n ? scene->subsystem[component].weights : scene->port[component - n].weights;
}

static pm_status save_weights(const fit *f) {
    const pm_scene *scene = f->training->scene;
    const pm_loss *loss = &f->training->stage[f->training->nstage - 1].loss;
    const bool steps = loss->residual == PM_RESIDUAL_STEP;
    const pm_provenance provenance = {
        .command = f->arguments->line,
        .data = f->arguments->data != NULL ? f->arguments->data : f->training->data,
        .coordinates = pm_dataset_find_note(f->dataset, "coordinates"),
        .integrator = steps ? loss->integrator->name : NULL,
        .step = steps ? scene->dt / loss->substeps : 0,
        .seed = f->training->seed,
        .loss = f->loss,
        .seconds = f->position[2]};
    for (int i = 0; i < scene->nsubsystem + scene->nport; ++i) {
        const bool part = i < scene->nsubsystem;
        const int port = i - scene->nsubsystem;
        char path[4096];
        if (weights_of(scene, i) == NULL) {
            continue;
        }
        snprintf(path, sizeof path, "%s/%s", f->arguments->output, base_name(weights_of(scene, i)));
        PM_TRY(part ? pm_fold_tangent(&f->training->system->part[i], &f->training->arena) : PM_OK);
        PM_TRY(part ? pm_weights_save_part(path, &f->training->system->part[i], &provenance)
                    : pm_weights_save_port(path, &f->training->system->port[port], &provenance));
        printf("wrote %s\n", path);
    }
    return PM_OK;
}

// --- start ---

// One file per component: two that share a name would overwrite each other.
static pm_status check_file_names(const pm_scene *scene) {
    const int n = scene->nsubsystem, count = n + scene->nport;
    for (int i = 0; i < count; ++i) {
        for (int j = i + 1; j < count; ++j) {
            const char *a = weights_of(scene, i), *b = weights_of(scene, j);
            if (a != NULL && b != NULL && strcmp(base_name(a), base_name(b)) == 0) {
                return pm_fail(PM_ECONFIG,
                               "%s: two components share the weights file %s; train a scene in "
                               "which each has its own",
                               j < n ? scene->subsystem[j].weights_at
                                     : scene->port[j - n].weights_at,
                               base_name(a));
            }
        }
    }
    return PM_OK;
}

static pm_status load_dataset(fit *f, const char *path) {
    PM_TRY(pm_dataset_load(&f->dataset, path));
    const double dt = f->training->scene->dt;
    if (f->dataset->dt < dt * (1 - 1e-9) || f->dataset->dt > dt * (1 + 1e-9)) {
        return pm_fail(PM_EDATA, "%s: states are %g s apart, the scene %s steps by %g s", path,
                       f->dataset->dt, f->training->scene->path, dt);
    }
    return PM_OK;
}

// The range of trajectories: the command line's, or the training file's with its place.
static pm_status choose_trajectories(fit *f) {
    const int count = f->dataset->ntrajectory;
    if (f->arguments->trajectories != NULL || f->training->trajectories == NULL) {
        return pm_options_range(f->arguments->trajectories, count, &f->first, &f->end);
    }
    return pm_options_range(f->training->trajectories, count, &f->first, &f->end) == PM_OK
               ? PM_OK
               : pm_fail(PM_ECONFIG, "%s: %s", f->training->trajectories_at, pm_error());
}

static pm_status load_data(fit *f) {
    if (f->arguments->data != NULL) {
        PM_TRY(load_dataset(f, f->arguments->data));
    } else if (f->training->data != NULL) {
        const pm_status status = load_dataset(f, f->training->data);
        if (status != PM_OK) {
            return pm_fail(status, "%s: %s", f->training->data_at, pm_error());
        }
    } else {
        return pm_fail(PM_EUSAGE, "%s names no data: give --data FILE", f->arguments->config);
    }
    PM_TRY(choose_trajectories(f));
    const double *z = pm_dataset_state(f->dataset, f->first, 0);
    const size_t n =
        (size_t)(f->end - f->first) * (size_t)f->dataset->ntime * (size_t)f->dataset->ncolumn;
    f->digest = pm_digest_doubles(f->training->digest, z, n);
    return PM_OK;
}

static size_t count_weights(const pm_system *system) {
    size_t count = 0;
    for (int i = 0; i < pm_system_components(system); ++i) {
        count += pm_params_trained(pm_system_params(system, i));
    }
    return count;
}

// Draws the weights and fixes the normalisation; theta holds the start.
static pm_status initialise(fit *f) {
    pm_system *system = f->training->system;
    double *theta = f->theta;
    for (int i = 0; i < pm_system_components(system); ++i) {
        pm_rng rng;
        pm_rng_init(&rng, f->training->seed, (uint64_t)i);
        pm_params *params = pm_system_params(system, i);
        pm_params_randomise(params, &rng);
        pm_params_gather(params, theta);
        theta += pm_params_trained(params);
    }
    pm_samples samples;
    PM_TRY(make_samples(f, PM_RESIDUAL_STEP, 1, 1, &samples));
    const pm_status status = pm_normalization_of_system(system, &samples);
    pm_samples_free(&samples);
    return status;
}

static pm_status start(fit *f) {
    PM_TRY(pm_training_load(&f->training, f->arguments->config));
    PM_TRY(check_file_names(f->training->scene));
    PM_TRY(load_data(f));
    PM_TRY(pm_options_folder(f->arguments->output));
    f->size = (int)count_weights(f->training->system);
    const size_t length = strlen(f->arguments->output) + sizeof "/fit.checkpoint";
    f->checkpoint = malloc(length);
    f->theta = calloc((size_t)f->size + 1, sizeof *f->theta);
    f->moment = calloc(2 * (size_t)f->size + 1, sizeof *f->moment);
    if (f->checkpoint == NULL || f->theta == NULL || f->moment == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for %d weights", f->size);
    }
    snprintf(f->checkpoint, length, "%s/fit.checkpoint", f->arguments->output);
    PM_TRY(initialise(f));
    printf("%s: %d weights, trajectories %d to %d of %d states\n", f->arguments->config, f->size,
           f->first, f->end - 1, f->dataset->ntime);
    fflush(stdout);
    f->saved = pm_clock();
    return f->arguments->resume ? load_checkpoint(f) : PM_OK;
}

pm_status pm_command_fit(int argc, char **argv, const volatile sig_atomic_t *stop) {
    arguments a = {0};
    bool helped = false;
    PM_TRY(read_arguments(argc, argv, &a, &helped));
    if (helped) {
        return PM_OK;
    }
    fit f = {.arguments = &a, .stop = stop};
    pm_status status = start(&f);
    if (status == PM_OK) {
        status = run_stages(&f);
    }
    if (status == PM_OK) {
        status = save_weights(&f);
    }
    if (status == PM_OK) {
        unlink(f.checkpoint);
    }
    pm_training_free(f.training);
    pm_dataset_free(f.dataset);
    free(f.checkpoint);
    free(f.theta);
    free(f.moment);
    return status;
}
