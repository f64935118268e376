// Reads a whole scene and its plain settings. scene_subsystem.c reads subsystems,
// scene_boundary_input.c boundary inputs, scene_port.c ports, scene_process.c processes; all of
// them use scene_yaml.c, scene_names.c and scene_lookup.c. Each reader checks its own section.
// Settings that refer to other subsystems (relative_to, ports) are read after all subsystems.
#include "scene/scene.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "scene/integrator.h"
#include "scene/scene_reader.h"

// --- sections of plain settings ---

static pm_status read_url(pm_scene_reader *r) {
    const pm_yaml value = pm_yaml_get(r->root, "url");
    if (!pm_yaml_exists(value)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_text(value, r->arena, &r->scene->url));
    return pm_scene_read_at(r, value, &r->scene->url_at);
}

// Reads the patterns of the channels that are repeated for listeners.
static pm_status read_tap(pm_scene_reader *r) {
    const pm_yaml value = pm_yaml_get(r->root, "tap");
    return pm_yaml_exists(value) ? pm_yaml_texts(value, r->arena, &r->scene->ntap, &r->scene->tap)
                                 : PM_OK;
}

static pm_status read_key_file(pm_scene_reader *r) {
    const pm_yaml value = pm_yaml_get(r->root, "key_file");
    if (!pm_yaml_exists(value)) {
        return PM_OK;
    }
    PM_TRY(pm_scene_read_path(r, value, &r->scene->key_file));
    return pm_scene_read_at(r, value, &r->scene->key_file_at);
}

static pm_status read_integrator(pm_scene_reader *r, pm_yaml time) {
    pm_scene *scene = r->scene;
    pm_yaml value;
    PM_TRY(pm_yaml_require(time, "integrator", &value));
    const char *name = NULL;
    PM_TRY(pm_yaml_text(value, r->arena, &name));
    PM_TRY(pm_scene_read_at(r, value, &scene->integrator_at));
    scene->integrator = pm_integrator_find(name);
    return scene->integrator != NULL ? PM_OK
                                     : pm_yaml_fail(value, "expected one of %s, found \"%.64s\"",
                                                    pm_integrator_names(), name);
}

static pm_status read_time(pm_scene_reader *r) {
    static const char *const keys[] = {"dt",        "steps", "integrator", "substeps",
                                       "tolerance", "pace",  NULL};
    pm_scene *scene = r->scene;
    pm_yaml time, value;
    PM_TRY(pm_yaml_require(r->root, "time", &time));
    PM_TRY(pm_yaml_allow(time, keys));
    PM_TRY(pm_yaml_require(time, "dt", &value));
    PM_TRY(pm_yaml_double(value, DBL_MIN, INFINITY, &scene->dt));
    PM_TRY(pm_yaml_require(time, "steps", &value));
    PM_TRY(pm_yaml_int(value, 1, 1000000000, &scene->steps));
    PM_TRY(read_integrator(r, time));
    scene->substeps = 1;
    value = pm_yaml_get(time, "substeps");
    if (pm_yaml_exists(value)) {
        PM_TRY(pm_yaml_int(value, 1, 100000, &scene->substeps));
    }
    value = pm_yaml_get(time, "pace");
    if (pm_yaml_exists(value)) {
        PM_TRY(pm_yaml_double(value, DBL_MIN, INFINITY, &scene->pace));
    }
    value = pm_yaml_get(time, "tolerance");
    return pm_yaml_exists(value) ? pm_yaml_double(value, DBL_MIN, 1, &scene->tolerance) : PM_OK;
}

static pm_status read_laws(pm_scene_reader *r) {
    static const char *const keys[] = {"energy", "entropy", NULL};
    r->scene->energy_tolerance = 1e-12;
    r->scene->entropy_tolerance = 1e-12;
    const pm_yaml laws = pm_yaml_get(r->root, "laws");
    if (!pm_yaml_exists(laws)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_allow(laws, keys));
    const pm_yaml energy = pm_yaml_get(laws, "energy");
    if (pm_yaml_exists(energy)) {
        PM_TRY(pm_yaml_double(energy, 0, INFINITY, &r->scene->energy_tolerance));
    }
    const pm_yaml entropy = pm_yaml_get(laws, "entropy");
    return pm_yaml_exists(entropy)
               ? pm_yaml_double(entropy, 0, INFINITY, &r->scene->entropy_tolerance)
               : PM_OK;
}

static pm_status read_guards(pm_scene_reader *r) {
    static const char *const keys[] = {"energy_drift", "training_range", NULL};
    r->scene->largest_drift = r->scene->largest_departure = INFINITY;
    const pm_yaml guards = pm_yaml_get(r->root, "guards");
    if (!pm_yaml_exists(guards)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_allow(guards, keys));
    const pm_yaml drift = pm_yaml_get(guards, "energy_drift");
    if (pm_yaml_exists(drift)) {
        PM_TRY(pm_yaml_double(drift, DBL_MIN, INFINITY, &r->scene->largest_drift));
    }
    const pm_yaml range = pm_yaml_get(guards, "training_range");
    return pm_yaml_exists(range) ? pm_yaml_double(range, 0, INFINITY, &r->scene->largest_departure)
                                 : PM_OK;
}

