// Joins a scene with its weights: loads every file and compares it with the scene's declarations.
#include "scene/system.h"

#include <stdlib.h>
#include <string.h>

#include "base/digest.h"

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory while loading a system");
}

// Writes a layout as "q[2] in m, p[2] in kg m/s" into the arena, for messages.
static const char *describe(const pm_layout *layout, pm_arena *arena) {
    const char *text = "";
    for (int i = 0; i < layout->ngroup && text != NULL; ++i) {
        const pm_group *group = &layout->group[i];
        text = pm_arena_printf(arena, "%s%s%s[%d] in %s", text, i == 0 ? "" : ", ", group->name,
                               group->size, group->unit);
    }
    return text == NULL ? "?" : text;
}

// Compares the layout in a weights file with the layout in the scene. `who` names the subsystem or
// the end of a port; `at` is its place in the scene.
static pm_status check_layout(const pm_layout *declared, const pm_layout *own, const char *at,
                              const char *who, const char *path, pm_system *system) {
    if (pm_layout_equal(declared, own)) {
        return PM_OK;
    }
    return pm_fail(PM_EWEIGHTS, "%s: %s: the weights %s are made for %s; the scene says %s", at,
                   who, path, describe(own, &system->arena), describe(declared, &system->arena));
}

// Returns the place of the scene's first group that differs from the group in the weights; without
// a difference, the place of its last group.
static const char *differing_group(const pm_scene_subsystem *subsystem, const pm_layout *own) {
    const pm_layout *declared = &subsystem->layout;
    int i = 0;
    while (i < declared->ngroup - 1 && i < own->ngroup &&
           pm_group_equal(&declared->group[i], &own->group[i])) {
        ++i;
    }
    return subsystem->group_at[i];
}

// Reports that the weights named at a place of the scene could not be loaded.
static pm_status load_failed(pm_status status, const char *at, const char *what, const char *name) {
    return pm_fail(status, "%s: %s %s: %s", at, what, name, pm_error());
}

// --- models ---

// Makes an empty model of its own for a component, with the scene's layouts.
static pm_status make_part(pm_system *system, int id) {
    pm_part *part = pm_arena_array(&system->arena, 1, sizeof *part);
    pm_provenance *provenance = pm_arena_array(&system->arena, 1, sizeof *provenance);
    if (part == NULL || provenance == NULL) {
        return no_memory();
    }
    part->layout = system->scene->subsystem[id].layout;
    system->part[id] = part;
    system->part_provenance[id] = provenance;
    return PM_OK;
}

static pm_status make_port(pm_system *system, int id) {
    pm_port_model *port = pm_arena_array(&system->arena, 1, sizeof *port);
    pm_provenance *provenance = pm_arena_array(&system->arena, 1, sizeof *provenance);
    if (port == NULL || provenance == NULL) {
        return no_memory();
    }
    port->layout[0] = system->scene->port[id].layout[0];
    port->layout[1] = system->scene->port[id].layout[1];
    system->port[id] = port;
    system->port_provenance[id] = provenance;
    return PM_OK;
}

// --- known models ---

// Adds the component's name to an error, since several components may use one model.
static pm_status name_component(pm_status status, const char *name) {
    return status == PM_ECONFIG ? pm_fail(status, "%s (model of %s)", pm_error(), name) : status;
}

// Checks that a known model has all its numbers, since no weights file supplies them.
static pm_status check_known(const pm_params *params, const char *at, const char *name) {
    PM_TRY(name_component(pm_spec_locate(at, pm_params_check_given(params)), name));
    return pm_params_trained(params) == 0
               ? PM_OK
               : pm_fail(PM_ECONFIG,
                         "%s: the model of %s has %zu numbers to be learned: it needs weights", at,
                         name, pm_params_trained(params));
}

pm_status pm_system_declare_part(pm_system *system, int id) {
    const pm_scene_subsystem *subsystem = &system->scene->subsystem[id];
    pm_part *part = system->part[id];
    part->spec = *subsystem->model;
    PM_TRY(name_component(pm_part_declare(part), subsystem->name));
    PM_TRY(check_known(&part->params, subsystem->weights_at, subsystem->name));
    return pm_weights_digest_part(part, &system->part_provenance[id]->digest);
}

