// Reads the section `subsystems` of a scene: states, initial values, dataset columns, and groups
// that are measured from a group of another subsystem (relative_to).
#include "scene/scene_reader.h"

#include <string.h>

#include "store/names.h"

#define MAX_COMPONENTS 1000000 // of one group
#define MAX_STATE 1000000      // components of the scene

// --- one subsystem ---

// Reads one group of a state; `columns` receives its dataset columns [size], or NULL.
static pm_status read_group(pm_scene_reader *r, pm_scene_subsystem *subsystem, pm_yaml key,
                            pm_yaml block, pm_scene_named **columns) {
    pm_layout *layout = &subsystem->layout;
    static const char *const keys[] = {"unit", "columns", "size", "relative_to", "hidden", NULL};
    pm_yaml unit;
    pm_group group = {.first = layout->nz};
    PM_TRY(pm_scene_read_name(r, key, &group.name));
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(pm_yaml_require(block, "unit", &unit));
    PM_TRY(pm_yaml_text(unit, r->arena, &group.unit));
    if (strchr(group.unit, ';') != NULL) {
        return pm_yaml_fail(unit, "expected a unit without ';', found \"%.64s\"", group.unit);
    }
    const pm_yaml list = pm_yaml_get(block, "columns"), size = pm_yaml_get(block, "size");
    const bool hidden = pm_yaml_exists(pm_yaml_get(block, "hidden"));
    if (pm_yaml_exists(list) == pm_yaml_exists(size) && !(hidden && !pm_yaml_exists(list))) {
        return pm_yaml_fail(block, "expected either \"columns\" (of a dataset) or \"size\"");
    }
    *columns = NULL;
    group.size = 1;
    if (pm_yaml_exists(size)) {
        PM_TRY(pm_yaml_int(size, 1, MAX_COMPONENTS, &group.size));
    } else if (pm_yaml_exists(list)) {
        PM_TRY(pm_scene_read_columns(r, list, &group.size, columns));
    }
    layout->nz += group.size;
    layout->group[layout->ngroup++] = group;
    return hidden ? pm_scene_read_hidden(r, subsystem, block, columns) : PM_OK;
}

// Concatenates the groups' columns to those of the state.
static pm_status join_columns(pm_scene_reader *r, pm_scene_subsystem *subsystem,
                              pm_scene_named *const *columns) {
    const pm_layout *layout = &subsystem->layout;
    const char **column = pm_arena_array(r->arena, (size_t)layout->nz, sizeof *column);
    const char **at = pm_arena_array(r->arena, (size_t)layout->nz, sizeof *at);
    if (column == NULL || at == NULL) {
        return pm_scene_no_memory();
    }
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        for (int j = 0; j < group->size; ++j) {
            column[group->first + j] = columns[i][j].text;
        }
        PM_TRY(pm_scene_read_places(r, columns[i], group->size, &at[group->first]));
    }
    subsystem->column = column;
    subsystem->column_at = at;
    return PM_OK;
}

// Lets no group be measured from another.
static pm_status make_relative(pm_scene_reader *r, pm_scene_subsystem *s, size_t count) {
    s->relative_subsystem = pm_arena_array(r->arena, count, sizeof *s->relative_subsystem);
    s->relative_group = pm_arena_array(r->arena, count, sizeof *s->relative_group);
    if (s->relative_subsystem == NULL || s->relative_group == NULL) {
        return pm_scene_no_memory();
    }
    for (size_t i = 0; i < count; ++i) {
        s->relative_subsystem[i] = s->relative_group[i] = -1;
    }
    return PM_OK;
}

// Makes room for what is known of each group of a state.
static pm_status make_groups(pm_scene_reader *r, pm_scene_subsystem *s, size_t count) {
    s->layout.group = pm_arena_array(r->arena, count, sizeof *s->layout.group);
    s->group_at = pm_arena_array(r->arena, count, sizeof *s->group_at);
    s->hidden = pm_arena_array(r->arena, count, sizeof *s->hidden);
    s->guess = pm_arena_array(r->arena, count, sizeof *s->guess);
    s->deviation = pm_arena_array(r->arena, count, sizeof *s->deviation);
    return s->layout.group == NULL || s->group_at == NULL || s->hidden == NULL ||
                   s->guess == NULL || s->deviation == NULL
               ? pm_scene_no_memory()
               : make_relative(r, s, count);
}

