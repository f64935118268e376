// Reading training files.
#include "learn/training.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/digest.h"
#include "learn/defaults.h"
#include "learn/stages.h"
#include "scene/model_reader.h"

// Starts to choose from, and their first iterations.
#define DEFAULT_TRIES 8
#define DEFAULT_TRY_ITERATIONS 10
#define MOST_WEIGHTS_OF_STARTS 3000

#define LOSS_KEYS "residual", "integrator", "substeps", "unroll", "degeneracy", "robust", "scale"

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory while reading a training file");
}

// `path` as written in the training file, resolved against its folder.
static const char *resolve(pm_training *t, const char *path) {
    const char *slash = strrchr(t->path, '/');
    if (path[0] == '/' || slash == NULL) {
        return path;
    }
    return pm_arena_printf(&t->arena, "%.*s/%s", (int)(slash - t->path), t->path, path);
}

// --- models ---

// The block of `models` that component `name` is mapped to by `mapping`.
static pm_status find_model(pm_yaml root, pm_yaml mapping, const char *name, pm_arena *arena,
                            pm_yaml *model) {
    pm_yaml choice, models;
    const char *text = NULL;
    PM_TRY(pm_yaml_require(mapping, name, &choice));
    PM_TRY(pm_yaml_text(choice, arena, &text));
    PM_TRY(pm_yaml_require(root, "models", &models));
    *model = pm_yaml_get(models, text);
    if (!pm_yaml_exists(*model)) {
        return pm_yaml_fail(choice, "there is no model \"%s\" under models", text);
    }
    return PM_OK;
}

static pm_status check_names(pm_yaml mapping, const char *what, const pm_scene *scene,
                             int (*find)(const pm_scene *, const char *), pm_arena *arena) {
    for (int i = 0; i < pm_yaml_count(mapping); ++i) {
        const char *name = NULL;
        pm_yaml key, value;
        pm_yaml_entry(mapping, i, &key, &value);
        PM_TRY(pm_yaml_text(key, arena, &name));
        if (find(scene, name) < 0) {
            return pm_yaml_fail(key, "the scene %s has no %s \"%s\"", scene->path, what, name);
        }
    }
    return PM_OK;
}

// A model may serve several components: the error, which has its place, tells which one it was.
static pm_status name_component(pm_status status, const char *name) {
    return status == PM_ECONFIG ? pm_fail(status, "%s (model of %s)", pm_error(), name) : status;
}

// What the scene knows is not learned.
static pm_status check_unnamed(pm_yaml mapping, const char *name) {
    const pm_yaml choice = pm_yaml_get(mapping, name);
    return pm_yaml_exists(choice) ? pm_yaml_fail(choice, "the scene itself has a model of %s", name)
                                  : PM_OK;
}

static pm_status read_part(pm_training *t, pm_yaml root, pm_yaml mapping, int id) {
    const pm_scene_subsystem *scene = &t->scene->subsystem[id];
    pm_part *part = &t->system->part[id];
    pm_yaml model;
    if (scene->model != NULL) {
        PM_TRY(check_unnamed(mapping, scene->name));
        return pm_system_declare_part(t->system, id);
    }
    PM_TRY(find_model(root, mapping, scene->name, &t->arena, &model));
    part->layout = scene->layout;
    PM_TRY(pm_part_spec_read(model, (pm_yaml){0}, &t->arena, &part->spec));
    PM_TRY(t->plain ? PM_OK : pm_default_part(&part->spec, &part->layout, &t->arena));
    const pm_status status = pm_part_declare(part);
    return name_component(status, scene->name);
}

static pm_status read_port(pm_training *t, pm_yaml root, pm_yaml mapping, int id) {
    const pm_scene_port *scene = &t->scene->port[id];
    pm_port_model *port = &t->system->port[id];
    pm_yaml model;
    if (scene->model != NULL) {
        PM_TRY(check_unnamed(mapping, scene->name));
        return pm_system_declare_port(t->system, id);
    }
    PM_TRY(find_model(root, mapping, scene->name, &t->arena, &model));
    port->layout[0] = scene->layout[0];
    port->layout[1] = scene->layout[1];
    PM_TRY(pm_port_spec_read(model, (pm_yaml){0}, &t->arena, &port->spec));
    if (strcmp(port->spec.law, scene->law) != 0) {
        return pm_yaml_fail(model, "law %s, but port %s of the scene %s has law %s", port->spec.law,
                            scene->name, t->scene->path, scene->law);
    }
    PM_TRY(t->plain ? PM_OK : pm_default_port(&port->spec, t->system, id, &t->arena));
    PM_TRY(name_component(pm_port_declare(port), scene->name));
    return name_component(pm_spec_locate(port->spec.at, pm_params_check_given(&port->params)),
                          scene->name);
}