pm_status pm_system_declare_port(pm_system *system, int id) {
    const pm_scene_port *port = &system->scene->port[id];
    pm_port_model *model = system->port[id];
    model->spec = *port->model;
    if (strcmp(model->spec.law, port->law) != 0) {
        return pm_fail(PM_ECONFIG, "%s: the model of port %s is one of the law %s", port->law_at,
                       port->name, model->spec.law);
    }
    PM_TRY(name_component(pm_port_declare(model), port->name));
    PM_TRY(check_known(&model->params, port->weights_at, port->name));
    return pm_weights_digest_port(model, &system->port_provenance[id]->digest);
}

// --- weights ---

// Returns the file to load: the scene's path, or the file of the same name in `weights_dir`. NULL:
// out of memory.
static const char *weights_path(const char *path, const char *weights_dir, pm_arena *arena) {
    if (weights_dir == NULL) {
        return path;
    }
    const char *slash = strrchr(path, '/');
    return pm_arena_printf(arena, "%s/%s", weights_dir, slash == NULL ? path : slash + 1);
}

// Checks that weights fit the subsystem that names them.
static pm_status check_part(pm_system *system, int id) {
    const pm_scene_subsystem *subsystem = &system->scene->subsystem[id];
    const pm_layout *own = &system->part[id]->layout;
    if (system->part[id]->spec.solid != NULL || subsystem->mesh != NULL) {
        return pm_system_load_solid(system, id);
    }
    if (pm_layout_equal(&subsystem->layout, own)) {
        return PM_OK;
    }
    const char *who = pm_arena_printf(&system->arena, "subsystem %s", subsystem->name);
    return who == NULL ? no_memory()
                       : check_layout(&subsystem->layout, own, differing_group(subsystem, own), who,
                                      system->part_provenance[id]->path, system);
}

static pm_status load_part(pm_system *system, int id, const char *weights_dir) {
    const pm_scene_subsystem *subsystem = &system->scene->subsystem[id];
    const char *path = weights_path(subsystem->weights, weights_dir, &system->arena);
    if (path == NULL) {
        return no_memory();
    }
    const pm_status status =
        pm_weights_load_part(path, &system->arena, system->part[id], system->part_provenance[id]);
    return status == PM_OK
               ? check_part(system, id)
               : load_failed(status, subsystem->weights_at, "subsystem", subsystem->name);
}

// Checks that weights fit the port that names them.
static pm_status check_port(pm_system *system, int id) {
    const pm_scene *scene = system->scene;
    const pm_scene_port *port = &scene->port[id];
    const pm_port_model *model = system->port[id];
    const char *path = system->port_provenance[id]->path;
    if (strcmp(model->spec.law, port->law) != 0) {
        return pm_fail(PM_EWEIGHTS,
                       "%s: port %s: the weights %s are made for the law %s; the scene says %s",
                       port->law_at, port->name, path, model->spec.law, port->law);
    }
    for (int end = 0; end < 2; ++end) {
        if (pm_layout_equal(&port->layout[end], &model->layout[end])) {
            continue;
        }
        const char *who = pm_arena_printf(&system->arena, "port %s, end %s", port->name,
                                          pm_scene_end_name(scene, port, end));
        if (who == NULL) {
            return no_memory();
        }
        PM_TRY(check_layout(&port->layout[end], &model->layout[end], port->expose_at[end], who,
                            path, system));
    }
    return PM_OK;
}

static pm_status load_port(pm_system *system, int id, const char *weights_dir) {
    const pm_scene_port *port = &system->scene->port[id];
    const char *path = weights_path(port->weights, weights_dir, &system->arena);
    if (path == NULL) {
        return no_memory();
    }
    const pm_status status =
        pm_weights_load_port(path, &system->arena, system->port[id], system->port_provenance[id]);
    return status == PM_OK ? check_port(system, id)
                           : load_failed(status, port->weights_at, "port", port->name);
}

