// Reads the keys `loss` and `stages` of a training file. Every stage begins as a copy of the common
// loss and may override any part of it.
#include "learn/training_stages.h"

#include <math.h>
#include <string.h>

#include "base/digest.h"
#include "learn/stages.h"

#define LOSS_KEYS \
    "residual", "integrator", "substeps", "unroll", "degeneracy", "balance", "robust", "scale"
// The default weight of the energy balance. It is enough to leave minima in which energies are
// wrong by far, where the error of the balance is of order 1 and those of the rates are of order
// 0.01. Larger weights were better on some systems and worse where few trajectories were given.
#define BALANCE 0.01

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory while reading a training file");
}

// --- the loss ---

static pm_status read_integrator(pm_yaml value, pm_arena *arena, const pm_integrator **result) {
    const char *name = NULL;
    PM_TRY(pm_yaml_text(value, arena, &name));
    const pm_integrator *found = pm_integrator_find(name);
    if (found == NULL) {
        return pm_yaml_fail(value, "unknown integrator \"%s\", expected one of: %s", name,
                            pm_integrator_names());
    }
    *result = found;
    return PM_OK;
}

// Reads one number for a group, or one for each of its components.
static pm_status read_group_scale(pm_yaml value, pm_arena *arena, const pm_group *group,
                                  double *scale) {
    int count = 1;
    double number = 0, *list = &number;
    if (pm_yaml_is_list(value)) {
        PM_TRY(pm_yaml_doubles(value, arena, &count, &list));
    } else {
        PM_TRY(pm_yaml_double(value, 0, INFINITY, &number));
    }
    if (count != 1 && count != group->size) {
        return pm_yaml_fail(value, "expected one number, or %d", group->size);
    }
    for (int i = 0; i < count; ++i) {
        if (!(list[i] >= 0)) {
            return pm_yaml_fail(value, "expected numbers >= 0, found %g", list[i]);
        }
    }
    for (int i = 0; i < group->size; ++i) {
        scale[group->first + i] = list[count == 1 ? 0 : i];
    }
    return PM_OK;
}

// Returns the subsystem with this name, or NULL.
static const pm_scene_subsystem *find_subsystem(const pm_scene *scene, const char *name) {
    for (int i = 0; i < scene->nsubsystem; ++i) {
        if (strcmp(scene->subsystem[i].name, name) == 0) {
            return &scene->subsystem[i];
        }
    }
    return NULL;
}

// Reads entry i of a map and the text of its key.
static pm_status read_entry(pm_yaml map, int i, pm_arena *arena, pm_yaml *key, const char **name,
                            pm_yaml *value) {
    pm_yaml_entry(map, i, key, value);
    return pm_yaml_text(*key, arena, name);
}

// Reads {subsystem: {group: scale}} into scale [nz]; groups that are not named get 0.
static pm_status read_scale(pm_yaml map, pm_training *t, const double **result) {
    double *scale = pm_arena_array(&t->arena, (size_t)t->scene->nz, sizeof *scale);
    if (scale == NULL) {
        return no_memory();
    }
    PM_TRY(pm_yaml_require_entries(map));
    for (int i = 0; i < pm_yaml_count(map); ++i) {
        pm_yaml key, groups;
        const char *name;
        PM_TRY(read_entry(map, i, &t->arena, &key, &name, &groups));
        const pm_scene_subsystem *s = find_subsystem(t->scene, name);
        if (s == NULL) {
            return pm_yaml_fail(key, "the scene has no subsystem \"%s\"", name);
        }
        PM_TRY(pm_yaml_require_entries(groups));
        for (int k = 0; k < pm_yaml_count(groups); ++k) {
            pm_yaml value;
            PM_TRY(read_entry(groups, k, &t->arena, &key, &name, &value));
            const pm_group *group = pm_layout_find(&s->layout, name);
            if (group == NULL) {
                return pm_yaml_fail(key, "subsystem %s has no group \"%s\"", s->name, name);
            }
            PM_TRY(read_group_scale(value, &t->arena, group, scale + s->first));
        }
    }
    *result = scale;
    return PM_OK;
}

// Reads the keys of the loss from a block. Settings without a key keep their value.
static pm_status read_loss(pm_yaml block, pm_training *t, pm_loss *loss, int *unroll) {
    pm_arena *arena = &t->arena;
    static const char *const residuals[] = {"step", "derivative", NULL};
    pm_yaml value;
    if (pm_yaml_exists(value = pm_yaml_get(block, "residual"))) {
        int choice = 0;
        PM_TRY(pm_yaml_choice(value, residuals, &choice));
        loss->residual = (pm_residual)choice;
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "integrator"))) {
        PM_TRY(read_integrator(value, arena, &loss->integrator));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "substeps"))) {
        PM_TRY(pm_yaml_int(value, 1, 1000, &loss->substeps));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "unroll"))) {
        PM_TRY(pm_yaml_int(value, 1, 1000, unroll));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "degeneracy"))) {
        PM_TRY(pm_yaml_double(value, 0, 1e12, &loss->degeneracy));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "balance"))) {
        PM_TRY(pm_yaml_double(value, 0, 1e6, &loss->balance));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "robust"))) {
        PM_TRY(pm_yaml_double(value, 0, 1e6, &loss->robust));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "scale"))) {
        PM_TRY(read_scale(value, t, &loss->scale));
    }
    return PM_OK;
}

// --- the stages ---

