// Reads a training file from its top level: the scene, the data, the models of all subsystems and
// ports, and the number of starts. learn/training_stages.c reads `loss` and `stages`.
#include "learn/training.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/digest.h"
#include "learn/defaults.h"
#include "learn/training_stages.h"
#include "scene/model_reader.h"

// The number of initial draws, and the iterations of each in the first round.
#define DEFAULT_TRIES 8
#define DEFAULT_TRY_ITERATIONS 10
#define MOST_WEIGHTS_OF_STARTS 3000

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory while reading a training file");
}

// Resolves a path of the training file against its folder.
static const char *resolve(pm_training *t, const char *path) {
    const char *slash = strrchr(t->path, '/');
    if (path[0] == '/' || slash == NULL) {
        return path;
    }
    return pm_arena_printf(&t->arena, "%.*s/%s", (int)(slash - t->path), t->path, path);
}

// --- models ---

// Finds the block of `models` that `mapping` names for the component `name`.
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

// Adds the component's name to an error, since several components may use one model.
static pm_status name_component(pm_status status, const char *name) {
    return status == PM_ECONFIG ? pm_fail(status, "%s (model of %s)", pm_error(), name) : status;
}

// Checks that a component whose model the scene defines has no model in the training file.
static pm_status check_unnamed(pm_yaml mapping, const char *name) {
    const pm_yaml choice = pm_yaml_get(mapping, name);
    return pm_yaml_exists(choice) ? pm_yaml_fail(choice, "the scene itself has a model of %s", name)
                                  : PM_OK;
}

static pm_status read_part(pm_training *t, pm_yaml root, pm_yaml mapping, int id) {
    const pm_scene_subsystem *scene = &t->scene->subsystem[id];
    pm_part *part = t->system->part[id];
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
    pm_port_model *port = t->system->port[id];
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

// Makes one weight of the shared numbers of all components.
void pm_training_share(pm_system *system) {
    for (int i = 1; i < pm_system_components(system); ++i) {
        for (int k = 0; k < i; ++k) {
            pm_params_share(pm_system_params(system, i), pm_system_params(system, k));
        }
    }
}

// Reads the number of random draws. By default there are several, if they differ and if a short fit
// of each is affordable.
static pm_status read_start(pm_training *t, pm_yaml block) {
    static const char *const keys[] = {"tries", "iterations", NULL};
    size_t weights = 0;
    bool drawn = false; // whether random draws differ at all
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

// Reads an optional text and its place.
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
    static const char *const keys[] = {"file",     "trajectories", "validation",
                                       "data_set", "seconds",      NULL};
    const pm_yaml data = pm_yaml_get(root, "data");
    PM_TRY(pm_yaml_exists(data) ? pm_yaml_allow(data, keys) : PM_OK);
    PM_TRY(read_placed(t, data, "file", &t->data, &t->data_at));
    t->data = t->data == NULL ? NULL : resolve(t, t->data);
    PM_TRY(t->data_at != NULL && t->data == NULL ? no_memory() : PM_OK);
    const char *unused = NULL;
    const pm_yaml seconds = pm_yaml_get(data, "seconds");
    t->seconds = INFINITY;
    PM_TRY(pm_yaml_exists(seconds) ? pm_yaml_double(seconds, DBL_MIN, INFINITY, &t->seconds)
                                   : PM_OK);
    PM_TRY(read_placed(t, data, "data_set", &t->data_set, &unused));
    PM_TRY(read_placed(t, data, "trajectories", &t->trajectories, &t->trajectories_at));
    return read_placed(t, data, "validation", &t->validation, &t->validation_at);
}

// Reads `noise: estimated` or the noise of single columns.
static pm_status read_noise(pm_training *t, pm_yaml block) {
    t->noisy = pm_yaml_exists(block);
    if (!t->noisy || pm_yaml_is_text(block, "estimated")) {
        return PM_OK;
    }
    if (!pm_yaml_is_map(block)) {
        return pm_yaml_fail(block, "expected \"estimated\", or columns with their noise");
    }
    const size_t count = (size_t)pm_yaml_count(block);
    t->noise_column = pm_arena_array(&t->arena, count + 1, sizeof *t->noise_column);
    t->noise = pm_arena_array(&t->arena, count + 1, sizeof *t->noise);
    t->noise_at = pm_yaml_where(block, &t->arena);
    if (t->noise_column == NULL || t->noise == NULL || t->noise_at == NULL) {
        return no_memory();
    }
    for (; t->nnoise < (int)count; ++t->nnoise) {
        pm_yaml key, value;
        pm_yaml_entry(block, t->nnoise, &key, &value);
        PM_TRY(pm_yaml_text(key, &t->arena, &t->noise_column[t->nnoise]));
        PM_TRY(pm_yaml_double(value, DBL_MIN, INFINITY, &t->noise[t->nnoise]));
    }
    return PM_OK;
}

bool pm_training_hides(const pm_training *training) {
    const pm_scene *scene = training->scene;
    bool hidden = false;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        for (int k = 0; k < scene->subsystem[i].layout.ngroup; ++k) {
            hidden = hidden || scene->subsystem[i].hidden[k];
        }
    }
    return hidden;
}

