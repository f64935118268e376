// What both kinds of fits use: the choice of initial weights by rates, and the folder of a fit with
// the checkpoint for --resume and the best weights so far as one file for each subsystem and port.
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/digest.h"
#include "data/trained.h"
#include "fit/fit.h"
#include "fit/fold_tangent.h"
#include "fit/start.h"

// The difference between the seeds of two attempts.
#define SEED_STRIDE 7000003
#define LONGEST_FIT 30000 // bytes of the names of files: an attribute of HDF5 holds 64 kB

double pm_fit_processor_time(const pm_fit *f) {
    return (double)clock() / CLOCKS_PER_SEC - f->processor;
}

// Copies the constants of all models, which are fixed and not trained, to `values`, or back.
// Returns how many there are; with NULL it only counts them.
static size_t copy_constants(const pm_fit *f, double *values, bool out) {
    size_t count = 0;
    for (int i = 0; i < pm_system_components(f->training->system); ++i) {
        const pm_params *params = pm_system_params(f->training->system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *e = &params->entry[k];
            const size_t size = e->trained || e->borrowed ? 0 : (size_t)e->rows * (size_t)e->cols;
            if (values != NULL && size > 0) {
                memcpy(out ? values + count : e->value, out ? e->value : values + count,
                       size * sizeof *values);
            }
            count += size;
        }
    }
    return count;
}

pm_status pm_fit_search_start(pm_fit *f, double *loss) {
    pm_samples samples;
    if (f->training->tries <= 1) {
        return PM_OK;
    }
    pm_status status = pm_samples_make(&samples, f->training->scene, f->dataset, 0,
                                       f->split.ntraining, PM_RESIDUAL_DERIVATIVE, 1, 1);
    if (status == PM_EDATA) {
        return PM_OK; // the trajectories are too short for rates: keep the first draw
    }
    PM_TRY(status);
    const uint64_t seed = f->training->seed + SEED_STRIDE * (uint64_t)f->position.attempt;
    status = pm_start_search(f->training, &samples, seed, f->declared, f->theta, loss, f->stop);
    pm_samples_free(&samples);
    return status;
}

// Writes or reads a start: all weights, and the constants that are fixed beside them.
static pm_status exchange_start(pm_fit *f, const char *path, bool save) {
    const size_t count = copy_constants(f, NULL, true);
    double *constants = malloc((count + 1) * sizeof *constants);
    PM_TRY(pm_allocated(constants, "a start"));
    (void)copy_constants(f, constants, true);
    const pm_checkpoint_field field[] = {{"theta", f->size, f->theta},
                                         {"constants", (int)count, constants}};
    const int nfield = count > 0 ? 2 : 1;
    const pm_status status = save ? pm_checkpoint_save(path, "start", 0, nfield, field)
                                  : pm_checkpoint_load(path, "start", 0, nfield, field);
    if (status == PM_OK) {
        (void)copy_constants(f, constants, false);
    }
    free(constants);
    return status;
}

pm_status pm_fit_save_start(pm_fit *f, const char *path) {
    return exchange_start(f, path, true);
}

pm_status pm_fit_load_start(pm_fit *f) {
    const char *path = f->training->from;
    const pm_status status = exchange_start(f, path, false);
    PM_TRY(status == PM_OK ? PM_OK
                           : pm_fail(status, "%s; without the key from of start weights are drawn",
                                     pm_error()));
    pm_trained_scatter(f->training->system, f->theta);
    printf("start            from %s\n", path);
    fflush(stdout);
    return PM_OK;
}

// --- weights files ---

static const char *base_name(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash == NULL ? path : slash + 1;
}

// Returns the weights file of a component, counting subsystems first, then ports. NULL: the scene
// has a model of it.
static const char *weights_of(const pm_scene *scene, int component) {
    const int n = scene->physics.nsubsystem;
    return component < n ? scene->physics.subsystem[component].weights
                         : scene->physics.port[component - n].weights;
}

