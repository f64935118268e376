// Joins a scene with its weights: loads every file, compares it with the scene's declarations, and
// checks that models, meshes, weights and data belong together.
#include "scene/system.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/digest.h"
#include "model/solid/solid.h"
#include "model/training_range.h"
#include "scene/columns.h"

#define SAMPLES 64   // states of a dataset that are compared with the training ranges
#define FAR 5.0      // widths of a training range beyond which there are other systems and units
#define NARROW 0.1   // of the size of a value: the least width
#define SMALL 0.01   // of the least size in a training range, below which the unit is another
#define NOT_WIDE 3.0 // ratio of the bounds of such a range: what varies more may become small
#define MOST_STEPS 999.0 // between two states of a dataset; times in ms have a thousand or more
#define FIT_DIGITS 16    // of the digest of a fit (weights.h)

// The entries of the scene that describe a component.
typedef struct source {
    const char *name;
    const char *weights, *weights_at; // path and place; weights NULL: a known model
    const void *model;                // spec of the known model; NULL: it comes from weights
    const char *mesh;                 // of a solid; NULL: none
    const char *law;                  // of a port; NULL: a subsystem
    const pm_layout *layout;          // [1], or [2] of a port
} source;

static source source_of(const pm_scene *scene, int component) {
    if (component < scene->physics.nsubsystem) {
        const pm_scene_subsystem *s = &scene->physics.subsystem[component];
        return (source){s->name, s->weights, s->weights_at, s->model, s->mesh, NULL, &s->layout};
    }
    const pm_scene_port *p = &scene->physics.port[component - scene->physics.nsubsystem];
    return (source){p->name, p->weights, p->weights_at, p->model, NULL, p->law, p->layout};
}

// --- models ---

// Makes a model without weights for a component, with the scene's layouts. No other component
// shares the model.
static pm_status make_model(pm_system *system, int component) {
    const source from = source_of(system->scene, component);
    const int nsubsystem = system->scene->physics.nsubsystem;
    pm_component *c = &system->component[component];
    pm_provenance *provenance = pm_arena_array(&system->arena, 1, sizeof *provenance);
    if (component < nsubsystem) {
        pm_part *part = pm_arena_array(&system->arena, 1, sizeof *part);
        PM_TRY(pm_arena_status(&system->arena, "a system"));
        *c = pm_component_of_part(system->part[component] = part);
    } else {
        pm_port_model *port = pm_arena_array(&system->arena, 1, sizeof *port);
        PM_TRY(pm_arena_status(&system->arena, "a system"));
        *c = pm_component_of_port(system->port[component - nsubsystem] = port);
    }
    memcpy(c->layout, from.layout, (size_t)c->kind->nlayout * sizeof *c->layout);
    c->provenance = provenance;
    return PM_OK;
}

// Adds the component's name to an error, since several components may use one model.
static pm_status name_component(pm_status status, const char *name) {
    return status == PM_ECONFIG ? pm_fail(status, "%s (model of %s)", pm_error(), name) : status;
}

pm_status pm_system_declare(pm_system *system, int component) {
    const source from = source_of(system->scene, component);
    const pm_component *c = &system->component[component];
    memcpy(c->spec, from.model, c->kind->spec_size);
    if (from.law != NULL && strcmp(pm_component_law(c), from.law) != 0) {
        const int port = component - system->scene->physics.nsubsystem;
        return pm_fail(PM_ECONFIG, "%s: the model of port %s is one of the law %s",
                       system->scene->physics.port[port].law_at, from.name, pm_component_law(c));
    }
    PM_TRY(name_component(c->kind->declare(c->model), from.name));
    // A known model has all its numbers, since no weights file supplies them.
    PM_TRY(name_component(pm_spec_locate(from.weights_at, pm_params_check_given(c->params)),
                          from.name));
    if (pm_params_trained(c->params) > 0) {
        return pm_fail(PM_ECONFIG,
                       "%s: the model of %s has %zu numbers to be learned: it needs weights",
                       from.weights_at, from.name, pm_params_trained(c->params));
    }
    pm_arena arena = {0};
    const char *text = c->kind->write_spec(c->spec, &arena);
    c->provenance->digest = text == NULL ? 0 : pm_component_digest(c, text);
    pm_arena_free(&arena);
    return pm_allocated(text, "the text of a model");
}

