// Writes the folder of a fit: the checkpoint for --resume, and the best weights so far as one file
// for each subsystem and port.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "learn/fit.h"
#include "learn/fold_tangent.h"

static const char *base_name(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash == NULL ? path : slash + 1;
}

// Returns the weights file of a component, counting subsystems first, then ports. NULL: the scene
// has a model of it.
static const char *weights_of(const pm_scene *scene, int component) {
    const int n = scene->nsubsystem;
    return component < n ? scene->subsystem[component].weights : scene->port[component - n].weights;
}

// Two components with the same file name would overwrite each other's weights.
pm_status pm_fit_check_names(const pm_scene *scene) {
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

// --- weights ---

void pm_fit_set_weights(pm_fit *f, const double *theta) {
    pm_system *system = f->training->system;
    for (int i = 0; i < pm_system_components(system); ++i) {
        pm_params *params = pm_system_params(system, i);
        pm_params_scatter(params, theta);
        theta += pm_params_trained(params);
    }
}

const double *pm_fit_kept(const pm_fit *f) {
    return f->position[PM_FIT_BEST] >= 0 ? f->best : f->theta;
}

// Returns the provenance that all weights files of the fit share.
static pm_provenance provenance_of(const pm_fit *f) {
    const pm_loss *loss = &f->training->stage[f->training->nstage - 1].loss;
    const bool steps = loss->residual == PM_RESIDUAL_STEP;
    return (pm_provenance){.command = f->arguments->line,
                           .data = f->data,
                           .coordinates = pm_dataset_find_note(f->dataset, "coordinates"),
                           .integrator = steps ? loss->integrator->name : NULL,
                           .step = steps ? f->training->scene->dt / loss->substeps : 0,
                           .trajectories = f->split.training,
                           .nseen = f->dataset->ntrajectory,
                           .seen = f->seen,
                           .seed = f->training->seed,
                           .loss = f->loss,
                           .seconds = f->position[PM_FIT_SECONDS]};
}

// Writes the weights with their tangents folded in (learn/fold_tangent.h). The training continues
// with the original ones.
static pm_status save_part(pm_fit *f, int id, const char *path, pm_provenance *p) {
    pm_part *part = f->training->system->part[id];
    const pm_scene_subsystem *scene = &f->training->scene->subsystem[id];
    pm_arena arena = {0};
    const pm_part_spec spec = part->spec;
    p->columns = pm_system_columns_digest(scene);
    p->relative = pm_system_relative_groups(scene, &arena);
    pm_status status = p->relative == NULL ? pm_fail(PM_ENOMEM, "out of memory for weights")
                                           : pm_fold_tangent(part, &arena);
    if (status == PM_OK) {
        status = pm_weights_save_part(path, part, p);
    }
    part->spec = spec;
    p->columns = 0;
    p->relative = NULL;
    pm_arena_free(&arena);
    return status;
}

static pm_status save_component(pm_fit *f, int id, pm_provenance *p, bool loud) {
    const pm_scene *scene = f->training->scene;
    const bool part = id < scene->nsubsystem;
    char path[4096];
    if (weights_of(scene, id) == NULL) {
        return PM_OK;
    }
    snprintf(path, sizeof path, "%s/%s", f->arguments->output, base_name(weights_of(scene, id)));
    PM_TRY(part ? save_part(f, id, path, p)
                : pm_weights_save_port(path, f->training->system->port[id - scene->nsubsystem], p));
    if (loud) {
        printf("wrote %s\n", path);
    }
    return PM_OK;
}

// Writes the kept weights. The system has its present weights again afterwards.
static pm_status save_weights(pm_fit *f, bool loud) {
    pm_system *system = f->training->system;
    double *before = malloc(((size_t)f->size + 1) * sizeof *before), *at = before;
    if (before == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for weights");
    }
    for (int i = 0; i < pm_system_components(system); ++i) {
        pm_params_gather(pm_system_params(system, i), at);
        at += pm_params_trained(pm_system_params(system, i));
    }
    pm_fit_set_weights(f, pm_fit_kept(f));
    pm_provenance p = provenance_of(f);
    pm_status status = PM_OK;
    for (int i = 0; i < pm_system_components(system) && status == PM_OK; ++i) {
        status = save_component(f, i, &p, loud);
    }
    pm_fit_set_weights(f, before);
    free(before);
    return status;
}

// --- checkpoints ---

#define OWN_FIELDS 4
#define MOST_FIELDS (OWN_FIELDS + PM_FIT_MOST_EXTRA)

// Lists what a checkpoint holds and returns the number of fields.
static int fields_of(pm_fit *f, pm_checkpoint_field field[MOST_FIELDS]) {
    field[0] = (pm_checkpoint_field){"position", PM_FIT_POSITION, f->position};
    field[1] = (pm_checkpoint_field){"theta", f->size, f->theta};
    field[2] = (pm_checkpoint_field){"moment", 2 * f->size, f->moment};
    field[3] = (pm_checkpoint_field){"best", f->size, f->best};
    memcpy(field + OWN_FIELDS, f->extra, (size_t)f->nextra * sizeof *field);
    return OWN_FIELDS + f->nextra;
}

pm_status pm_fit_save(pm_fit *f, bool loud) {
    pm_checkpoint_field field[MOST_FIELDS];
    const double now = pm_clock();
    f->position[PM_FIT_SECONDS] += now - f->saved;
    f->saved = now;
    if (!pm_team_leads(f->arguments->team)) {
        return PM_OK;
    }
    const int count = fields_of(f, field);
    PM_TRY(pm_checkpoint_save(f->checkpoint, "fit", f->digest, count, field));
    return save_weights(f, loud);
}

// Completed stages and the stage in progress must be the same as in the checkpoint, except for
// their number of iterations.
static pm_status check_stages(const pm_fit *f, const double *own) {
    const int stage = (int)f->position[PM_FIT_STAGE];
    for (int i = 0; i <= stage; ++i) {
        if (stage >= f->training->nstage || f->position[PM_FIT_DIGEST + i] != own[i]) {
            return pm_fail(PM_EFILE, "%s: made by other stages: stage %d of %s has changed since",
                           f->checkpoint, i + 1, f->arguments->config);
        }
    }
    return PM_OK;
}

pm_status pm_fit_load(pm_fit *f) {
    double own[PM_MAX_TRAINING_STAGES];
    pm_checkpoint_field field[MOST_FIELDS];
    memcpy(own, f->position + PM_FIT_DIGEST, sizeof own);
    const int count = fields_of(f, field);
    PM_TRY(pm_checkpoint_load(f->checkpoint, "fit", f->digest, count, field));
    PM_TRY(check_stages(f, own));
    memcpy(f->position + PM_FIT_DIGEST, own, sizeof own);
    if (f->measured != NULL) {
        return PM_OK; // which says where it goes on (learn/fit_measured.h)
    }
    printf("resumes stage %d after %d iterations\n", (int)f->position[PM_FIT_STAGE] + 1,
           (int)f->position[PM_FIT_DONE]);
    return PM_OK;
}
