// Binds the columns of measurements to states, and builds their values as a graph.
#include "data/observation.h"

#include <stdio.h>
#include <string.h>

#include "model/constants.h"
#include "model/formula.h"
#include "scene/columns.h"
#include "store/names.h"

// --- binding ---

static pm_status missing(const char *at, const char *column, const pm_dataset *dataset,
                         pm_arena *arena) {
    const char *list = pm_names_fold(dataset->column, dataset->ncolumn, arena);
    return pm_fail(PM_EDATA,
                   "%s: column \"%s\" is not in the measurements, which have: %.255s; a group that "
                   "nobody measures needs `hidden: true`",
                   at, column, list == NULL ? "" : list);
}

// What the formulas of a scene may name, while their symbols are collected.
typedef struct collector {
    pm_graph *g; // NULL: the symbols have no values
    const pm_system *system;
    const pm_formula *formula;
    pm_node z, input; // states [1][nz] and boundary inputs [1][nprescribed] of the scene
    bool mentioned;   // adds what the formula names; else all the rest, as long as there is room
    pm_symbols *symbols;
} collector;

static bool is_wanted(const collector *c, const char *name) {
    return pm_formula_mentions(c->formula, name) == c->mentioned &&
           c->symbols->count < PM_MAX_SYMBOLS;
}

// Adds the groups of a layout, whose values lie side by side in `vector` from `first` on.
static void add_groups(const collector *c, const char *prefix, const pm_layout *layout,
                       pm_node vector, int first) {
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        char name[PM_MAX_NAME];
        snprintf(name, sizeof name, "%s%s", prefix, group->name);
        if (is_wanted(c, name)) {
            pm_symbols_add_one(c->symbols, name, group->size,
                               c->g == NULL ? PM_NO_NODE
                               : vector == PM_NO_NODE
                                   ? pm_constant(c->g, 0, 1, group->size)
                                   : pm_slice(c->g, vector, first + group->first, group->size));
        }
    }
}

// Adds the constants of a component's model, known and learned ones.
static void add_constants(const collector *c, int component, const char *owner) {
    const int nsubsystem = c->system->scene->physics.nsubsystem;
    const pm_constants *constants = component < nsubsystem
                                        ? c->system->part[component]->spec.constants
                                        : c->system->port[component - nsubsystem]->spec.constants;
    pm_symbols learned = {0};
    pm_constants_add(constants, c->g, pm_system_params((pm_system *)c->system, component),
                     &learned);
    for (int i = 0; constants != NULL && i < constants->count; ++i) {
        char name[PM_MAX_NAME];
        snprintf(name, sizeof name, "%s.%s", owner, constants->name[i]);
        if (!is_wanted(c, name)) {
            continue;
        }
        pm_node node = c->g == NULL ? PM_NO_NODE : pm_constant(c->g, constants->value[i], 1, 1);
        for (int k = 0; k < learned.count; ++k) {
            node = strcmp(learned.symbol[k].name, constants->name[i]) == 0 ? learned.symbol[k].node
                                                                           : node;
        }
        pm_symbols_add_one(c->symbols, name, 1, node);
    }
}

// Adds what the outside prescribes, by the names of its groups and of the columns that it follows.
static void add_input(const collector *c, const pm_scene_boundary_input *b) {
    static const char *const kind[] = {"", "dE.", "dS."};
    const int nz = b->layout.nz;
    char prefix[PM_MAX_NAME];
    for (int i = 0; i < 3; ++i) {
        snprintf(prefix, sizeof prefix, "%.50s.%s", b->name, kind[i]);
        add_groups(c, prefix, &b->layout, c->input, b->first + i * nz);
    }
    for (int i = 0; i < 3 * nz; ++i) {
        const char *column = b->value[i].column;
        bool known = column == NULL || !is_wanted(c, column);
        for (int k = 0; k < c->symbols->count && !known; ++k) {
            known = strcmp(c->symbols->symbol[k].name, column) == 0;
        }
        if (!known) {
            pm_symbols_add_one(c->symbols, column, 1,
                               c->g == NULL ? PM_NO_NODE
                                            : pm_slice(c->g, c->input, b->first + i, 1));
        }
    }
}

// Adds the symbols of one kind: those that the formula names, or all others.
static void add_symbols(const collector *c) {
    const pm_physics *physics = &c->system->scene->physics;
    char prefix[PM_MAX_NAME];
    for (int i = 0; i < physics->nsubsystem; ++i) {
        const pm_scene_subsystem *s = &physics->subsystem[i];
        snprintf(prefix, sizeof prefix, "%.50s.", s->name);
        add_groups(c, prefix, &s->layout, c->z, s->first);
        snprintf(prefix, sizeof prefix, "%.50s.dE", s->name);
        pm_node dE = PM_NO_NODE, dS;
        if (c->g != NULL && pm_formula_mentions(c->formula, prefix)) {
            pm_part_coenergies(c->g, c->system->part[i], PM_NO_NODE,
                               pm_slice(c->g, c->z, s->first, s->layout.nz), &dE, &dS);
        }
        snprintf(prefix, sizeof prefix, "%.50s.dE.", s->name);
        add_groups(c, prefix, &s->layout, dE, 0);
        add_constants(c, i, s->name);
    }
    for (int i = 0; i < physics->nport; ++i) {
        add_constants(c, physics->nsubsystem + i, physics->port[i].name);
    }
    for (int i = 0; i < physics->nboundary_input; ++i) {
        add_input(c, &physics->boundary_input[i]);
    }
}