// --- solids ---
//
// The groups of the state of a solid (model/solid/solid.h) in a scene are
//   u      [nnode][3]  m        displacements
//   p      [nnode][3]  kg m/s   momenta, zero, since a solid has no inertia; ports act on them, and
//                               their co-energy is the velocity
//   inner  [nelement][8][nbranch][6]  inner variables of the branches, if there are any
//   sigma  [nnode][6]  Pa       Cauchy stresses, if the scene asks for them
//   s      J/K                  entropy
//   contact [ncontact][3] kg m/s  momenta of the nodes on which ports of the law `contact` act,
//                               zero like p, if the mesh names such nodes

// Checks that the groups of a solid have the units and sizes that its mesh demands.
static pm_status check_solid_layout(const pm_scene_subsystem *subsystem, const pm_solid_mesh *mesh,
                                    int nbranch) {
    const int inner = mesh->nelement * PM_BRICK_POINTS * PM_SYM * nbranch;
    const struct {
        const char *name, *unit;
        int size;
        bool needed;
    } known[] = {
        {"u", "m", 3 * mesh->nnode, true},
        {"p", "kg m/s", 3 * mesh->nnode, true},
        {"inner", "1", inner, nbranch > 0},
        {"sigma", "Pa", PM_SYM * mesh->nnode, false},
        {"s", "J/K", 1, true},
        {"contact", "kg m/s", 3 * mesh->ncontact, false},
    };
    const pm_layout *layout = &subsystem->layout;
    bool is_known[PM_MAX_GROUPS] = {false};
    for (size_t k = 0; k < sizeof known / sizeof *known; ++k) {
        const pm_group *group = pm_layout_find(layout, known[k].name);
        if (group == NULL && known[k].needed) {
            return pm_fail(PM_EWEIGHTS, "%s: the solid %s needs a group %s, in %s, of size %d",
                           subsystem->at, subsystem->name, known[k].name, known[k].unit,
                           known[k].size);
        }
        if (group != NULL &&
            (group->size != known[k].size || strcmp(group->unit, known[k].unit) != 0)) {
            return pm_fail(PM_EWEIGHTS,
                           "%s: group %s of the solid %s has %d components in %s, and its mesh "
                           "demands %d in %s",
                           subsystem->group_at[group - layout->group], known[k].name,
                           subsystem->name, group->size, group->unit, known[k].size, known[k].unit);
        }
        if (group != NULL) {
            is_known[group - layout->group] = true;
        }
    }
    for (int i = 0; i < layout->ngroup; ++i) {
        if (!is_known[i]) {
            return pm_fail(PM_EWEIGHTS,
                           "%s: a solid has no group %s: its groups are u, p, inner, sigma, s and "
                           "contact",
                           subsystem->group_at[i], layout->group[i].name);
        }
    }
    return PM_OK;
}

// Gives a solid the layout of its subsystem, and loads its mesh.
static pm_status load_mesh(pm_system *system, int id) {
    const pm_scene_subsystem *subsystem = &system->scene->physics.subsystem[id];
    pm_part *part = system->part[id];
    if (pm_part_kind_of(part) != PM_PART_SOLID) {
        return pm_fail(PM_ECONFIG, "%s: subsystem %s has a mesh, but no weights of a solid",
                       subsystem->mesh_at, subsystem->name);
    }
    if (subsystem->mesh == NULL) {
        return pm_fail(PM_EWEIGHTS, "%s: the solid %s needs a mesh", subsystem->at,
                       subsystem->name);
    }
    pm_solid_mesh *mesh = pm_arena_array(&system->arena, 1, sizeof *mesh);
    PM_TRY(pm_arena_status(&system->arena, "a mesh"));
    const pm_status status = pm_solid_mesh_load(mesh, subsystem->mesh, &system->arena);
    if (status != PM_OK) {
        return pm_fail(status, "%s: subsystem %s: %s", subsystem->mesh_at, subsystem->name,
                       pm_error());
    }
    PM_TRY(check_solid_layout(subsystem, mesh, part->spec.solid->nbranch));
    part->layout = subsystem->layout;
    system->mesh[id] = mesh;
    return PM_OK;
}

