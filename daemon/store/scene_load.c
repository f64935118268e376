// Reading the loads of a scene: what the world shows at its end of a port, over time.
#include "store/scene_reader.h"

#include <math.h>
#include <string.h>

enum { VALUE, DE, DS, NLIST }; // in the order a port shows them
static const char *const list_key[NLIST] = {[VALUE] = "value", [DE] = "dE", [DS] = "dS"};

// What is written of a group: columns and numbers; NULL: all are the number 0.
typedef struct lists {
    pm_scene_named *list[NLIST]; // [size of the group]
} lists;

static pm_status read_lists(pm_scene_reader *r, pm_yaml block, pm_group *group, lists *read) {
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

static pm_status read_group(pm_scene_reader *r, pm_scene_world *load, pm_yaml key, pm_yaml block,
                            lists *read) {
    static const char *const keys[] = {"unit", "dE", "dS", "value", NULL};
    pm_yaml unit;
    pm_group *group = &load->layout.group[load->layout.ngroup];
    PM_TRY(pm_scene_read_name(r, key, &group->name));
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(pm_yaml_require(block, "unit", &unit));
    PM_TRY(pm_yaml_text(unit, r->arena, &group->unit));
    PM_TRY(read_lists(r, block, group, read));
    group->first = load->layout.nz;
    load->layout.nz += group->size;
    ++load->layout.ngroup;
    load->entropy = load->entropy || read->list[DS] != NULL;
    return PM_OK;
}

// A number, or the name of a dataset column: numbers begin with a digit, a sign or a point.
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

static pm_status prescribe_groups(pm_scene_reader *r, pm_scene_world *load, const lists *read) {
    const int nz = load->layout.nz;
    pm_scene_prescribed *value = pm_arena_array(r->arena, NLIST * (size_t)nz, sizeof *value);
    if (value == NULL) {
        return pm_scene_no_memory();
    }
    for (int i = 0; i < load->layout.ngroup; ++i) {
        const pm_group *group = &load->layout.group[i];
        for (int k = 0; k < NLIST; ++k) {
            if (read[i].list[k] != NULL) {
                PM_TRY(
                    prescribe_list(r, read[i].list[k], group->size, &value[k * nz + group->first]));
            }
        }
    }
    load->value = value;
    return PM_OK;
}

static pm_status read_load(pm_scene_reader *r, pm_scene_world *load, pm_yaml key, pm_yaml groups) {
    lists written[PM_MAX_GROUPS] = {0};
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
        PM_TRY(read_group(r, load, name, block, &written[i]));
    }
    return prescribe_groups(r, load, written);
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