static pm_status read_models(pm_training *t, pm_yaml root) {
    pm_yaml parts = {0}, ports = pm_yaml_get(root, "ports");
    PM_TRY(pm_yaml_require(root, "subsystems", &parts));
    PM_TRY(check_names(parts, "subsystem", t->scene, pm_scene_find_subsystem, &t->arena));
    PM_TRY(check_names(ports, "port", t->scene, pm_scene_find_port, &t->arena));
    for (int i = 0; i < t->scene->nsubsystem; ++i) {
        PM_TRY(read_part(t, root, parts, i));
    }
    for (int i = 0; i < t->scene->nport; ++i) {
        PM_TRY(read_port(t, root, ports, i));
    }
    return PM_OK;
}

// --- stages ---

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

// One number for a group, or one for each of its components.
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

// What is called so, or NULL.
static const pm_scene_subsystem *find_subsystem(const pm_scene *scene, const char *name) {
    for (int i = 0; i < scene->nsubsystem; ++i) {
        if (strcmp(scene->subsystem[i].name, name) == 0) {
            return &scene->subsystem[i];
        }
    }
    return NULL;
}

// Entry i of a map and the text of its key.
static pm_status read_entry(pm_yaml map, int i, pm_arena *arena, pm_yaml *key, const char **name,
                            pm_yaml *value) {
    pm_yaml_entry(map, i, key, value);
    return pm_yaml_text(*key, arena, name);
}

// {subsystem: {group: scale}}; 0 for what is not named.
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

// What a block says about the loss; what it does not say stays.
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
        PM_TRY(pm_yaml_int(value, 1, 100, unroll));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "degeneracy"))) {
        PM_TRY(pm_yaml_double(value, 0, 1e12, &loss->degeneracy));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "robust"))) {
        PM_TRY(pm_yaml_double(value, 0, 1e6, &loss->robust));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "scale"))) {
        PM_TRY(read_scale(value, t, &loss->scale));
    }
    return PM_OK;
}

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
    static const char *const keys[] = {"optimiser", "iterations", "batch",   "rate",
                                       "beta2",     "memory",     LOSS_KEYS, NULL};
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
    if (pm_yaml_exists(value = pm_yaml_get(block, "rate"))) {
        PM_TRY(read_rates(value, &t->arena, &stage->schedule));
    }
    PM_TRY(read_loss(block, t, &stage->loss, &stage->unroll));
    return !stage->loss.integrator->multirate
               ? PM_OK
               : pm_yaml_fail(block, "integrator %s steps, but does not train: name another",
                              stage->loss.integrator->name);
}