// --- weights ---

// Writes a layout as "q[2] in m, p[2] in kg m/s" into the arena, for messages.
static const char *describe(const pm_layout *layout, pm_arena *arena) {
    const char *text = "";
    for (int i = 0; i < layout->ngroup && text != NULL; ++i) {
        const pm_group *group = &layout->group[i];
        text = pm_arena_printf(arena, "%s%s%s[%d] in %s%s", text, i == 0 ? "" : ", ", group->name,
                               group->size, group->unit, group->coenergy ? " (co-energy)" : "");
    }
    return text == NULL ? "?" : text;
}

// Checks that weights fit the component that names them.
static pm_status check_model(pm_system *system, int component) {
    const pm_scene *scene = system->scene;
    const source from = source_of(scene, component);
    const pm_component *c = &system->component[component];
    const pm_part *part = pm_component_part(c);
    if (part != NULL && (pm_part_kind_of(part) == PM_PART_SOLID || from.mesh != NULL)) {
        return load_mesh(system, component);
    }
    const pm_scene_port *port =
        part != NULL ? NULL : &scene->physics.port[component - scene->physics.nsubsystem];
    const char *path = c->provenance->path;
    if (port != NULL && strcmp(pm_component_law(c), port->law) != 0) {
        return pm_fail(PM_EWEIGHTS,
                       "%s: port %s: the weights %s are made for the law %s; the scene says %s",
                       port->law_at, port->name, path, pm_component_law(c), port->law);
    }
    for (int k = 0; k < c->kind->nlayout; ++k) {
        const pm_layout *declared = &from.layout[k], *own = &c->layout[k];
        if (pm_layout_equal(declared, own)) {
            continue;
        }
        const char *at, *who;
        if (port != NULL) {
            at = port->expose_at[k];
            who = pm_arena_printf(&system->arena, "port %s, end %s", port->name,
                                  pm_scene_end_name(scene, port, k));
        } else { // the first group that differs; without one, the last group
            int i = 0;
            while (i < declared->ngroup - 1 && i < own->ngroup &&
                   pm_group_equal(&declared->group[i], &own->group[i])) {
                ++i;
            }
            at = scene->physics.subsystem[component].group_at[i];
            who = pm_arena_printf(&system->arena, "subsystem %s", from.name);
        }
        PM_TRY(pm_arena_status(&system->arena, "a system"));
        return pm_fail(PM_EWEIGHTS, "%s: %s: the weights %s are made for %s; the scene says %s", at,
                       who, path, describe(own, &system->arena),
                       describe(declared, &system->arena));
    }
    return PM_OK;
}

// Returns true if two components of one kind can share a model: they name the same weights file, or
// use one reading of a known model with equal layouts, and solids have equal layouts as well.
static bool can_share(const source *own, const source *other) {
    const bool alike = own->weights == NULL ? own->model == other->model
                                            : own->weights == other->weights ||
                                                  (other->weights != NULL &&
                                                   strcmp(own->weights, other->weights) == 0);
    if (!alike || (own->model == NULL && own->mesh == NULL)) {
        return alike;
    }
    return pm_layout_equal(&own->layout[0], &other->layout[0]) &&
           (own->law == NULL || (strcmp(own->law, other->law) == 0 &&
                                 pm_layout_equal(&own->layout[1], &other->layout[1])));
}