static pm_status read_state(pm_scene_reader *r, pm_scene_subsystem *subsystem, pm_yaml state) {
    pm_scene_named *columns[PM_MAX_GROUPS] = {NULL};
    PM_TRY(pm_yaml_require_entries(state));
    if (pm_yaml_count(state) > PM_MAX_GROUPS) {
        return pm_yaml_fail(state, "%d groups, at most %d are possible", pm_yaml_count(state),
                            PM_MAX_GROUPS);
    }
    PM_TRY(make_groups(r, subsystem, (size_t)pm_yaml_count(state)));
    for (int i = 0; i < pm_yaml_count(state); ++i) {
        pm_yaml key, block;
        pm_yaml_entry(state, i, &key, &block);
        PM_TRY(read_group(r, subsystem, key, block, &columns[i]));
        PM_TRY(pm_scene_read_at(r, key, &subsystem->group_at[i]));
        const bool mapped = subsystem == r->scene->subsystem ? columns[0] != NULL
                                                             : r->scene->subsystem->column != NULL;
        if ((columns[i] != NULL) != mapped) {
            return pm_yaml_fail(block,
                                "expected \"%s\" as in the groups before: either all groups "
                                "of a scene name dataset columns or none does",
                                mapped ? "columns" : "size");
        }
    }
    return columns[0] == NULL ? PM_OK : join_columns(r, subsystem, columns);
}

static pm_status read_initial(pm_scene_reader *r, pm_scene_subsystem *subsystem, pm_yaml initial) {
    const pm_layout *layout = &subsystem->layout;
    const char *keys[PM_MAX_GROUPS + 1] = {NULL};
    double *z = pm_arena_array(r->arena, (size_t)layout->nz, sizeof *z);
    if (z == NULL) {
        return pm_scene_no_memory();
    }
    for (int i = 0; i < layout->ngroup; ++i) {
        keys[i] = layout->group[i].name;
    }
    PM_TRY(pm_yaml_allow(initial, keys));
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        pm_yaml list;
        int count;
        double *value;
        PM_TRY(pm_yaml_require(initial, group->name, &list));
        PM_TRY(pm_yaml_doubles(list, r->arena, &count, &value));
        if (count != group->size) {
            return pm_yaml_fail(list, "expected %d numbers, found %d", group->size, count);
        }
        memcpy(z + group->first, value, (size_t)count * sizeof *z);
    }
    subsystem->initial = z;
    return PM_OK;
}

// Reads a subsystem; its name has been read.
static pm_status read_subsystem(pm_scene_reader *r, pm_scene_subsystem *subsystem, pm_yaml key,
                                pm_yaml block) {
    static const char *const keys[] = {"weights", "model",   "constants", "mesh",
                                       "state",   "initial", "substeps",  NULL};
    pm_yaml state;
    PM_TRY(pm_scene_read_at(r, key, &subsystem->at));
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(pm_scene_read_part_maker(r, block, subsystem));
    const pm_yaml mesh = pm_yaml_get(block, "mesh");
    if (pm_yaml_exists(mesh)) {
        PM_TRY(pm_scene_read_path(r, mesh, &subsystem->mesh));
        PM_TRY(pm_scene_read_at(r, mesh, &subsystem->mesh_at));
    }
    PM_TRY(pm_yaml_require(block, "state", &state));
    PM_TRY(read_state(r, subsystem, state));
    const pm_yaml substeps = pm_yaml_get(block, "substeps");
    subsystem->substeps = 1;
    if (pm_yaml_exists(substeps)) {
        PM_TRY(pm_yaml_int(substeps, 1, 100000, &subsystem->substeps));
        PM_TRY(pm_scene_read_at(r, substeps, &subsystem->substeps_at));
    }
    const pm_yaml initial = pm_yaml_get(block, "initial");
    return pm_yaml_exists(initial) ? read_initial(r, subsystem, initial) : PM_OK;
}

// Returns true if a group of a subsystem with this block is measured from another.
static bool is_relative(pm_yaml state) {
    bool is = false;
    for (int i = 0; i < pm_yaml_count(state) && !is; ++i) {
        pm_yaml key, group;
        pm_yaml_entry(state, i, &key, &group);
        is = pm_yaml_exists(pm_yaml_get(group, "relative_to"));
    }
    return is;
}