bool pm_training_is_measured(const pm_training *training) {
    return training->noisy || training->scene->nobservation > 0 || pm_training_hides(training);
}

static pm_status make_digest(pm_training *t) {
    uint64_t digest = pm_digest_integer(PM_DIGEST_INIT, (int64_t)t->seed);
    digest = pm_digest_integer(digest, t->plain);
    digest = pm_digest_integer(digest, t->tries);
    digest = pm_digest_integer(digest, t->try_iterations);
    for (int i = 0; i < t->scene->nsubsystem; ++i) {
        const char *text = pm_part_spec_write(&t->system->part[i]->spec, &t->arena);
        digest = pm_digest_text(digest, text == NULL ? "" : text);
    }
    for (int i = 0; i < t->scene->nport; ++i) {
        const char *text = pm_port_spec_write(&t->system->port[i]->spec, &t->arena);
        digest = pm_digest_text(digest, text == NULL ? "" : text);
    }
    pm_training_digest_stages(t);
    t->digest = pm_digest_integer(digest, t->plain);
    return PM_OK;
}

// Loads the scene. Errors inside it name their place there; a missing file names the place of its
// path.
static pm_status load_scene(pm_training *t, pm_yaml at, const char *path) {
    const pm_status status = pm_scene_load(&t->scene, path);
    if (status != PM_EFILE) {
        return status;
    }
    const char *where = pm_yaml_where(at, &t->arena);
    return where == NULL ? no_memory() : pm_fail(status, "%s: %s", where, pm_error());
}

static pm_status read_all(pm_training *t, pm_yaml root) {
    static const char *const keys[] = {"scene",      "data",  "seed",  "models",
                                       "subsystems", "ports", "loss",  "stages",
                                       "defaults",   "start", "noise", NULL};
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
    if (pm_yaml_exists(value = pm_yaml_get(root, "defaults"))) {
        int choice = 0;
        PM_TRY(pm_yaml_choice(value, defaults, &choice));
        t->plain = choice == 1;
    }
    PM_TRY(read_data(t, root));
    PM_TRY(read_noise(t, pm_yaml_get(root, "noise")));
    PM_TRY(read_models(t, root));
    pm_training_share(t->system);
    PM_TRY(pm_system_check_boundary_inputs(t->system));
    PM_TRY(pm_training_read_stages(t, root));
    value = pm_yaml_get(root, "stages");
    if (pm_training_is_measured(t) && pm_yaml_exists(value) && !pm_yaml_is_text(value, "auto")) {
        return pm_yaml_fail(value, "a fit to measurements has no stages (noise, hidden groups or "
                                   "observations make it one)");
    }
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