static pm_status load_models(pm_system *system, const char *weights_dir) {
    const int nsubsystem = system->scene->physics.nsubsystem, count = pm_system_components(system);
    int *owner = pm_arena_array(&system->arena, (size_t)count, sizeof *owner);
    PM_TRY(pm_arena_status(&system->arena, "a system"));
    int nowner = 0; // of the same kind
    for (int c = 0; c < count; ++c) {
        const source own = source_of(system->scene, c);
        nowner = c == nsubsystem ? 0 : nowner;
        int i = nowner - 1;
        for (; i >= 0; --i) {
            const source other = source_of(system->scene, owner[i]);
            if (can_share(&own, &other)) {
                break;
            }
        }
        if (i >= 0) {
            system->component[c] = system->component[owner[i]];
            system->owner[c] = owner[i];
            if (c < nsubsystem) {
                system->part[c] = system->part[owner[i]];
            } else {
                system->port[c - nsubsystem] = system->port[owner[i] - nsubsystem];
            }
            PM_TRY(check_model(system, c));
            continue;
        }
        owner[nowner++] = c;
        PM_TRY(make_model(system, c));
        if (own.model != NULL) {
            PM_TRY(pm_system_declare(system, c));
            continue;
        }
        const pm_component *made = &system->component[c];
        const char *path = own.weights, *slash = strrchr(path, '/');
        if (weights_dir != NULL) { // the file of the same name in that folder
            path = pm_arena_printf(&system->arena, "%s/%s", weights_dir,
                                   slash == NULL ? path : slash + 1);
        }
        PM_TRY(pm_arena_status(&system->arena, "a system"));
        const pm_status status = pm_weights_load(path, &system->arena, *made, made->provenance);
        if (status != PM_OK) {
            return pm_fail(status, "%s: %s %s: %s", own.weights_at, made->kind->name, own.name,
                           pm_error());
        }
        PM_TRY(check_model(system, c));
    }
    return PM_OK;
}

// --- boundary inputs, coordinates and columns ---

pm_status pm_system_check_boundary_inputs(const pm_system *system) {
    const pm_physics *physics = &system->scene->physics;
    for (int k = 0; k < 2 * physics->nport; ++k) {
        const pm_scene_port *port = &physics->port[k / 2];
        const int end = k % 2, nexposed = port->layout[end].ngroup;
        const pm_scene_boundary_input *input =
            port->boundary_input[end] < 0 ? NULL
                                          : &physics->boundary_input[port->boundary_input[end]];
        for (int i = 0; i < nexposed && input != NULL; ++i) {
            const pm_group *group = &port->layout[end].group[i];
            const int component = port->component[end][group->first], nz = input->layout.nz;
            // Every group has a dE; it has a dS only where the scene gives one, which has a place.
            if (input->value[2 * nz + component].at == NULL &&
                pm_port_responds(system->port[k / 2], (pm_end)end, group->name)) {
                return pm_fail(PM_ECONFIG,
                               "%s: boundary input %s: group \"%s\" needs a \"dS\": port %s "
                               "exchanges entropy with it",
                               input->value[nz + component].at, input->name, group->name,
                               port->name);
            }
        }
    }
    return PM_OK;
}

// Returns true if both texts are known and differ.
static bool differ(const char *a, const char *b) {
    return a != NULL && b != NULL && *a != '\0' && *b != '\0' && strcmp(a, b) != 0;
}

// Checks that the weights of each port were made in the same coordinates (weights.h) as those of
// the parts at its ends, as far as both are known.
static pm_status check_coordinates(const pm_system *system) {
    const pm_physics *physics = &system->scene->physics;
    for (int k = 0; k < 2 * physics->nport; ++k) {
        const pm_scene_port *port = &physics->port[k / 2];
        const int id = port->subsystem[k % 2];
        if (id < 0) {
            continue;
        }
        const pm_provenance *own = system->component[physics->nsubsystem + k / 2].provenance;
        const pm_provenance *other = system->component[id].provenance;
        if (differ(own->coordinates, other->coordinates)) {
            return pm_fail(PM_EWEIGHTS,
                           "%s: port %s: the weights %s are made for %.64s, those of %s, %s, for "
                           "%.64s",
                           port->weights_at, port->name, own->path, own->coordinates,
                           pm_scene_end_name(system->scene, port, k % 2), other->path,
                           other->coordinates);
        }
    }
    return PM_OK;
}