// --- components that share a model ---

// Returns true if two components name the same weights file, or use one reading of a known model.
static bool is_alike(const char *weights, const void *model, const char *other_weights,
                     const void *other_model) {
    return weights == NULL ? model == other_model
                           : weights == other_weights ||
                                 (other_weights != NULL && strcmp(weights, other_weights) == 0);
}

// Makes subsystem `id` use the model of an earlier one that has the same source, and returns true,
// if there is one. `owner` [nowner] lists the owners so far.
static bool share_part(pm_system *system, int id, const int *owner, int nowner) {
    const pm_scene_subsystem *own = &system->scene->subsystem[id];
    for (int i = nowner - 1; i >= 0; --i) {
        const pm_scene_subsystem *other = &system->scene->subsystem[owner[i]];
        if (is_alike(own->weights, own->model, other->weights, other->model) &&
            ((own->model == NULL && own->mesh == NULL) ||
             pm_layout_equal(&own->layout, &other->layout))) {
            system->part_owner[id] = owner[i];
            system->part[id] = system->part[owner[i]];
            system->part_provenance[id] = system->part_provenance[owner[i]];
            return true;
        }
    }
    return false;
}

static bool share_port(pm_system *system, int id, const int *owner, int nowner) {
    const pm_scene_port *own = &system->scene->port[id];
    for (int i = nowner - 1; i >= 0; --i) {
        const pm_scene_port *other = &system->scene->port[owner[i]];
        if (is_alike(own->weights, own->model, other->weights, other->model) &&
            (own->model == NULL || (strcmp(own->law, other->law) == 0 &&
                                    pm_layout_equal(&own->layout[0], &other->layout[0]) &&
                                    pm_layout_equal(&own->layout[1], &other->layout[1])))) {
            system->port_owner[id] = owner[i];
            system->port[id] = system->port[owner[i]];
            system->port_provenance[id] = system->port_provenance[owner[i]];
            return true;
        }
    }
    return false;
}

static pm_status load_parts(pm_system *system, const char *weights_dir) {
    const pm_scene *scene = system->scene;
    int nowner = 0;
    int *owner = pm_arena_array(&system->arena, (size_t)scene->nsubsystem, sizeof *owner);
    if (owner == NULL) {
        return no_memory();
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        if (share_part(system, i, owner, nowner)) {
            PM_TRY(check_part(system, i));
            continue;
        }
        owner[nowner++] = i;
        PM_TRY(make_part(system, i));
        PM_TRY(scene->subsystem[i].model != NULL ? pm_system_declare_part(system, i)
                                                 : load_part(system, i, weights_dir));
    }
    return PM_OK;
}

static pm_status load_ports(pm_system *system, const char *weights_dir) {
    const pm_scene *scene = system->scene;
    int nowner = 0;
    int *owner = pm_arena_array(&system->arena, (size_t)scene->nport, sizeof *owner);
    if (owner == NULL) {
        return no_memory();
    }
    for (int i = 0; i < scene->nport; ++i) {
        if (share_port(system, i, owner, nowner)) {
            PM_TRY(check_port(system, i));
            continue;
        }
        owner[nowner++] = i;
        PM_TRY(make_port(system, i));
        PM_TRY(scene->port[i].model != NULL ? pm_system_declare_port(system, i)
                                            : load_port(system, i, weights_dir));
    }
    return PM_OK;
}

static uint64_t digest_layout(uint64_t digest, const pm_layout *layout) {
    digest = pm_digest_integer(digest, layout->ngroup);
    for (int i = 0; i < layout->ngroup; ++i) {
        digest = pm_digest_text(digest, layout->group[i].name);
        digest = pm_digest_text(digest, layout->group[i].unit);
        digest = pm_digest_integer(digest, layout->group[i].size);
    }
    return digest;
}

