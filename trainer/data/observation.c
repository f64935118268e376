// Binds the columns of measurements to states, and builds their values as a graph.
#include "data/observation.h"

#include <stdio.h>
#include <string.h>

#include "model/formula.h"
#include "scene/columns.h"
#include "store/names.h"

#define MOST_SUBSYSTEMS 64 // of scenes with formulas of the state

// --- binding ---

static pm_status missing(const char *at, const char *column, const pm_dataset *dataset,
                         pm_arena *arena) {
    const char *list = pm_names_fold(dataset->column, dataset->ncolumn, arena);
    return pm_fail(PM_EDATA,
                   "%s: column \"%s\" is not in the measurements, which have: %.255s; a group that "
                   "nobody measures needs `hidden: true`",
                   at, column, list == NULL ? "" : list);
}

// Adds the groups of all subsystems, with their values in the state z, and the co-energies
// dE [nsubsystem]. Without a graph, z and dE are PM_NO_NODE and NULL.
static void add_symbols(pm_symbols *symbols, pm_graph *g, const pm_scene *scene, pm_node z,
                        const pm_node *dE) {
    char prefix[PM_MAX_NAME];
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_scene_subsystem *s = &scene->physics.subsystem[i];
        snprintf(prefix, sizeof prefix, "%.50s.", s->name);
        pm_symbols_add(symbols, g, &s->layout, prefix,
                       z == PM_NO_NODE ? PM_NO_NODE : pm_slice(g, z, s->first, s->layout.nz));
        snprintf(prefix, sizeof prefix, "%.50s.dE.", s->name);
        pm_symbols_add(symbols, g, &s->layout, prefix, dE == NULL ? PM_NO_NODE : dE[i]);
    }
}

pm_status pm_observation_bind(pm_observation *o, const pm_scene *scene, const pm_dataset *dataset,
                              pm_arena *arena) {
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
    int groups = 0;
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        groups += scene->physics.subsystem[i].layout.ngroup;
    }
    if (scene->run.nobservation > 0 &&
        (2 * groups > PM_MAX_SYMBOLS || scene->physics.nsubsystem > MOST_SUBSYSTEMS)) {
        return pm_fail(PM_ECONFIG, "%s: the scene is too large for formulas of its state",
                       scene->run.observation[0].formula.at);
    }
    for (int i = 0; i < scene->run.nobservation; ++i) {
        const pm_scene_observation *observation = &scene->run.observation[i];
        const int k = pm_names_find(&names, observation->column);
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
    PM_TRY(pm_arena_status(arena, "observations"));
    return o->count > 0 ? PM_OK
                        : pm_fail(PM_ECONFIG,
                                  "%s: all groups are hidden, and there are no "
                                  "`observations`: nothing is measured",
                                  scene->path);
}

// --- the graph ---

pm_node pm_observation_build(pm_graph *g, const pm_observation *o, const pm_system *system,
                             pm_node z) {
    pm_node value[PM_MAX_GROUPS];
    pm_node all = PM_NO_NODE;
    for (int i = 0; i < o->count; i += PM_MAX_GROUPS) {
        int n = 0;
        for (; n < PM_MAX_GROUPS && i + n < o->count; ++n) {
            const int component = o->component[i + n];
            if (component < 0) {
                const pm_scene *scene = system->scene;
                pm_node dE[MOST_SUBSYSTEMS], dS;
                for (int k = 0; k < scene->physics.nsubsystem; ++k) {
                    const pm_node own = pm_slice(g, z, scene->physics.subsystem[k].first,
                                                 scene->physics.subsystem[k].layout.nz);
                    pm_part_coenergies(g, system->part[k], PM_NO_NODE, own, &dE[k], &dS);
                }
                pm_symbols symbols = {0};
                add_symbols(&symbols, g, scene, z, dE);
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