static pm_status read_lockstep(pm_scene_reader *r) {
    static const char *const keys[] = {"window", "patience", "checkpoint", NULL};
    r->scene->window = 1;
    r->scene->patience = 10;
    r->scene->checkpoint = 100;
    const pm_yaml lockstep = pm_yaml_get(r->root, "lockstep");
    if (!pm_yaml_exists(lockstep)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_allow(lockstep, keys));
    const pm_yaml window = pm_yaml_get(lockstep, "window");
    if (pm_yaml_exists(window)) {
        PM_TRY(pm_yaml_int(window, 1, 1000000, &r->scene->window));
    }
    const pm_yaml checkpoint = pm_yaml_get(lockstep, "checkpoint");
    if (pm_yaml_exists(checkpoint)) {
        PM_TRY(pm_yaml_int(checkpoint, 1, 1000000000, &r->scene->checkpoint));
    }
    const pm_yaml patience = pm_yaml_get(lockstep, "patience");
    return pm_yaml_exists(patience) ? pm_yaml_double(patience, DBL_MIN, 1e6, &r->scene->patience)
                                    : PM_OK;
}

static pm_status read_reference(pm_scene_reader *r) {
    static const char *const keys[] = {"file", "trajectory", "estimate", NULL};
    const pm_yaml reference = pm_yaml_get(r->root, "reference");
    if (!pm_yaml_exists(reference)) {
        return PM_OK;
    }
    pm_yaml file;
    PM_TRY(pm_yaml_allow(reference, keys));
    PM_TRY(pm_yaml_require(reference, "file", &file));
    PM_TRY(pm_scene_read_path(r, file, &r->scene->reference));
    PM_TRY(pm_scene_read_at(r, file, &r->scene->reference_at));
    const pm_yaml estimate = pm_yaml_get(reference, "estimate");
    if (pm_yaml_exists(estimate)) {
        PM_TRY(pm_yaml_double(estimate, DBL_MIN, 1e9, &r->scene->reference_estimate));
    }
    const pm_yaml trajectory = pm_yaml_get(reference, "trajectory");
    const bool named = pm_yaml_exists(trajectory);
    PM_TRY(pm_scene_read_at(r, named ? trajectory : reference, &r->scene->reference_trajectory_at));
    return named ? pm_yaml_int(trajectory, 0, 1000000000, &r->scene->reference_trajectory) : PM_OK;
}

static pm_status check_tolerance(pm_scene_reader *r) {
    const pm_yaml tolerance = pm_yaml_get(pm_yaml_get(r->root, "time"), "tolerance");
    return r->scene->tolerance > 0 && r->scene->window > 1
               ? pm_yaml_fail(tolerance, "each step tells how long the next one's substeps are: "
                                         "expected a lockstep window of 1")
               : PM_OK;
}

// --- the whole ---

static pm_status read_scene(pm_scene_reader *r) {
    static const char *const keys[] = {
        "scene",    "url",    "key_file",     "time",        "subsystems", "boundary_inputs",
        "models",   "ports",  "processes",    "reference",   "laws",       "guards",
        "lockstep", "record", "observations", "live_inputs", "tap",        NULL};
    pm_yaml value;
    PM_TRY(pm_yaml_allow(r->root, keys));
    PM_TRY(pm_yaml_require(r->root, "scene", &value));
    PM_TRY(pm_scene_read_name(r, value, &r->scene->name));
    PM_TRY(read_url(r));
    PM_TRY(read_tap(r));
    PM_TRY(read_key_file(r));
    PM_TRY(read_time(r));
    PM_TRY(pm_scene_read_subsystems(r));
    PM_TRY(pm_scene_read_boundary_inputs(r));
    PM_TRY(pm_scene_read_ports(r));
    PM_TRY(pm_scene_read_observations(r));
    PM_TRY(read_reference(r));
    PM_TRY(read_laws(r));
    PM_TRY(read_guards(r));
    PM_TRY(read_lockstep(r));
    PM_TRY(pm_scene_read_live_inputs(r));
    PM_TRY(pm_scene_read_record(r));
    PM_TRY(check_tolerance(r));
    return pm_scene_read_processes(r);
}

static pm_status scene_from(pm_scene **result, pm_yaml root, const char *path) {
    pm_scene *scene = calloc(1, sizeof *scene);
    if (scene == NULL) {
        return pm_scene_no_memory();
    }
    pm_scene_reader r = {.scene = scene, .arena = &scene->arena, .root = root};
    scene->path = pm_arena_strdup(&scene->arena, path);
    const pm_status status = scene->path == NULL ? pm_scene_no_memory() : read_scene(&r);
    if (status != PM_OK) {
        pm_scene_free(scene);
        return status;
    }
    *result = scene;
    return PM_OK;
}

pm_status pm_scene_load(pm_scene **scene, const char *path) {
    pm_yaml_document *document;
    pm_yaml root;
    PM_TRY(pm_yaml_open(&document, path, &root));
    const pm_status status = scene_from(scene, root, path);
    pm_yaml_close(document);
    return status;
}

pm_status pm_scene_parse(pm_scene **scene, const char *text, const char *path) {
    pm_yaml_document *document;
    pm_yaml root;
    PM_TRY(pm_yaml_parse(&document, text, path, &root));
    const pm_status status = scene_from(scene, root, path);
    pm_yaml_close(document);
    return status;
}

void pm_scene_free(pm_scene *scene) {
    if (scene != NULL) {
        pm_arena_free(&scene->arena);
        free(scene);
    }
}