static pm_status read_stages(pm_training *t, pm_yaml root) {
    static const char *const loss_keys[] = {LOSS_KEYS, NULL};
    pm_stage common = {.loss = {.residual = PM_RESIDUAL_STEP,
                                .integrator = t->scene->integrator,
                                .substeps = t->scene->substeps,
                                .degeneracy = 1},
                       .unroll = 1};
    const pm_yaml loss = pm_yaml_get(root, "loss");
    if (pm_yaml_exists(loss)) {
        PM_TRY(pm_yaml_allow(loss, loss_keys));
        PM_TRY(read_loss(loss, t, &common.loss, &common.unroll));
    }
    pm_yaml stages = pm_yaml_get(root, "stages");
    if (!t->plain && (!pm_yaml_exists(stages) || pm_yaml_is_text(stages, "auto"))) {
        if (common.loss.integrator->multirate) {
            return pm_yaml_fail(root,
                                "integrator %s steps, but does not train: name another in loss",
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

// How many starts to choose from: by default several, where a short fit of each is affordable.
static pm_status read_start(pm_training *t, pm_yaml block) {
    static const char *const keys[] = {"tries", "iterations", NULL};
    size_t weights = 0;
    bool drawn = false; // whether starts differ at all
    for (int i = 0; i < pm_system_components(t->system); ++i) {
        const pm_params *params = pm_system_params(t->system, i);
        weights += pm_params_trained(params);
        for (int k = 0; k < params->count; ++k) {
            drawn = drawn || (params->entry[k].trained && params->entry[k].spread > 0);
        }
    }
    t->tries = t->plain || !drawn || weights > MOST_WEIGHTS_OF_STARTS ? 1 : DEFAULT_TRIES;
    t->try_iterations = DEFAULT_TRY_ITERATIONS;
    if (!pm_yaml_exists(block)) {
        return PM_OK;
    }
    pm_yaml value;
    PM_TRY(pm_yaml_allow(block, keys));
    if (pm_yaml_exists(value = pm_yaml_get(block, "tries"))) {
        PM_TRY(pm_yaml_int(value, 1, 1000, &t->tries));
    }
    return pm_yaml_exists(value = pm_yaml_get(block, "iterations"))
               ? pm_yaml_int(value, 1, 10000, &t->try_iterations)
               : PM_OK;
}

// --- the file ---

// A text and its place, if it is there.
static pm_status read_placed(pm_training *t, pm_yaml block, const char *key, const char **text,
                             const char **at) {
    const pm_yaml value = pm_yaml_get(block, key);
    if (!pm_yaml_exists(value)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_text(value, &t->arena, text));
    *at = pm_yaml_where(value, &t->arena);
    return *at == NULL ? no_memory() : PM_OK;
}

static pm_status read_data(pm_training *t, pm_yaml root) {
    static const char *const keys[] = {"file", "trajectories", "validation", NULL};
    const pm_yaml data = pm_yaml_get(root, "data");
    PM_TRY(pm_yaml_exists(data) ? pm_yaml_allow(data, keys) : PM_OK);
    PM_TRY(read_placed(t, data, "file", &t->data, &t->data_at));
    t->data = t->data == NULL ? NULL : resolve(t, t->data);
    PM_TRY(t->data_at != NULL && t->data == NULL ? no_memory() : PM_OK);
    PM_TRY(read_placed(t, data, "trajectories", &t->trajectories, &t->trajectories_at));
    return read_placed(t, data, "validation", &t->validation, &t->validation_at);
}

static uint32_t digest_stage(const pm_training *t, const pm_stage *s) {
    const double number[] = {s->schedule.first_rate, s->schedule.last_rate, s->schedule.beta2,
                             s->loss.degeneracy, s->loss.robust};
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

static pm_status make_digest(pm_training *t) {
    uint64_t digest = pm_digest_integer(PM_DIGEST_INIT, (int64_t)t->seed);
    digest = pm_digest_integer(digest, t->square);
    digest = pm_digest_integer(digest, t->plain);
    digest = pm_digest_integer(digest, t->tries);
    digest = pm_digest_integer(digest, t->try_iterations);
    for (int i = 0; i < t->scene->nsubsystem; ++i) {
        const char *text = pm_part_spec_write(&t->system->part[i].spec, &t->arena);
        digest = pm_digest_text(digest, text == NULL ? "" : text);
    }
    for (int i = 0; i < t->scene->nport; ++i) {
        const char *text = pm_port_spec_write(&t->system->port[i].spec, &t->arena);
        digest = pm_digest_text(digest, text == NULL ? "" : text);
    }
    for (int i = 0; i < t->nstage; ++i) {
        t->stage_digest[i] = digest_stage(t, &t->stage[i]);
    }
    t->digest = pm_digest_integer(digest, t->plain);
    return PM_OK;
}

// What is wrong inside the scene has its place there.
static pm_status load_scene(pm_training *t, pm_yaml at, const char *path) {
    const pm_status status = pm_scene_load(&t->scene, path);
    if (status != PM_EFILE) {
        return status;
    }
    const char *where = pm_yaml_where(at, &t->arena);
    return where == NULL ? no_memory() : pm_fail(status, "%s: %s", where, pm_error());
}

static pm_status read_all(pm_training *t, pm_yaml root) {
    static const char *const keys[] = {"scene",      "data",     "seed",  "models",
                                       "subsystems", "ports",    "loss",  "symmetry",
                                       "stages",     "defaults", "start", NULL};
    static const char *const sections[] = {"any", "square", NULL};
    static const char *const defaults[] = {"physical", "plain", NULL};
    PM_TRY(pm_yaml_allow(root, keys));
    pm_yaml value;
    const char *scene = NULL;
    PM_TRY(pm_yaml_require(root, "scene", &value));
    PM_TRY(pm_yaml_text(value, &t->arena, &scene));
    scene = resolve(t, scene);
    if (scene == NULL) {
        return no_memory();
    }
    PM_TRY(load_scene(t, value, scene));
    PM_TRY(pm_system_new(&t->system, t->scene));
    int seed = 1;
    if (pm_yaml_exists(value = pm_yaml_get(root, "seed"))) {
        PM_TRY(pm_yaml_int(value, 0, 2147483647, &seed));
    }
    t->seed = (uint64_t)seed;
    if (pm_yaml_exists(value = pm_yaml_get(root, "symmetry"))) {
        int section = 0;
        PM_TRY(pm_yaml_choice(value, sections, &section));
        t->square = section == 1;
    }
    if (pm_yaml_exists(value = pm_yaml_get(root, "defaults"))) {
        int choice = 0;
        PM_TRY(pm_yaml_choice(value, defaults, &choice));
        t->plain = choice == 1;
    }
    PM_TRY(read_data(t, root));
    PM_TRY(read_models(t, root));
    PM_TRY(pm_system_check_boundary_inputs(t->system));
    PM_TRY(read_stages(t, root));
    PM_TRY(read_start(t, pm_yaml_get(root, "start")));
    return make_digest(t);
}

pm_status pm_training_load(pm_training **training, const char *path) {
    pm_training *t = calloc(1, sizeof *t);
    if (t == NULL) {
        return no_memory();
    }
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_status status = PM_OK;
    t->path = pm_arena_strdup(&t->arena, path);
    if (t->path == NULL) {
        status = no_memory();
        goto done;
    }
    PM_TRY_DONE(pm_yaml_open(&document, path, &root));
    PM_TRY_DONE(read_all(t, root));
    *training = t;
    t = NULL;
done:
    pm_yaml_close(document);
    pm_training_free(t);
    return status;
}

void pm_training_free(pm_training *training) {
    if (training != NULL) {
        pm_system_free(training->system);
        pm_scene_free(training->scene);
        pm_arena_free(&training->arena);
        free(training);
    }
}
