// Reading the loads of a scene: what the world shows at its end of a port, over time.
#include "store/scene_reader.h"

#include <math.h>
#include <string.h>

#define MAX_COMPONENTS 1000 // of one group

// A number, or the name of a dataset column: numbers begin with a digit, a sign or a point.
static pm_status read_prescribed(pm_scene_reader *r, pm_yaml at, pm_scene_prescribed *result) {
    PM_TRY(pm_yaml_text(at, r->arena, &result->column));
    PM_TRY(pm_scene_read_at(r, at, &result->at));
    if (strchr("+-.0123456789", result->column[0]) == NULL) {
        return PM_OK;
    }
    result->column = NULL;
    return pm_yaml_double(at, -INFINITY, INFINITY, &result->number);
}

// The list under `key`, one entry per component of the group; without it all are the number 0.
static pm_status read_list(pm_scene_reader *r, pm_yaml block, const char *key, int count,
                           pm_scene_prescribed *result) {
    const pm_yaml list = pm_yaml_get(block, key);
    if (!pm_yaml_exists(list)) {
        return PM_OK;
    }
    const int found = pm_yaml_is_list(list) ? pm_yaml_count(list) : 1;
    if (found != count) {
        return pm_yaml_fail(list, "expected %d as under \"dE\", found %d", count, found);
    }
    for (int i = 0; i < count; ++i) {
        PM_TRY(
            read_prescribed(r, pm_yaml_is_list(list) ? pm_yaml_item(list, i) : list, &result[i]));
    }
    return PM_OK;
}

static pm_status read_group(pm_scene_reader *r, pm_scene_world *load, pm_yaml key, pm_yaml block) {
    static const char *const keys[] = {"unit", "dE", "dS", "value", NULL};
    pm_yaml unit, list;
    pm_group *group = &load->layout.group[load->layout.ngroup];
    PM_TRY(pm_scene_read_name(r, key, &group->name));
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(pm_yaml_require(block, "unit", &unit));
    PM_TRY(pm_yaml_text(unit, r->arena, &group->unit));
    PM_TRY(pm_yaml_require(block, "dE", &list));
    group->size = pm_yaml_is_list(list) ? pm_yaml_count(list) : 1;
    if (group->size < 1 || group->size > MAX_COMPONENTS) {
        return pm_yaml_fail(list, "expected 1 to %d components, found %d", MAX_COMPONENTS,
                            group->size);
    }
    group->first = load->layout.nz;
    load->layout.nz += group->size;
    ++load->layout.ngroup;
    load->entropy = load->entropy || pm_yaml_exists(pm_yaml_get(block, "dS"));
    return PM_OK;
}

// The three lists of every group, in the order a port shows them.
static pm_status read_values(pm_scene_reader *r, pm_scene_world *load, pm_yaml groups) {
    static const char *const keys[] = {"value", "dE", "dS"};
    const int nz = load->layout.nz;
    pm_scene_prescribed *value = pm_arena_array(r->arena, 3 * (size_t)nz, sizeof *value);
    if (value == NULL) {
        return pm_scene_no_memory();
    }
    for (int i = 0; i < load->layout.ngroup; ++i) {
        const pm_group *group = &load->layout.group[i];
        pm_yaml key, block;
        pm_yaml_entry(groups, i, &key, &block);
        for (int k = 0; k < 3; ++k) {
            PM_TRY(read_list(r, block, keys[k], group->size, &value[k * nz + group->first]));
        }
    }
    load->value = value;
    return PM_OK;
}

static pm_status read_load(pm_scene_reader *r, pm_scene_world *load, pm_yaml key, pm_yaml groups) {
    PM_TRY(pm_scene_read_name(r, key, &load->name));
    if (pm_scene_find_subsystem(r->scene, load->name) >= 0) {
        return pm_yaml_fail(key, "\"%s\" is the name of a subsystem already", load->name);
    }
    PM_TRY(pm_yaml_require_entries(groups));
    if (pm_yaml_count(groups) > PM_MAX_GROUPS) {
        return pm_yaml_fail(groups, "%d groups, at most %d are possible", pm_yaml_count(groups),
                            PM_MAX_GROUPS);
    }
    for (int i = 0; i < pm_yaml_count(groups); ++i) {
        pm_yaml name, block;
        pm_yaml_entry(groups, i, &name, &block);
        PM_TRY(read_group(r, load, name, block));
    }
    return read_values(r, load, groups);
}

pm_status pm_scene_read_loads(pm_scene_reader *r) {
    pm_scene *scene = r->scene;
    const pm_yaml loads = pm_yaml_get(r->root, "loads");
    if (!pm_yaml_exists(loads)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_require_entries(loads));
    scene->load = pm_arena_array(r->arena, (size_t)pm_yaml_count(loads), sizeof *scene->load);
    if (scene->load == NULL) {
        return pm_scene_no_memory();
    }
    for (int i = 0; i < pm_yaml_count(loads); ++i) {
        pm_scene_world *load = &scene->load[scene->nload++];
        pm_yaml key, groups;
        pm_yaml_entry(loads, i, &key, &groups);
        PM_TRY(read_load(r, load, key, groups));
        load->first = scene->nprescribed;
        scene->nprescribed += 3 * load->layout.nz;
    }
    return PM_OK;
}
