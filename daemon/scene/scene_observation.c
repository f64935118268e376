// Reads what is measured of a scene: groups that nobody measures (`hidden`) and columns that are
// functions of the state (`observations`).
#include <float.h>
#include <math.h>
#include <string.h>

#include "scene/scene_reader.h"

// --- hidden groups ---

static pm_status read_prior(pm_yaml hidden, double *guess, double *deviation) {
    static const char *const keys[] = {"guess", "deviation", NULL};
    PM_TRY(pm_yaml_allow(hidden, keys));
    pm_yaml value;
    if (pm_yaml_exists(value = pm_yaml_get(hidden, "guess"))) {
        PM_TRY(pm_yaml_double(value, -INFINITY, INFINITY, guess));
    }
    return pm_yaml_exists(value = pm_yaml_get(hidden, "deviation"))
               ? pm_yaml_double(value, DBL_MIN, INFINITY, deviation)
               : PM_OK;
}

pm_status pm_scene_read_hidden(pm_scene_reader *r, pm_scene_subsystem *subsystem, pm_yaml block,
                               pm_scene_named **columns) {
    const pm_yaml hidden = pm_yaml_get(block, "hidden");
    const int id = subsystem->layout.ngroup - 1;
    const pm_group *group = &subsystem->layout.group[id];
    bool yes = true;
    if (pm_yaml_count(hidden) > 0) {
        PM_TRY(read_prior(hidden, &subsystem->guess[id], &subsystem->deviation[id]));
    } else {
        PM_TRY(pm_yaml_bool(hidden, &yes));
    }
    subsystem->hidden[id] = yes;
    if (*columns != NULL) {
        return PM_OK;
    }
    if (!yes) {
        return pm_yaml_fail(block, "expected \"columns\": the group is not hidden");
    }
    *columns = pm_arena_array(r->arena, (size_t)group->size, sizeof **columns);
    for (int i = 0; *columns != NULL && i < group->size; ++i) {
        (*columns)[i].at = hidden;
        (*columns)[i].text =
            group->size == 1
                ? pm_arena_printf(r->arena, "%s.%s", subsystem->name, group->name)
                : pm_arena_printf(r->arena, "%s.%s_%d", subsystem->name, group->name, i);
        if ((*columns)[i].text == NULL) {
            return pm_scene_no_memory();
        }
    }
    return *columns == NULL ? pm_scene_no_memory() : PM_OK;
}

// --- functions of the state ---

static pm_status read_observation(pm_scene_reader *r, pm_yaml key, pm_yaml value,
                                  pm_scene_observation *o) {
    PM_TRY(pm_yaml_text(key, r->arena, &o->column));
    PM_TRY(pm_yaml_text(value, r->arena, &o->formula.text));
    return pm_scene_read_at(r, value, &o->formula.at);
}

pm_status pm_scene_read_observations(pm_scene_reader *r) {
    const pm_yaml block = pm_yaml_get(r->root, "observations");
    if (!pm_yaml_exists(block)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_require_entries(block));
    const int count = pm_yaml_count(block);
    r->scene->observation = pm_arena_array(r->arena, (size_t)count, sizeof *r->scene->observation);
    if (r->scene->observation == NULL) {
        return pm_scene_no_memory();
    }
    r->scene->nobservation = count;
    for (int i = 0; i < count; ++i) {
        pm_yaml key, value;
        pm_yaml_entry(block, i, &key, &value);
        PM_TRY(read_observation(r, key, value, &r->scene->observation[i]));
    }
    return PM_OK;
}