pm_status pm_system_check_range(const pm_system *system, int count, const double *z,
                                const char *what) {
    const pm_scene *scene = system->scene;
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_part *part = system->part[i];
        const pm_training_range range = pm_training_range_of(part);
        if (range.low == NULL || isfinite(scene->run.largest_departure)) {
            continue;
        }
        for (int g = 0; g < part->layout.ngroup; ++g) {
            const char *name = part->layout.group[g].name;
            const double low = range.low[g], high = range.high[g];
            // What was nearly constant has no width.
            const double most = FAR * fmax(high - low, NARROW * fmax(fabs(low), fabs(high)));
            const double least = fmin(fabs(low), fabs(high)), size = fmax(fabs(low), fabs(high));
            const bool is_narrow = low * high > 0 && size <= NOT_WIDE * least;
            double value, far = 0;
            int n = 0, small = 0;
            int outside = 0; // on either side, between which a unit too small swings
            for (int k = 0; k < count; ++k) {
                const double *own = z + (size_t)k * (size_t)scene->physics.nz;
                own += scene->physics.subsystem[i].first;
                value = pm_training_range_of_group(range, g, own).value;
                n += isfinite(value);
                const bool is_far = value > high + most || value < low - most;
                outside += is_far;
                const bool is_small = is_narrow && value != 0 && fabs(value) < SMALL * least;
                small += is_small;
                far = is_far || is_small ? value : far;
            }
            if ((2 * outside > n || (n > 1 && small == n)) &&
                (pm_part_depends(part, &part->spec.energy, name) ||
                 pm_part_depends(part, &part->spec.entropy, name))) {
                return pm_fail(PM_EDATA,
                               "%s: %s.%s is %.4g %s, and the weights %s were trained on %.4g to "
                               "%.4g: are they of another system, or is the unit another? With "
                               "`guards: {training_range: ...}` any distance is allowed",
                               what, scene->physics.subsystem[i].name, name, far,
                               part->layout.group[g].unit, system->component[i].provenance->path,
                               low, high);
            }
        }
    }
    return PM_OK;
}

pm_status pm_system_check_dataset(const pm_system *system, const pm_dataset *dataset,
                                  const char *path) {
    const char *own = pm_dataset_find_note(dataset, "coordinates");
    for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
        const pm_provenance *other = system->component[i].provenance;
        if (differ(own, other->coordinates)) {
            return pm_fail(
                PM_EDATA, "%s: made with %.64s; the weights %s of subsystem %s are for %.64s", path,
                own, other->path, system->scene->physics.subsystem[i].name, other->coordinates);
        }
    }
    const double dt = system->scene->physics.dt;
    if (dataset->ntime > 1 && dataset->dt > MOST_STEPS * dt) {
        return pm_fail(PM_EDATA,
                       "%s: states are %g s apart, the scene %s steps by %g s: are the times in "
                       "ms? A longer dt with more substeps takes the same substeps",
                       path, dataset->dt, system->scene->path, dt);
    }
    pm_arena arena = {0};
    pm_columns columns;
    pm_status status = PM_OK;
    const size_t nz = (size_t)system->scene->physics.nz;
    double *z = pm_arena_array(&arena, SAMPLES * nz, sizeof *z);
    PM_TRY_DONE(pm_arena_status(&arena, "%s", path));
    if (pm_columns_bind(&columns, system->scene, dataset, &arena) != PM_OK) {
        goto done; // whoever needs the columns says which one is missing
    }
    for (int k = 0; k < SAMPLES; ++k) { // spread over the trajectories and over their times
        const int i = k % dataset->ntrajectory, length = pm_dataset_length(dataset, i);
        pm_columns_to_state(&columns,
                            pm_dataset_state(dataset, i, (int)((long)k * length / SAMPLES)),
                            z + (size_t)k * nz);
    }
    status = pm_system_check_range(system, SAMPLES, z, path);
done:
    pm_arena_free(&arena);
    return status;
}

uint64_t pm_system_columns_digest(const pm_scene_subsystem *subsystem) {
    if (subsystem->column == NULL) {
        return 0;
    }
    uint64_t digest = PM_DIGEST_INIT;
    for (int i = 0; i < subsystem->layout.nz; ++i) {
        digest = pm_digest_text(digest, subsystem->column[i]);
    }
    return digest == 0 ? 1 : digest;
}

const char *pm_system_relative_groups(const pm_scene_subsystem *subsystem, pm_arena *arena) {
    const char *text = "";
    for (int g = 0; g < subsystem->layout.ngroup && text != NULL; ++g) {
        if (subsystem->relative_subsystem[g] >= 0) {
            text = pm_arena_printf(arena, "%s%s%s", text, *text == '\0' ? "" : " ",
                                   subsystem->layout.group[g].name);
        }
    }
    return text;
}