// Makes a subsystem like the first one of its range. It has a name and columns of its own.
static pm_status repeat_subsystem(pm_scene_reader *r, const pm_scene_subsystem *first,
                                  pm_scene_subsystem *subsystem, pm_yaml block) {
    pm_scene_named *columns[PM_MAX_GROUPS] = {NULL};
    const char *name = subsystem->name;
    *subsystem = *first;
    subsystem->name = name;
    const pm_yaml state = pm_yaml_get(block, "state");
    if (is_relative(state)) {
        PM_TRY(make_relative(r, subsystem, (size_t)first->layout.ngroup));
    }
    for (int i = 0; i < first->layout.ngroup && first->column != NULL; ++i) {
        pm_yaml key, group;
        pm_yaml_entry(state, i, &key, &group);
        const pm_yaml list = pm_yaml_get(group, "columns");
        int count;
        PM_TRY(pm_scene_read_columns(r, list, &count, &columns[i]));
        if (count != first->layout.group[i].size) {
            return pm_yaml_fail(list, "%d columns, and %s has %d", count, first->name,
                                first->layout.group[i].size);
        }
    }
    return first->column == NULL ? PM_OK : join_columns(r, subsystem, columns);
}

// Returns the block of a group, by positions.
static pm_yaml group_block(const pm_scene_entries *entries, int subsystem_id, int group_id) {
    pm_yaml key, value;
    pm_yaml_entry(entries->map, pm_scene_entry_of(entries, subsystem_id), &key, &value);
    pm_yaml_entry(pm_yaml_get(value, "state"), group_id, &key, &value);
    return value;
}

static pm_status check_columns(pm_scene_reader *r) {
    const pm_scene *scene = r->scene;
    if (scene->subsystem->column == NULL) {
        return PM_OK;
    }
    pm_names names;
    const char **column = pm_arena_array(r->arena, (size_t)scene->nz, sizeof *column);
    if (column == NULL) {
        return pm_scene_no_memory();
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_scene_subsystem *subsystem = &scene->subsystem[i];
        memcpy(column + subsystem->first, subsystem->column,
               (size_t)subsystem->layout.nz * sizeof *column);
    }
    PM_TRY(pm_names_sort(&names, column, scene->nz, r->arena));
    const int twice = pm_names_twice(&names);
    const pm_scene_subsystem *owner = scene->subsystem;
    while (twice >= owner->first + owner->layout.nz) {
        ++owner;
    }
    return twice < 0 ? PM_OK
                     : pm_fail(PM_ECONFIG, "%s: columns: dataset column \"%.64s\" occurs twice",
                               owner->column_at[twice - owner->first], column[twice]);
}

// --- groups measured from another ---

static pm_status read_relative(pm_scene_reader *r, pm_scene_subsystem *subsystem, int group_id,
                               pm_yaml at) {
    const pm_scene *scene = r->scene;
    const pm_group *group = &subsystem->layout.group[group_id];
    char names[512];
    const char *text;
    PM_TRY(pm_scene_read_indexed(r, at, &text));
    const char *dot = strchr(text, '.');
    if (dot == NULL) {
        return pm_yaml_fail(at, "expected SUBSYSTEM.GROUP, found \"%.64s\"", text);
    }
    const char *name = pm_arena_printf(r->arena, "%.*s", (int)(dot - text), text);
    if (name == NULL) {
        return pm_scene_no_memory();
    }
    const int other_id = pm_scene_find_subsystem(scene, name);
    if (other_id < 0) {
        return pm_yaml_fail(at, "there is no subsystem \"%.64s\"; subsystems: %s", name,
                            pm_scene_subsystem_names(scene, names, sizeof names));
    }
    const pm_layout *layout = &scene->subsystem[other_id].layout;
    const pm_group *other = pm_layout_find(layout, dot + 1);
    if (other == NULL) {
        return pm_yaml_fail(at, "%s has no group \"%.64s\"; groups: %s", name, dot + 1,
                            pm_scene_group_names(layout, names, sizeof names));
    }
    if (other->size != group->size || strcmp(other->unit, group->unit) != 0) {
        return pm_yaml_fail(at, "%.64s has %d components in %.32s, expected %d in %.32s", text,
                            other->size, other->unit, group->size, group->unit);
    }
    subsystem->relative_subsystem[group_id] = other_id;
    subsystem->relative_group[group_id] = (int)(other - layout->group);
    return PM_OK;
}