// Two components with the same file name would overwrite each other's weights.
pm_status pm_fit_check_names(const pm_scene *scene) {
    const int n = scene->physics.nsubsystem, count = n + scene->physics.nport;
    for (int i = 0; i < count; ++i) {
        for (int j = i + 1; j < count; ++j) {
            const char *a = weights_of(scene, i), *b = weights_of(scene, j);
            if (a != NULL && b != NULL && strcmp(base_name(a), base_name(b)) == 0) {
                return pm_fail(PM_ECONFIG,
                               "%s: two components share the weights file %s; train a scene in "
                               "which each has its own",
                               j < n ? scene->physics.subsystem[j].weights_at
                                     : scene->physics.port[j - n].weights_at,
                               base_name(a));
            }
        }
    }
    return PM_OK;
}

const double *pm_fit_kept(const pm_fit *f) {
    return f->position.best >= 0 ? f->best : f->theta;
}

// Writes the weights with their tangents folded in (fit/fold_tangent.h). The training continues
// with the original ones.
static pm_status save_part(pm_fit *f, int id, const char *path, pm_provenance *p) {
    pm_part *part = f->training->system->part[id];
    const pm_scene_subsystem *scene = &f->training->scene->physics.subsystem[id];
    pm_arena arena = {0};
    const pm_part_spec spec = part->spec;
    p->columns = pm_system_columns_digest(scene);
    p->relative = pm_system_relative_groups(scene, &arena);
    pm_status status = p->relative == NULL ? pm_fail(PM_ENOMEM, "out of memory for weights")
                                           : pm_fold_tangent(part, &arena);
    if (status == PM_OK) {
        status = pm_weights_save(path, f->training->system->component[id], p);
    }
    part->spec = spec;
    p->columns = 0;
    p->relative = NULL;
    pm_arena_free(&arena);
    return status;
}