static pm_status read_rates(pm_yaml value, pm_arena *arena, pm_schedule *schedule) {
    int count = 0;
    double *rate = NULL;
    PM_TRY(pm_yaml_doubles(value, arena, &count, &rate));
    if (count > 2 || rate[0] <= 0 || rate[count - 1] <= 0) {
        return pm_yaml_fail(value, "expected one or two numbers > 0 (first and last)");
    }
    schedule->first_rate = rate[0];
    schedule->last_rate = rate[count - 1];
    return PM_OK;
}

static pm_status read_stage(pm_training *t, pm_yaml block, pm_stage *stage) {
    static const char *const keys[] = {"optimiser", "iterations", "batch",   "rate", "beta2",
                                       "decay",     "memory",     LOSS_KEYS, NULL};
    PM_TRY(pm_yaml_allow(block, keys));
    pm_yaml value;
    const char *name = NULL;
    PM_TRY(pm_yaml_require(block, "optimiser", &value));
    PM_TRY(pm_yaml_text(value, &t->arena, &name));
    stage->optimiser = pm_optimiser_find(name);
    if (stage->optimiser == NULL) {
        return pm_yaml_fail(value, "unknown optimiser \"%s\", expected one of: %s", name,
                            pm_optimiser_names());
    }
    stage->schedule = (pm_schedule){.batch = 256,
                                    .first_rate = 1e-3,
                                    .last_rate = 1e-3,
                                    .beta2 = 0.999,
                                    .memory = 30,
                                    .guarded = !t->plain};
    PM_TRY(pm_yaml_require(block, "iterations", &value));
    PM_TRY(pm_yaml_int(value, 1, 100000000, &stage->schedule.iterations));
    if (pm_yaml_exists(value = pm_yaml_get(block, "batch"))) {
        PM_TRY(pm_yaml_int(value, 1, 1000000, &stage->schedule.batch));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "memory"))) {
        PM_TRY(pm_yaml_int(value, 1, 1000, &stage->schedule.memory));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "beta2"))) {
        PM_TRY(pm_yaml_double(value, 0, 0.999999, &stage->schedule.beta2));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "decay"))) {
        PM_TRY(pm_yaml_double(value, 0, 1000, &stage->schedule.decay));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "rate"))) {
        PM_TRY(read_rates(value, &t->arena, &stage->schedule));
    }
    PM_TRY(read_loss(block, t, &stage->loss, &stage->unroll));
    return !stage->loss.integrator->multirate
               ? PM_OK
               : pm_yaml_fail(block, "integrator %s cannot be trained with; name another one",
                              stage->loss.integrator->name);
}

pm_status pm_training_read_stages(pm_training *t, pm_yaml root) {
    static const char *const loss_keys[] = {LOSS_KEYS, NULL};
    pm_stage common = {.loss = {.residual = PM_RESIDUAL_STEP,
                                .integrator = t->scene->integrator,
                                .substeps = t->scene->substeps,
                                .degeneracy = 1,
                                .balance = t->plain ? 0 : BALANCE},
                       .unroll = 1};
    const pm_yaml loss = pm_yaml_get(root, "loss");
    if (pm_yaml_exists(loss)) {
        PM_TRY(pm_yaml_allow(loss, loss_keys));
        PM_TRY(read_loss(loss, t, &common.loss, &common.unroll));
    }
    pm_yaml stages = pm_yaml_get(root, "stages");
    if ((!t->plain || t->noisy) && (!pm_yaml_exists(stages) || pm_yaml_is_text(stages, "auto"))) {
        if (common.loss.integrator->multirate) {
            return pm_yaml_fail(root,
                                "integrator %s cannot be trained with; name another one under loss",
                                common.loss.integrator->name);
        }
        pm_stages_auto(t, &common);
        return PM_OK;
    }
    PM_TRY(pm_yaml_require(root, "stages", &stages));
    const int count = pm_yaml_count(stages);
    if (!pm_yaml_is_list(stages) || count < 1 || count > PM_MAX_TRAINING_STAGES) {
        return pm_yaml_fail(stages, "expected a list of 1 to %d stages", PM_MAX_TRAINING_STAGES);
    }
    for (int i = 0; i < count; ++i) {
        t->stage[i] = common;
        PM_TRY(read_stage(t, pm_yaml_item(stages, i), &t->stage[i]));
    }
    t->nstage = count;
    return PM_OK;
}

// --- digests ---

static uint32_t digest_stage(const pm_training *t, const pm_stage *s) {
    const double number[] = {s->schedule.first_rate, s->schedule.last_rate, s->schedule.beta2,
                             s->schedule.decay,      s->loss.degeneracy,    s->loss.balance,
                             s->loss.robust};
    const int integer[] = {s->schedule.batch, s->schedule.memory, s->unroll, s->loss.substeps,
                           (int)s->loss.residual};
    uint64_t digest = pm_digest_text(PM_DIGEST_INIT, s->optimiser->name);
    digest = pm_digest_text(digest, s->loss.integrator->name);
    if (s->loss.scale != NULL) {
        digest = pm_digest_doubles(digest, s->loss.scale, (size_t)t->scene->nz);
    }
    digest = pm_digest_doubles(digest, number, sizeof number / sizeof *number);
    for (size_t k = 0; k < sizeof integer / sizeof *integer; ++k) {
        digest = pm_digest_integer(digest, integer[k]);
    }
    return (uint32_t)(digest ^ (digest >> 32));
}

void pm_training_digest_stages(pm_training *training) {
    for (int i = 0; i < training->nstage; ++i) {
        training->stage_digest[i] = digest_stage(training, &training->stage[i]);
    }
}