// Returns true if the weights of two components lie in one folder, under names that files of one
// fit have, and are of two fits.
static bool are_mixed(const pm_provenance *a, const pm_provenance *b) {
    const char *slash[2] = {strrchr(a->path, '/'), strrchr(b->path, '/')};
    const size_t length = slash[0] == NULL ? 0 : (size_t)(slash[0] - a->path) + 1;
    if (*a->fit == '\0' || *b->fit == '\0' || strncmp(a->fit, b->fit, FIT_DIGITS) == 0 ||
        length != (slash[1] == NULL ? 0 : (size_t)(slash[1] - b->path) + 1) ||
        strncmp(a->path, b->path, length) != 0) {
        return false;
    }
    const char *name = b->path + length, *at = a->fit;
    const size_t size = strlen(name);
    while ((at = strstr(at + 1, name)) != NULL) {
        if (at[-1] == ' ' && (at[size] == ' ' || at[size] == '\0')) {
            return true;
        }
    }
    return false;
}

// Checks that the weights of a component are of the system that the scene says, as far as both are
// known.
static pm_status check_named_system(const pm_system *system, int component) {
    const pm_provenance *own = system->component[component].provenance;
    const source from = source_of(system->scene, component);
    if (!differ(own->system, system->scene->system)) {
        return PM_OK;
    }
    return pm_fail(PM_EWEIGHTS,
                   "%s: %s: the weights %s are of the system \"%.80s\", the scene is of \"%.80s\"; "
                   "without the key `system` it takes weights of any",
                   from.weights_at, from.name, own->path, own->system, system->scene->system);
}

// Checks that weights are used where they were trained: they are of the system that the scene says,
// no two subsystems have exchanged their weights, the files of one folder are of one fit, and no
// group has lost or gained relative_to. Weights of a subsystem with other column names pass, since
// they are reused on purpose. Weights without a record pass too.
static pm_status check_origin(pm_system *system) {
    const pm_physics *physics = &system->scene->physics;
    const int count = pm_system_components(system);
    const pm_provenance **known = pm_arena_array(&system->arena, (size_t)count, sizeof *known);
    PM_TRY(pm_arena_status(&system->arena, "a system"));
    for (int i = 0, nknown = 0; i < count; ++i) {
        const pm_provenance *own = system->component[i].provenance;
        if (own->path == NULL || system->owner[i] != i) {
            continue;
        }
        PM_TRY(check_named_system(system, i));
        known[nknown++] = own;
        for (int k = 0; k < nknown - 1; ++k) {
            const pm_provenance *other = known[k];
            if (are_mixed(own, other)) {
                return pm_fail(PM_EWEIGHTS,
                               "%s: %s: the weights %s were not learned together with %s: a file "
                               "of another fit, or of another moment of this one, is in its place",
                               source_of(system->scene, i).weights_at,
                               source_of(system->scene, i).name, own->path, other->path);
            }
        }
    }
    // One check for exchanged weights serves all subsystems that share them.
    bool *checked = pm_arena_array(&system->arena, (size_t)physics->nsubsystem, sizeof *checked);
    PM_TRY(pm_arena_status(&system->arena, "a system"));
    for (int i = 0; i < physics->nsubsystem; ++i) {
        const pm_scene_subsystem *subsystem = &physics->subsystem[i];
        const pm_provenance *own = system->component[i].provenance;
        const uint64_t columns = pm_system_columns_digest(subsystem);
        if (own->columns == 0 || columns == 0) {
            continue; // not known
        }
        if (columns != own->columns) {
            // Two subsystems have exchanged their weights if the scene has the columns on which
            // these weights were trained in another subsystem, whose weights were trained on other
            // columns. Otherwise weights may serve in many places.
            const bool done = checked[system->owner[i]];
            checked[system->owner[i]] = true;
            for (int k = 0; k < physics->nsubsystem && !done; ++k) {
                const pm_provenance *other = system->component[k].provenance;
                if (k != i && other->columns != 0 && other->columns != own->columns &&
                    pm_system_columns_digest(&physics->subsystem[k]) == own->columns) {
                    return pm_fail(PM_EWEIGHTS,
                                   "%s: subsystem %s: the weights %s were trained on the columns "
                                   "of subsystem %s, which has other weights: are the two "
                                   "exchanged?",
                                   subsystem->weights_at, subsystem->name, own->path,
                                   physics->subsystem[k].name);
                }
            }
            continue;
        }
        // The columns have the same names as in training.
        const char *text = pm_system_relative_groups(subsystem, &system->arena);
        PM_TRY(pm_arena_status(&system->arena, "a system"));
        if (strcmp(text, own->relative) != 0) {
            return pm_fail(PM_EWEIGHTS,
                           "%s: subsystem %s: the weights %s were trained with relative_to for "
                           "\"%.200s\", the scene has relative_to for \"%.200s\"",
                           subsystem->group_at[0], subsystem->name, own->path, own->relative, text);
        }
    }
    return PM_OK;
}