// Writes the kept weights. The system has its present weights again afterwards.
static pm_status save_weights(pm_fit *f, bool loud) {
    pm_system *system = f->training->system;
    double *before = malloc(((size_t)f->size + 1) * sizeof *before);
    PM_TRY(before != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for weights"));
    pm_trained_gather(system, before);
    pm_trained_scatter(system, pm_fit_kept(f));
    // What all weights files of the fit share.
    const pm_loss *loss = &f->training->stage[f->training->nstage - 1].loss;
    const bool steps = loss->residual == PM_RESIDUAL_STEP;
    const int count = pm_system_components(system);
    pm_arena arena = {0};
    const char *fit = pm_arena_printf(
        &arena, "%016" PRIx64, pm_digest_doubles(f->digest, pm_fit_kept(f), (size_t)f->size));
    for (int i = 0; i < count && fit != NULL && strlen(fit) < LONGEST_FIT; ++i) {
        const char *weights = weights_of(f->training->scene, i);
        fit = weights == NULL ? fit : pm_arena_printf(&arena, "%s %s", fit, base_name(weights));
    }
    pm_provenance p = (pm_provenance){
        .command = f->arguments->line,
        .data = f->data,
        .coordinates = pm_dataset_find_note(f->dataset, "coordinates"),
        .integrator = steps ? loss->integrator->name : NULL,
        .step = steps ? f->training->scene->physics.dt / loss->substeps : 0,
        .fit = fit,
        .system = f->training->scene->system != NULL ? f->training->scene->system
                                                     : f->training->scene->name,
        .verdict = *f->verdict == '\0' ? "unfinished: the fit was not judged" : f->verdict,
        .trajectories = f->split.training,
        .nseen = f->dataset->ntrajectory,
        .seen = f->seen,
        .seed = f->training->seed,
        .loss = f->loss,
        .seconds = f->position.seconds};
    pm_status status = fit == NULL ? pm_fail(PM_ENOMEM, "out of memory for weights") : PM_OK;
    for (int i = 0; i < count && status == PM_OK; ++i) {
        const char *weights = weights_of(f->training->scene, i);
        if (weights != NULL) {
            char path[4096];
            snprintf(path, sizeof path, "%s/%s", f->arguments->output, base_name(weights));
            status = i < system->scene->physics.nsubsystem
                         ? save_part(f, i, path, &p)
                         : pm_weights_save(path, system->component[i], &p);
            if (status == PM_OK && loud) {
                printf("wrote %s\n", path);
            }
        }
    }
    pm_trained_scatter(system, before);
    pm_arena_free(&arena);
    free(before);
    return status;
}

// --- checkpoints ---

#define OWN_FIELDS 5
#define MOST_FIELDS (OWN_FIELDS + PM_FIT_MOST_EXTRA)
// Numbers of the position, before the digest of each stage (fit/training.h).
#define POSITION 11
#define NUMBERS (POSITION + PM_MAX_TRAINING_STAGES)

// Writes the position as numbers, lists what a checkpoint holds, and returns the number of fields.
static int fields_of(pm_fit *f, double number[NUMBERS], double *constants,
                     pm_checkpoint_field field[MOST_FIELDS]) {
    const pm_fit_position *p = &f->position;
    const double own[POSITION] = {p->stage,     p->done,    p->seconds, p->robust,
                                  p->batches,   p->loss,    p->best,    p->best_stage,
                                  p->best_done, p->attempt, p->finer};
    memcpy(number, own, sizeof own);
    for (int i = 0; i < PM_MAX_TRAINING_STAGES; ++i) {
        number[POSITION + i] = f->training->stage_digest[i];
    }
    field[0] = (pm_checkpoint_field){"position", NUMBERS, number};
    field[1] = (pm_checkpoint_field){"theta", f->size, f->theta};
    field[2] = (pm_checkpoint_field){"moment", 2 * f->size, f->moment};
    field[3] = (pm_checkpoint_field){"best", f->size, f->best};
    field[4] = (pm_checkpoint_field){"constants", (int)copy_constants(f, NULL, true), constants};
    memcpy(field + OWN_FIELDS, f->extra, (size_t)f->nextra * sizeof *field);
    return OWN_FIELDS + f->nextra;
}

pm_status pm_fit_save(pm_fit *f, bool loud) {
    double number[NUMBERS];
    pm_checkpoint_field field[MOST_FIELDS];
    const double now = pm_clock();
    f->position.seconds += now - f->saved;
    f->saved = now;
    if (!pm_team_leads(f->arguments->team)) {
        return PM_OK;
    }
    double *constants = malloc((copy_constants(f, NULL, true) + 1) * sizeof *constants);
    PM_TRY(constants != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for a checkpoint"));
    (void)copy_constants(f, constants, true);
    const int count = fields_of(f, number, constants, field);
    const pm_status status = pm_checkpoint_save(f->checkpoint, "fit", f->digest, count, field);
    free(constants);
    PM_TRY(status);
    return save_weights(f, loud);
}

pm_status pm_fit_load(pm_fit *f) {
    double number[NUMBERS];
    pm_checkpoint_field field[MOST_FIELDS];
    const pm_training *t = f->training;
    double *constants =
        pm_arena_array(&f->arena, copy_constants(f, NULL, true) + 1, sizeof *constants);
    PM_TRY(pm_arena_status(&f->arena, "a checkpoint"));
    const int count = fields_of(f, number, constants, field);
    PM_TRY(pm_checkpoint_load(f->checkpoint, "fit", f->digest, count, field));
    (void)copy_constants(f, constants, false);
    f->position = (pm_fit_position){.stage = (int)number[0],
                                    .done = (int)number[1],
                                    .seconds = number[2],
                                    .robust = number[3],
                                    .batches = (int)number[4],
                                    .loss = number[5],
                                    .best = number[6],
                                    .best_stage = (int)number[7],
                                    .best_done = (int)number[8],
                                    .attempt = (int)number[9],
                                    .finer = (int)number[10]};
    // Completed stages and the stage in progress must be the same as in the checkpoint, except for
    // their number of iterations.
    for (int i = 0; i <= f->position.stage; ++i) {
        if (f->position.stage >= t->nstage || number[POSITION + i] != t->stage_digest[i]) {
            return pm_fail(PM_EFILE, "%s: made by other stages: stage %d of %s has changed since",
                           f->checkpoint, i + 1, f->arguments->config);
        }
    }
    if (f->kind->resume != NULL && f->position.done >= 0) {
        f->kind->resume(f);
    }
    return PM_OK;
}
