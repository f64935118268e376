// Binds the columns of measurements to states, and builds their values as a graph.
#include "learn/observation.h"

#include <stdio.h>
#include <string.h>

#include "learn/step_graph.h"
#include "model/formula.h"
#include "scene/columns.h"
#include "store/names.h"

#define MOST_SUBSYSTEMS 64 // of scenes with formulas of the state

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for observations");
}

// --- binding ---

// Writes what the scene says about one group to its components.
static pm_status bind_group(pm_observation *o, const pm_scene *scene, const pm_scene_subsystem *s,
                            int id, pm_arena *arena) {
    const pm_group *group = &s->layout.group[id];
    const int other = s->relative_subsystem[id];
    for (int i = 0; i < group->size; ++i) {
        const int c = s->first + group->first + i;
        o->hidden[c] = s->hidden[id];
        o->guess[c] = s->guess[id];
        o->deviation[c] = s->hidden[id] && !(s->deviation[id] > 0) ? 1 : s->deviation[id];
        o->base[c] =
            other < 0 ? -1
                      : scene->subsystem[other].first +
                            scene->subsystem[other].layout.group[s->relative_group[id]].first + i;
        o->component_name[c] = group->size == 1
                                   ? pm_arena_printf(arena, "%s.%s", s->name, group->name)
                                   : pm_arena_printf(arena, "%s.%s[%d]", s->name, group->name, i);
        if (o->component_name[c] == NULL) {
            return no_memory();
        }
    }
    return PM_OK;
}

static pm_status missing(const char *at, const char *column, const pm_dataset *dataset,
                         pm_arena *arena) {
    const char *list = pm_names_fold(dataset->column, dataset->ncolumn, arena);
    return pm_fail(PM_EDATA,
                   "%s: column \"%s\" is not in the measurements, which have: %.255s; a group that "
                   "nobody measures needs `hidden: true`",
                   at, column, list == NULL ? "" : list);
}

static pm_status bind_components(pm_observation *o, const pm_scene *scene,
                                 const pm_dataset *dataset, const pm_names *names,
                                 pm_arena *arena) {
    const char **unit;
    PM_TRY(pm_dataset_units(dataset, arena, &unit));
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_scene_subsystem *s = &scene->subsystem[i];
        if (s->column == NULL) {
            return pm_fail(PM_ECONFIG, "%s: subsystem %s maps no columns of the dataset", s->at,
                           s->name);
        }
        for (int g = 0; g < s->layout.ngroup; ++g) {
            PM_TRY(bind_group(o, scene, s, g, arena));
        }
        for (int c = 0; c < s->layout.nz; ++c) {
            const int k = pm_names_find(names, s->column[c]);
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
    return PM_OK;
}

// Adds the groups of all subsystems, and with `state` not NULL their values; dE is computed only if
// a node is given.
static void add_symbols(pm_symbols *symbols, pm_graph *g, const pm_scene *scene, pm_node z,
                        const pm_state_nodes *state) {
    char prefix[PM_MAX_NAME];
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_scene_subsystem *s = &scene->subsystem[i];
        snprintf(prefix, sizeof prefix, "%.50s.", s->name);
        pm_symbols_add(symbols, g, &s->layout, prefix,
                       z == PM_NO_NODE ? PM_NO_NODE : pm_slice(g, z, s->first, s->layout.nz));
        snprintf(prefix, sizeof prefix, "%.50s.dE.", s->name);
        pm_symbols_add(symbols, g, &s->layout, prefix, state == NULL ? PM_NO_NODE : state[i].dE);
    }
}

static pm_status bind_formulas(pm_observation *o, const pm_scene *scene, const pm_dataset *dataset,
                               const pm_names *names, pm_arena *arena) {
    int groups = 0;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        groups += scene->subsystem[i].layout.ngroup;
    }
    if (scene->nobservation > 0 &&
        (2 * groups > PM_MAX_SYMBOLS || scene->nsubsystem > MOST_SUBSYSTEMS)) {
        return pm_fail(PM_ECONFIG, "%s: the scene is too large for formulas of its state",
                       scene->observation[0].formula.at);
    }
    for (int i = 0; i < scene->nobservation; ++i) {
        const pm_scene_observation *observation = &scene->observation[i];
        const int k = pm_names_find(names, observation->column);
        pm_symbols symbols = {0};
        add_symbols(&symbols, NULL, scene, PM_NO_NODE, NULL);
        PM_TRY(pm_formula_check(&observation->formula, &symbols));
        if (k < 0) {
            return missing(observation->formula.at, observation->column, dataset, arena);
        }
        o->column[o->count] = k;
        o->component[o->count] = -1;
        o->rule[o->count] = &observation->formula;
        o->name[o->count++] = observation->column;
    }
    return o->count > 0 ? PM_OK
                        : pm_fail(PM_ECONFIG,
                                  "%s: all groups are hidden, and there are no "
                                  "`observations`: nothing is measured",
                                  scene->path);
}

pm_status pm_observation_bind(pm_observation *o, const pm_scene *scene, const pm_dataset *dataset,
                              pm_arena *arena) {
    const size_t nz = (size_t)scene->nz, most = nz + (size_t)scene->nobservation;
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
    if (o->column == NULL || o->component == NULL || o->name == NULL || o->unit == NULL ||
        o->rule == NULL || o->base == NULL || o->hidden == NULL || o->guess == NULL ||
        o->deviation == NULL || o->component_name == NULL) {
        return no_memory();
    }
    PM_TRY(pm_names_sort(&names, dataset->column, dataset->ncolumn, arena));
    PM_TRY(bind_components(o, scene, dataset, &names, arena));
    return bind_formulas(o, scene, dataset, &names, arena);
}

// --- the graph ---

static pm_node component_value(pm_graph *g, const pm_observation *o, pm_node z, int component) {
    pm_node value = pm_slice(g, z, component, 1);
    for (int base = o->base[component]; base >= 0; base = o->base[base]) {
        value = pm_add(g, value, pm_slice(g, z, base, 1));
    }
    return value;
}

static pm_node formula_value(pm_graph *g, const pm_formula *rule, const pm_system *system,
                             pm_node z) {
    const pm_scene *scene = system->scene;
    pm_state_nodes state[MOST_SUBSYSTEMS];
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_node own =
            pm_slice(g, z, scene->subsystem[i].first, scene->subsystem[i].layout.nz);
        state[i] = (pm_state_nodes){.z = own, .to = own, .from = PM_NO_NODE};
    }
    pm_build_coenergies(g, system, state);
    pm_symbols symbols = {0};
    add_symbols(&symbols, g, scene, z, state);
    return pm_formula_build(g, rule, &symbols);
}

pm_node pm_observation_build(pm_graph *g, const pm_observation *o, const pm_system *system,
                             pm_node z) {
    pm_node value[PM_MAX_GROUPS];
    pm_node all = PM_NO_NODE;
    for (int i = 0; i < o->count; i += PM_MAX_GROUPS) {
        int n = 0;
        for (; n < PM_MAX_GROUPS && i + n < o->count; ++n) {
            value[n] = o->component[i + n] >= 0 ? component_value(g, o, z, o->component[i + n])
                                                : formula_value(g, o->rule[i + n], system, z);
        }
        const pm_node part = pm_concat(g, n, value);
        const pm_node both[2] = {all, part};
        all = all == PM_NO_NODE ? part : pm_concat(g, 2, both);
    }
    return all;
}