// Returns true if the chain of relative_to that starts at a group ends. `walk`
// [nsubsystem][PM_MAX_GROUPS] keeps, from call to call, by which walk a group was first reached,
// counting from 1: a walk that reaches a group of its own is in a cycle, and one that reaches a
// group of an earlier walk ends.
static bool chain_ends(const pm_scene *scene, int subsystem_id, int group_id, int *walk) {
    const int own = subsystem_id * PM_MAX_GROUPS + group_id + 1;
    for (;;) {
        int *reached = &walk[(ptrdiff_t)subsystem_id * PM_MAX_GROUPS + group_id];
        const pm_scene_subsystem *subsystem = &scene->subsystem[subsystem_id];
        if (*reached != 0 || subsystem->relative_subsystem[group_id] < 0) {
            return *reached != own;
        }
        *reached = own;
        subsystem_id = subsystem->relative_subsystem[group_id];
        group_id = subsystem->relative_group[group_id];
    }
}

static pm_yaml relative_of(const pm_scene_entries *entries, int subsystem_id, int group_id) {
    return pm_yaml_get(group_block(entries, subsystem_id, group_id), "relative_to");
}

static pm_status read_relatives(pm_scene_reader *r, const pm_scene_entries *entries) {
    for (int i = 0; i < r->scene->nsubsystem; ++i) {
        pm_scene_subsystem *subsystem = &r->scene->subsystem[i];
        const int entry = pm_scene_entry_of(entries, i);
        pm_scene_enter(r, &entries->range[entry], i - entries->first[entry]);
        for (int g = 0; g < subsystem->layout.ngroup; ++g) {
            const pm_yaml at = relative_of(entries, i, g);
            if (pm_yaml_exists(at)) {
                PM_TRY(read_relative(r, subsystem, g, at));
            }
        }
    }
    return PM_OK;
}

static pm_status check_chains(pm_scene_reader *r, const pm_scene_entries *entries) {
    const pm_scene *scene = r->scene;
    pm_arena arena = {0};
    int *walk = pm_arena_array(&arena, (size_t)scene->nsubsystem * PM_MAX_GROUPS, sizeof *walk);
    pm_status status = walk == NULL ? pm_scene_no_memory() : PM_OK;
    for (int i = 0; i < scene->nsubsystem && status == PM_OK; ++i) {
        for (int g = 0; g < scene->subsystem[i].layout.ngroup && status == PM_OK; ++g) {
            if (!chain_ends(scene, i, g, walk)) {
                status = pm_yaml_fail(relative_of(entries, i, g),
                                      "a cycle: each group of this chain is measured from the "
                                      "next, none from the origin");
            }
        }
    }
    pm_arena_free(&arena);
    return status;
}

// --- all of them ---

static const char *name_of(const pm_scene *scene, int id) {
    return scene->subsystem[id].name;
}

static pm_status read_all(pm_scene_reader *r, const pm_scene_entries *entries) {
    pm_scene *scene = r->scene;
    for (int i = 0; i < entries->total; ++i) {
        pm_scene_subsystem *subsystem = &scene->subsystem[i];
        pm_yaml key, block;
        int first;
        PM_TRY(pm_scene_enter_entry(r, entries, i, &key, &block, &subsystem->name, &first));
        PM_TRY(first == i ? read_subsystem(r, subsystem, key, block)
                          : repeat_subsystem(r, &scene->subsystem[first], subsystem, block));
        subsystem->range = pm_scene_range_of(entries, i);
        subsystem->first = scene->nz;
        scene->nz += subsystem->layout.nz;
        if (scene->nz > MAX_STATE) {
            return pm_yaml_fail(key, "more than %d components in all", MAX_STATE);
        }
    }
    return PM_OK;
}

pm_status pm_scene_read_subsystems(pm_scene_reader *r) {
    pm_scene *scene = r->scene;
    pm_yaml subsystems;
    pm_scene_entries entries;
    PM_TRY(pm_yaml_require(r->root, "subsystems", &subsystems));
    PM_TRY(pm_yaml_require_entries(subsystems));
    PM_TRY(pm_scene_read_entries(r, subsystems, &entries));
    scene->nsubsystem = entries.total;
    scene->subsystem =
        pm_arena_array(r->arena, (size_t)scene->nsubsystem, sizeof *scene->subsystem);
    if (scene->subsystem == NULL) {
        return pm_scene_no_memory();
    }
    PM_TRY(read_all(r, &entries));
    PM_TRY(pm_scene_sort_names(r, &entries, name_of, &scene->subsystem_names));
    PM_TRY(check_columns(r));
    PM_TRY(read_relatives(r, &entries));
    r->naxis = 0;
    return check_chains(r, &entries);
}