pm_status pm_observation_bind(pm_observation *o, const pm_system *system, const pm_dataset *dataset,
                              pm_arena *arena) {
    const pm_scene *scene = system->scene;
    const size_t nz = (size_t)scene->physics.nz, most = nz + (size_t)scene->run.nobservation;
    pm_names names;
    *o = (pm_observation){
        .column = pm_arena_array(arena, most, sizeof *o->column),
        .component = pm_arena_array(arena, most, sizeof *o->component),
        .name = pm_arena_array(arena, most, sizeof *o->name),
        .unit = pm_arena_array(arena, most, sizeof *o->unit),
        .rule = pm_arena_array(arena, most, sizeof *o->rule),
        .base = pm_arena_array(arena, nz, sizeof *o->base),
        .hidden = pm_arena_array(arena, nz, sizeof *o->hidden),
        .guess = pm_arena_array(arena, nz, sizeof *o->guess),
        .deviation = pm_arena_array(arena, nz, sizeof *o->deviation),
        .component_name = pm_arena_array(arena, nz, sizeof *o->component_name),
    };
    PM_TRY(pm_arena_status(arena, "observations"));
    PM_TRY(pm_names_sort(&names, dataset->column, dataset->ncolumn, arena));
    const char **unit;
    PM_TRY(pm_dataset_units(dataset, arena, &unit));
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_scene_subsystem *s = &scene->physics.subsystem[i];
        if (s->column == NULL) {
            return pm_fail(PM_ECONFIG, "%s: subsystem %s maps no columns of the dataset", s->at,
                           s->name);
        }
        for (int g = 0; g < s->layout.ngroup; ++g) {
            // What the scene says about the group.
            const pm_group *group = &s->layout.group[g];
            const int other = s->relative_subsystem[g];
            for (int k = 0; k < group->size; ++k) {
                const int c = s->first + group->first + k;
                o->hidden[c] = s->hidden[g];
                o->guess[c] = s->guess[g];
                o->deviation[c] = s->hidden[g] && !(s->deviation[g] > 0) ? 1 : s->deviation[g];
                o->base[c] = other < 0 ? -1
                                       : scene->physics.subsystem[other].first +
                                             scene->physics.subsystem[other]
                                                 .layout.group[s->relative_group[g]]
                                                 .first +
                                             k;
                o->component_name[c] =
                    group->size == 1 ? pm_arena_printf(arena, "%s.%s", s->name, group->name)
                                     : pm_arena_printf(arena, "%s.%s[%d]", s->name, group->name, k);
            }
        }
        for (int c = 0; c < s->layout.nz; ++c) {
            const int k = pm_names_find(&names, s->column[c]);
            if (o->hidden[s->first + c]) {
                continue;
            }
            if (k < 0) {
                return missing(s->column_at[c], s->column[c], dataset, arena);
            }
            int group = 0;
            while (s->layout.group[group].first + s->layout.group[group].size <= c) {
                ++group;
            }
            PM_TRY(unit == NULL ? PM_OK : pm_columns_check_unit(s, group, s->column[c], unit[k]));
            o->column[o->count] = k;
            o->component[o->count] = s->first + c;
            o->unit[o->count] = s->layout.group[group].unit;
            o->name[o->count++] = s->column[c];
        }
    }
    for (int i = 0; i < scene->run.nobservation; ++i) {
        const pm_scene_observation *observation = &scene->run.observation[i];
        const int k = pm_names_find(&names, observation->column);
        pm_symbols symbols = {0};
        collector c = {NULL, system, &observation->formula, PM_NO_NODE, PM_NO_NODE, true, &symbols};
        add_symbols(&c);
        c.mentioned = false; // so that an error lists them, too
        add_symbols(&c);
        PM_TRY(pm_formula_check(&observation->formula, &symbols));
        if (k < 0) {
            return missing(observation->formula.at, observation->column, dataset, arena);
        }
        o->column[o->count] = k;
        o->component[o->count] = -1;
        o->rule[o->count] = &observation->formula;
        o->name[o->count++] = observation->column;
    }
    PM_TRY(pm_arena_status(arena, "observations"));
    return o->count > 0 ? PM_OK
                        : pm_fail(PM_ECONFIG,
                                  "%s: all groups are hidden, and there are no "
                                  "`observations`: nothing is measured",
                                  scene->path);
}

// --- the graph ---

pm_node pm_observation_build(pm_graph *g, const pm_observation *o, const pm_system *system,
                             pm_node z, pm_node input) {
    pm_node value[PM_MAX_GROUPS];
    pm_node all = PM_NO_NODE;
    for (int i = 0; i < o->count; i += PM_MAX_GROUPS) {
        int n = 0;
        for (; n < PM_MAX_GROUPS && i + n < o->count; ++n) {
            const int component = o->component[i + n];
            if (component < 0) {
                pm_symbols symbols = {0};
                const collector c = {g, system, o->rule[i + n], z, input, true, &symbols};
                add_symbols(&c);
                value[n] = pm_formula_build(g, o->rule[i + n], &symbols);
                continue;
            }
            value[n] = pm_slice(g, z, component, 1);
            for (int base = o->base[component]; base >= 0; base = o->base[base]) {
                value[n] = pm_add(g, value[n], pm_slice(g, z, base, 1));
            }
        }
        all = pm_concat_or(g, all, pm_concat(g, n, value));
    }
    return all;
}
