// Reads the section `record` of a scene: which subsystems a recording keeps, and how often.
#include "scene/scene_reader.h"

static pm_status mark(pm_scene_reader *r, pm_yaml at, const char *name) {
    const int id = pm_scene_find_subsystem(r->scene, name);
    if (id < 0) {
        char names[512];
        return pm_yaml_fail(at, "there is no subsystem \"%.64s\"; subsystems: %s", name,
                            pm_scene_subsystem_names(r->scene, names, sizeof names));
    }
    r->scene->recorded[id] = true;
    return PM_OK;
}

// Reads a list of names and ranges; an empty list records the totals alone.
static pm_status read_parts(pm_scene_reader *r, pm_yaml list) {
    int count;
    const char **text;
    PM_TRY(pm_yaml_texts(list, r->arena, &count, &text));
    r->scene->recorded =
        pm_arena_array(r->arena, (size_t)r->scene->nsubsystem, sizeof *r->scene->recorded);
    if (r->scene->recorded == NULL) {
        return pm_scene_no_memory();
    }
    for (int i = 0; i < count; ++i) {
        const pm_yaml at = pm_yaml_is_list(list) ? pm_yaml_item(list, i) : list;
        pm_scene_range range;
        PM_TRY(pm_scene_parse_range(r, at, text[i], &range));
        for (int k = 0; k < range.total; ++k) {
            const char *name;
            pm_scene_enter(r, &range, k);
            PM_TRY(pm_scene_expand(r, at, range.pattern, &name));
            PM_TRY(mark(r, at, name));
        }
    }
    r->naxis = 0;
    return PM_OK;
}

pm_status pm_scene_read_record(pm_scene_reader *r) {
    static const char *const keys[] = {"on_error", "parts", "every", NULL};
    static const char *const choices[] = {"stop", "go_on", NULL};
    r->scene->record_every = 1;
    const pm_yaml record = pm_yaml_get(r->root, "record");
    if (!pm_yaml_exists(record)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_allow(record, keys));
    const pm_yaml on_error = pm_yaml_get(record, "on_error");
    const pm_yaml parts = pm_yaml_get(record, "parts"), every = pm_yaml_get(record, "every");
    int choice = 0;
    PM_TRY(pm_yaml_exists(on_error) ? pm_yaml_choice(on_error, choices, &choice) : PM_OK);
    r->scene->outlives_recording = choice == 1;
    PM_TRY(pm_yaml_exists(every) ? pm_yaml_int(every, 1, 1000000000, &r->scene->record_every)
                                 : PM_OK);
    return pm_yaml_exists(parts) ? read_parts(r, parts) : PM_OK;
}