// --- a system ---

// Computes the digest of all that the processes of a run must agree on. The number of steps is not
// part of it, since the coordinator announces it. library/setup.h adds the initial state.
static uint64_t digest_system(const pm_system *system) {
    const pm_scene *scene = system->scene;
    uint64_t digest = pm_digest_text(PM_DIGEST_INIT, scene->name);
    digest = pm_digest_doubles(digest, &scene->physics.dt, 1);
    digest = pm_digest_integer(digest, scene->network.window);
    digest = pm_digest_integer(digest, scene->network.checkpoint);
    digest = pm_digest_doubles(digest, &scene->run.largest_departure,
                               1); // beyond which a node ends the run
    digest = pm_digest_text(digest, scene->physics.integrator->name);
    digest = pm_digest_integer(digest, scene->physics.substeps);
    digest = pm_digest_doubles(digest, &scene->physics.tolerance, 1);
    digest = pm_digest_integer(digest, scene->physics.nsubsystem);
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        digest = pm_digest_text(digest, scene->physics.subsystem[i].name);
        digest = pm_digest_integer(digest, scene->physics.subsystem[i].process);
        digest = pm_layout_digest(&scene->physics.subsystem[i].layout, digest);
        digest = pm_digest_integer(digest, (int64_t)system->component[i].provenance->digest);
        if (system->mesh[i] != NULL) {
            digest = pm_solid_mesh_digest(system->mesh[i], digest);
        }
    }
    digest = pm_digest_integer(digest, scene->physics.nport);
    for (int i = 0; i < scene->physics.nport; ++i) {
        const pm_scene_port *port = &scene->physics.port[i];
        digest = pm_digest_text(digest, port->name);
        digest = pm_digest_text(digest, port->law);
        for (int end = 0; end < 2; ++end) {
            digest = pm_digest_text(digest, pm_scene_end_name(scene, port, end));
            digest = pm_layout_digest(&port->layout[end], digest);
        }
        digest = pm_digest_integer(
            digest, (int64_t)system->component[scene->physics.nsubsystem + i].provenance->digest);
    }
    return digest;
}

// Makes a system whose components have no models yet.
static pm_status new_system(pm_system **result, const pm_scene *scene) {
    pm_system *system = NULL;
    PM_TRY(PM_NEW(system, "a system"));
    const size_t npart = (size_t)scene->physics.nsubsystem, nport = (size_t)scene->physics.nport;
    pm_arena *arena = &system->arena;
    system->scene = scene;
    system->component = pm_arena_array(arena, npart + nport, sizeof *system->component);
    system->part = pm_arena_array(arena, npart, sizeof *system->part);
    system->port = pm_arena_array(arena, nport, sizeof *system->port);
    system->owner = pm_arena_array(arena, npart + nport, sizeof *system->owner);
    system->mesh = pm_arena_array(arena, npart, sizeof *system->mesh);
    const pm_status status = pm_arena_status(arena, "a system");
    if (status != PM_OK) {
        pm_arena_free(arena);
        free(system);
        return status;
    }
    for (int i = 0; i < scene->physics.nsubsystem + scene->physics.nport; ++i) {
        system->owner[i] = i;
    }
    *result = system;
    return PM_OK;
}