// Computes the digest of all that the processes of a run must agree on. The number of steps is not
// part of it, since the coordinator announces it. library/setup.h adds the initial state.
static uint64_t digest_system(const pm_system *system) {
    const pm_scene *scene = system->scene;
    uint64_t digest = pm_digest_text(PM_DIGEST_INIT, scene->name);
    digest = pm_digest_doubles(digest, &scene->dt, 1);
    digest = pm_digest_integer(digest, scene->window);
    digest = pm_digest_integer(digest, scene->checkpoint);
    digest =
        pm_digest_doubles(digest, &scene->largest_departure, 1); // beyond which a node ends the run
    digest = pm_digest_text(digest, scene->integrator->name);
    digest = pm_digest_integer(digest, scene->substeps);
    digest = pm_digest_doubles(digest, &scene->tolerance, 1);
    digest = pm_digest_integer(digest, scene->nsubsystem);
    for (int i = 0; i < scene->nsubsystem; ++i) {
        digest = pm_digest_text(digest, scene->subsystem[i].name);
        digest = pm_digest_integer(digest, scene->subsystem[i].process);
        digest = pm_digest_integer(digest, scene->subsystem[i].substeps);
        digest = digest_layout(digest, &scene->subsystem[i].layout);
        digest = pm_digest_integer(digest, (int64_t)system->part_provenance[i]->digest);
        if (system->mesh[i] != NULL) {
            digest = pm_solid_mesh_digest(system->mesh[i], digest);
        }
    }
    digest = pm_digest_integer(digest, scene->nport);
    for (int i = 0; i < scene->nport; ++i) {
        const pm_scene_port *port = &scene->port[i];
        digest = pm_digest_text(digest, port->name);
        digest = pm_digest_text(digest, port->law);
        for (int end = 0; end < 2; ++end) {
            digest = pm_digest_text(digest, pm_scene_end_name(scene, port, end));
            digest = digest_layout(digest, &port->layout[end]);
        }
        digest = pm_digest_integer(digest, (int64_t)system->port_provenance[i]->digest);
    }
    return digest;
}

// Makes a system whose components have no models yet.
static pm_status new_system(pm_system **result, const pm_scene *scene) {
    pm_system *system = calloc(1, sizeof *system);
    if (system == NULL) {
        return no_memory();
    }
    const size_t npart = (size_t)scene->nsubsystem, nport = (size_t)scene->nport;
    pm_arena *arena = &system->arena;
    system->scene = scene;
    system->part = pm_arena_array(arena, npart, sizeof *system->part);
    system->port = pm_arena_array(arena, nport, sizeof *system->port);
    system->part_provenance = pm_arena_array(arena, npart, sizeof *system->part_provenance);
    system->port_provenance = pm_arena_array(arena, nport, sizeof *system->port_provenance);
    system->part_owner = pm_arena_array(arena, npart, sizeof *system->part_owner);
    system->port_owner = pm_arena_array(arena, nport, sizeof *system->port_owner);
    system->mesh = pm_arena_array(arena, npart, sizeof *system->mesh);
    if (system->part == NULL || system->port == NULL || system->part_provenance == NULL ||
        system->port_provenance == NULL || system->part_owner == NULL ||
        system->port_owner == NULL || system->mesh == NULL) {
        pm_arena_free(arena);
        free(system);
        return no_memory();
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        system->part_owner[i] = i;
    }
    for (int i = 0; i < scene->nport; ++i) {
        system->port_owner[i] = i;
    }
    *result = system;
    return PM_OK;
}

pm_status pm_system_new(pm_system **result, const pm_scene *scene) {
    pm_status status;
    pm_system *system = NULL;
    PM_TRY_DONE(new_system(&system, scene));
    for (int i = 0; i < scene->nsubsystem; ++i) {
        PM_TRY_DONE(make_part(system, i));
    }
    for (int i = 0; i < scene->nport; ++i) {
        PM_TRY_DONE(make_port(system, i));
    }
    *result = system;
    system = NULL;
done:
    pm_system_free(system);
    return status;
}

