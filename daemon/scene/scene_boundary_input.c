// Reads the section `boundary_inputs` of a scene: the values that are prescribed over time at the
// outside end of a port.
#include "scene/scene_reader.h"

#include <math.h>
#include <string.h>

enum { VALUE, DE, DS, NLIST }; // in the order of pm_scene_boundary_input.value
static const char *const list_key[NLIST] = {[VALUE] = "value", [DE] = "dE", [DS] = "dS"};

// The lists of one group: columns and numbers, [size of the group] each. NULL: all are the number
// 0.
typedef struct group_lists {
    pm_scene_named *list[NLIST];
} group_lists;

static pm_status read_lists(pm_scene_reader *r, pm_yaml block, pm_group *group, group_lists *read) {
    pm_yaml list;
    PM_TRY(pm_yaml_require(block, list_key[DE], &list));
    PM_TRY(pm_scene_read_columns(r, list, &group->size, &read->list[DE]));
    for (int k = 0; k < NLIST; ++k) {
        int count;
        list = pm_yaml_get(block, list_key[k]);
        if (k == DE || !pm_yaml_exists(list)) {
            continue;
        }
        PM_TRY(pm_scene_read_columns(r, list, &count, &read->list[k]));
        if (count != group->size) {
            return pm_yaml_fail(list, "expected %d as under \"dE\", found %d", group->size, count);
        }
    }
    return PM_OK;
}

static pm_status read_group(pm_scene_reader *r, pm_scene_boundary_input *boundary_input,
                            pm_yaml key, pm_yaml block, group_lists *read) {
    static const char *const keys[] = {"unit", "dE", "dS", "value", NULL};
    pm_yaml unit;
    pm_group *group = &boundary_input->layout.group[boundary_input->layout.ngroup];
    PM_TRY(pm_scene_read_name(r, key, &group->name));
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(pm_yaml_require(block, "unit", &unit));
    PM_TRY(pm_yaml_text(unit, r->arena, &group->unit));
    PM_TRY(read_lists(r, block, group, read));
    group->first = boundary_input->layout.nz;
    boundary_input->layout.nz += group->size;
    ++boundary_input->layout.ngroup;
    boundary_input->entropy = boundary_input->entropy || read->list[DS] != NULL;
    return PM_OK;
}

// Reads a number or the name of a dataset column. Numbers begin with a digit, a sign or a point.
static pm_status prescribe(const pm_scene_named *named, pm_scene_prescribed *result) {
    if (strchr("+-.0123456789", named->text[0]) == NULL) {
        result->column = named->text;
        return PM_OK;
    }
    return pm_yaml_double(named->at, -INFINITY, INFINITY, &result->number);
}

static pm_status prescribe_list(pm_scene_reader *r, const pm_scene_named *list, int count,
                                pm_scene_prescribed *result) {
    const char **at = pm_arena_array(r->arena, (size_t)count, sizeof *at);
    if (at == NULL) {
        return pm_scene_no_memory();
    }
    PM_TRY(pm_scene_read_places(r, list, count, at));
    for (int i = 0; i < count; ++i) {
        PM_TRY(prescribe(&list[i], &result[i]));
        result[i].at = at[i];
    }
    return PM_OK;
}

static pm_status prescribe_groups(pm_scene_reader *r, pm_scene_boundary_input *boundary_input,
                                  const group_lists *read) {
    const int nz = boundary_input->layout.nz;
    pm_scene_prescribed *value = pm_arena_array(r->arena, NLIST * (size_t)nz, sizeof *value);
    if (value == NULL) {
        return pm_scene_no_memory();
    }
    for (int i = 0; i < boundary_input->layout.ngroup; ++i) {
        const pm_group *group = &boundary_input->layout.group[i];
        for (int k = 0; k < NLIST; ++k) {
            if (read[i].list[k] != NULL) {
                PM_TRY(
                    prescribe_list(r, read[i].list[k], group->size, &value[k * nz + group->first]));
            }
        }
    }
    boundary_input->value = value;
    return PM_OK;
}

static pm_status read_boundary_input(pm_scene_reader *r, pm_scene_boundary_input *boundary_input,
                                     pm_yaml key, pm_yaml groups) {
    group_lists written[PM_MAX_GROUPS] = {0};
    PM_TRY(pm_scene_read_name(r, key, &boundary_input->name));
    if (pm_scene_find_subsystem(r->scene, boundary_input->name) >= 0) {
        return pm_yaml_fail(key, "\"%s\" is the name of a subsystem already", boundary_input->name);
    }
    PM_TRY(pm_yaml_require_entries(groups));
    if (pm_yaml_count(groups) > PM_MAX_GROUPS) {
        return pm_yaml_fail(groups, "%d groups, at most %d are possible", pm_yaml_count(groups),
                            PM_MAX_GROUPS);
    }
    pm_layout *layout = &boundary_input->layout;
    layout->group = pm_arena_array(r->arena, (size_t)pm_yaml_count(groups), sizeof *layout->group);
    if (layout->group == NULL) {
        return pm_scene_no_memory();
    }
    for (int i = 0; i < pm_yaml_count(groups); ++i) {
        pm_yaml name, block;
        pm_yaml_entry(groups, i, &name, &block);
        PM_TRY(read_group(r, boundary_input, name, block, &written[i]));
    }
    return prescribe_groups(r, boundary_input, written);
}

pm_status pm_scene_read_boundary_inputs(pm_scene_reader *r) {
    pm_scene *scene = r->scene;
    const pm_yaml boundary_inputs = pm_yaml_get(r->root, "boundary_inputs");
    if (!pm_yaml_exists(boundary_inputs)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_require_entries(boundary_inputs));
    scene->boundary_input = pm_arena_array(r->arena, (size_t)pm_yaml_count(boundary_inputs),
                                           sizeof *scene->boundary_input);
    if (scene->boundary_input == NULL) {
        return pm_scene_no_memory();
    }
    for (int i = 0; i < pm_yaml_count(boundary_inputs); ++i) {
        pm_scene_boundary_input *boundary_input = &scene->boundary_input[scene->nboundary_input++];
        pm_yaml key, groups;
        pm_yaml_entry(boundary_inputs, i, &key, &groups);
        PM_TRY(read_boundary_input(r, boundary_input, key, groups));
        boundary_input->first = scene->nprescribed;
        scene->nprescribed += 3 * boundary_input->layout.nz;
    }
    return PM_OK;
}