pm_status pm_system_new(pm_system **result, const pm_scene *scene) {
    pm_status status;
    pm_system *system = NULL;
    PM_TRY_DONE(new_system(&system, scene));
    for (int c = 0; c < pm_system_components(system); ++c) {
        PM_TRY_DONE(make_model(system, c));
    }
    *result = system;
    system = NULL;
done:
    pm_system_free(system);
    return status;
}

pm_status pm_system_load(pm_system **result, const pm_scene *scene, const char *weights_dir) {
    pm_status status;
    pm_system *system = NULL;
    PM_TRY_DONE(new_system(&system, scene));
    PM_TRY_DONE(load_models(system, weights_dir));
    PM_TRY_DONE(pm_system_check_boundary_inputs(system));
    PM_TRY_DONE(check_coordinates(system));
    PM_TRY_DONE(check_origin(system));
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
    const int nsubsystem = system->scene->physics.nsubsystem;
    for (int c = 0; c < pm_system_components(system); ++c) {
        pm_part *part = c < nsubsystem ? system->part[c] : NULL;
        pm_port_model *port = c < nsubsystem ? NULL : system->port[c - nsubsystem];
        if (system->owner[c] == c && part != NULL) {
            pm_part_free(part);
        } else if (system->owner[c] == c && port != NULL) {
            pm_port_free(port);
        }
    }
    PM_DELETE(system);
}

int pm_system_components(const pm_system *system) {
    return system->scene->physics.nsubsystem + system->scene->physics.nport;
}

pm_params *pm_system_params(const pm_system *system, int component) {
    return system->component[component].params;
}

bool pm_system_end_has_entropy(const pm_system *system, int port, int end) {
    const pm_scene_port *scene = &system->scene->physics.port[port];
    return scene->subsystem[end] >= 0
               ? pm_part_has_entropy(system->part[scene->subsystem[end]])
               : system->scene->physics.boundary_input[scene->boundary_input[end]].entropy;
}

int pm_system_without_energy(const pm_system *system) {
    for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
        if (!pm_part_has_energy(system->part[i])) {
            return i;
        }
    }
    return -1;
}

int pm_system_worst_verdict(const pm_system *system) {
    static const char *const word[] = PM_VERDICT_WORDS;
    int worst = -1;
    size_t grade = 0;
    for (int i = 0; i < pm_system_components(system); ++i) {
        const char *verdict = system->component[i].provenance->verdict;
        for (size_t g = grade + 1; verdict != NULL && g < sizeof word / sizeof *word; ++g) {
            if (strncmp(verdict, word[g], strlen(word[g])) == 0) {
                worst = i;
                grade = g;
            }
        }
    }
    return worst;
}

pm_status pm_system_check_integrator(const pm_system *system, const pm_integrator *integrator,
                                     const char *at) {
    for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
        if (pm_integrator_keeps_energy(integrator) && pm_part_has_coenergies(system->part[i])) {
            return pm_fail(PM_ECONFIG,
                           "%s: integrator %s cannot step co-energies, and the state of subsystem "
                           "%s has some: expected euler, heun, rk4 or rk6",
                           at, integrator->name, system->scene->physics.subsystem[i].name);
        }
    }
    return PM_OK;
}

void pm_system_responding(const pm_system *system, int subsystem, int *ports) {
    const pm_scene *scene = system->scene;
    memset(ports, 0, (size_t)scene->physics.subsystem[subsystem].layout.nz * sizeof *ports);
    for (int n = scene->physics.first_end[subsystem]; n < scene->physics.first_end[subsystem + 1];
         ++n) {
        const int i = scene->physics.end_at[n];
        const pm_scene_port *port = &scene->physics.port[i / 2];
        const pm_end end = (pm_end)(i % 2);
        const pm_layout *layout = &port->layout[end];
        for (int k = 0; k < layout->ngroup; ++k) {
            const pm_group *group = &layout->group[k];
            for (int c = 0; c < group->size; ++c) {
                ports[port->component[end][group->first + c]] +=
                    pm_port_responds(system->port[i / 2], end, group->name);
            }
        }
    }
}