static pm_status check_boundary_input(const pm_scene *scene, const pm_port_model *model,
                                      const pm_scene_port *port, int end) {
    const pm_scene_boundary_input *boundary_input =
        &scene->boundary_input[port->boundary_input[end]];
    for (int i = 0; i < port->layout[end].ngroup; ++i) {
        const pm_group *group = &port->layout[end].group[i];
        const int component = port->component[end][group->first];
        // Every group has a dE; it has a dS only where the scene gives one, which then has a place.
        if (boundary_input->value[2 * boundary_input->layout.nz + component].at == NULL &&
            pm_port_responds(model, (pm_end)end, group->name)) {
            return pm_fail(
                PM_ECONFIG,
                "%s: boundary input %s: group \"%s\" needs a \"dS\": port %s exchanges entropy "
                "with it",
                boundary_input->value[boundary_input->layout.nz + component].at,
                boundary_input->name, group->name, port->name);
        }
    }
    return PM_OK;
}

pm_status pm_system_check_boundary_inputs(const pm_system *system) {
    const pm_scene *scene = system->scene;
    for (int i = 0; i < 2 * scene->nport; ++i) {
        const pm_scene_port *port = &scene->port[i / 2];
        if (port->boundary_input[i % 2] >= 0) {
            PM_TRY(check_boundary_input(scene, system->port[i / 2], port, i % 2));
        }
    }
    return PM_OK;
}

pm_status pm_system_load(pm_system **result, const pm_scene *scene, const char *weights_dir) {
    pm_status status;
    pm_system *system = NULL;
    PM_TRY_DONE(new_system(&system, scene));
    PM_TRY_DONE(load_parts(system, weights_dir));
    PM_TRY_DONE(load_ports(system, weights_dir));
    PM_TRY_DONE(pm_system_check_boundary_inputs(system));
    PM_TRY_DONE(pm_system_check_coordinates(system));
    PM_TRY_DONE(pm_system_check_origin(system));
    system->digest = digest_system(system);
    *result = system;
    system = NULL;
done:
    pm_system_free(system);
    return status;
}

void pm_system_free(pm_system *system) {
    if (system == NULL) {
        return;
    }
    for (int i = 0; i < system->scene->nsubsystem; ++i) {
        if (system->part_owner[i] == i && system->part[i] != NULL) {
            pm_part_free(system->part[i]);
        }
    }
    for (int i = 0; i < system->scene->nport; ++i) {
        if (system->port_owner[i] == i && system->port[i] != NULL) {
            pm_port_free(system->port[i]);
        }
    }
    pm_arena_free(&system->arena);
    free(system);
}

int pm_system_components(const pm_system *system) {
    return system->scene->nsubsystem + system->scene->nport;
}

pm_params *pm_system_params(const pm_system *system, int component) {
    const int nsubsystem = system->scene->nsubsystem;
    return component < nsubsystem ? &system->part[component]->params
                                  : &system->port[component - nsubsystem]->params;
}

bool pm_system_end_has_entropy(const pm_system *system, int port, int end) {
    const pm_scene_port *scene = &system->scene->port[port];
    return scene->subsystem[end] >= 0
               ? pm_part_has_entropy(system->part[scene->subsystem[end]])
               : system->scene->boundary_input[scene->boundary_input[end]].entropy;
}

int pm_system_without_energy(const pm_system *system) {
    for (int i = 0; i < system->scene->nsubsystem; ++i) {
        if (!pm_part_has_energy(system->part[i])) {
            return i;
        }
    }
    return -1;
}

void pm_system_responding(const pm_system *system, int subsystem, bool *component) {
    const pm_scene *scene = system->scene;
    memset(component, 0, (size_t)scene->subsystem[subsystem].layout.nz * sizeof *component);
    for (int n = scene->first_end[subsystem]; n < scene->first_end[subsystem + 1]; ++n) {
        const int i = scene->end_at[n];
        const pm_scene_port *port = &scene->port[i / 2];
        const pm_end end = (pm_end)(i % 2);
        const pm_layout *layout = &port->layout[end];
        for (int k = 0; k < layout->ngroup; ++k) {
            const pm_group *group = &layout->group[k];
            for (int c = 0; c < group->size; ++c) {
                component[port->component[end][group->first + c]] |=
                    pm_port_responds(system->port[i / 2], end, group->name);
            }
        }
    }
}
