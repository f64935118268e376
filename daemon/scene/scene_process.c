// Reads the section `processes: {NAME: [SUBSYSTEM, ...]}`, which says which subsystems share a
// process. Each of the others has a process of its own. `processes: {auto: N}` lets scene_cut.c
// divide the subsystems among N processes.
#include "scene/scene_reader.h"

#include <stdio.h>
#include <string.h>

#define UNASSIGNED (-1)

// Appends an empty process with room for `count` subsystems.
static pm_status add_process(pm_scene *scene, const char *name, int count) {
    pm_scene_process *process = &scene->process[scene->nprocess++];
    *process = (pm_scene_process){.name = name};
    process->subsystem = pm_arena_array(&scene->arena, (size_t)count, sizeof *process->subsystem);
    return process->subsystem == NULL ? pm_scene_no_memory() : PM_OK;
}

// --- the section ---

// Marks one subsystem with the position of its process in the section.
static pm_status mark_subsystem(pm_scene_reader *r, pm_yaml at, const char *name, int number) {
    const int id = pm_scene_find_subsystem(r->scene, name);
    if (id < 0) {
        char names[512];
        return pm_yaml_fail(at, "there is no subsystem \"%.64s\"; subsystems: %s", name,
                            pm_scene_subsystem_names(r->scene, names, sizeof names));
    }
    if (r->scene->subsystem[id].process != UNASSIGNED) {
        return pm_yaml_fail(at, "subsystem \"%s\" has a process already", name);
    }
    r->scene->subsystem[id].process = number;
    return PM_OK;
}

// Marks the subsystems of one process, which are named one by one or by ranges.
static pm_status mark_subsystems(pm_scene_reader *r, pm_yaml list, int number) {
    int count;
    const char **text;
    PM_TRY(pm_yaml_texts(list, r->arena, &count, &text));
    if (count == 0) {
        return pm_yaml_fail(list, "expected at least one subsystem");
    }
    for (int i = 0; i < count; ++i) {
        const pm_yaml at = pm_yaml_is_list(list) ? pm_yaml_item(list, i) : list;
        pm_scene_range range;
        PM_TRY(pm_scene_parse_range(r, at, text[i], &range));
        for (int k = 0; k < range.total; ++k) {
            const char *name;
            pm_scene_enter(r, &range, k);
            PM_TRY(pm_scene_expand(r, at, range.pattern, &name));
            PM_TRY(mark_subsystem(r, at, name, number));
        }
    }
    r->naxis = 0;
    return PM_OK;
}

// Refuses a process that has the name of a subsystem it does not serve: the channels of both would
// be the same.
static pm_status check_owner(pm_scene_reader *r, pm_yaml key, const char *name, int number) {
    const int id = pm_scene_find_subsystem(r->scene, name);
    return id < 0 || r->scene->subsystem[id].process == number
               ? PM_OK
               : pm_yaml_fail(key, "a subsystem is called \"%s\" that this process does not serve",
                              name);
}

// Reads the names of the processes and marks their subsystems.
static pm_status read_section(pm_scene_reader *r, pm_yaml section, const char **name) {
    pm_yaml key, list;
    for (int i = 0; i < pm_yaml_count(section); ++i) {
        pm_yaml_entry(section, i, &key, &list);
        PM_TRY(pm_scene_read_name(r, key, &name[i]));
        PM_TRY(mark_subsystems(r, list, i));
    }
    for (int i = 0; i < pm_yaml_count(section); ++i) {
        pm_yaml_entry(section, i, &key, &list);
        PM_TRY(check_owner(r, key, name[i], i));
    }
    return PM_OK;
}

// --- an automatic cut ---

// Reads the number N of a section {auto: N}; 0 for other sections. Names of subsystems do not begin
// with a digit, so that `auto` may be the name of a process, too.
static pm_status read_count(pm_scene_reader *r, pm_yaml section, int *count) {
    const pm_yaml number = pm_yaml_get(section, "auto");
    const char *text = "";
    *count = 0;
    if (pm_yaml_exists(number) && !pm_yaml_is_list(number) && !pm_yaml_is_map(number)) {
        PM_TRY(pm_yaml_text(number, r->arena, &text));
    }
    if (strchr("+-.0123456789", text[0]) == NULL || text[0] == '\0') {
        return PM_OK;
    }
    if (pm_yaml_count(section) > 1) {
        return pm_yaml_fail(number, "expected no other process beside a number of processes");
    }
    return pm_yaml_int(number, 1, r->scene->nsubsystem, count);
}

// Marks all subsystems, and names the processes auto0, auto1, ... `name` [N] receives the names.
static pm_status cut(pm_scene_reader *r, pm_yaml section, int count, const char **name) {
    pm_scene *scene = r->scene;
    int *mark = pm_arena_array(r->arena, (size_t)scene->nsubsystem, sizeof *mark);
    if (mark == NULL) {
        return pm_scene_no_memory();
    }
    const pm_status status = pm_scene_cut(scene, count, NULL, mark);
    if (status == PM_ECONFIG) {
        char reason[256];
        snprintf(reason, sizeof reason, "%s", pm_error());
        return pm_yaml_fail(pm_yaml_get(section, "auto"), "%s", reason);
    }
    PM_TRY(status);
    scene->nautomatic = count;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        scene->subsystem[i].process = mark[i];
    }
    for (int i = 0; i < count; ++i) {
        name[i] = pm_arena_printf(r->arena, "auto%d", i);
        PM_TRY(name[i] == NULL ? pm_scene_no_memory()
                               : check_owner(r, pm_yaml_get(section, "auto"), name[i], i));
    }
    return PM_OK;
}

// --- the processes ---

// Makes the processes in the order of their first subsystems. `made` [entries of the section]
// receives the process of each entry; the caller fills it with UNASSIGNED. `count` [entries] is the
// number of subsystems of each.
static pm_status make_processes(pm_scene *scene, const char *const *name, int *made,
                                const int *count) {
    for (int i = 0; i < scene->nsubsystem; ++i) {
        pm_scene_subsystem *subsystem = &scene->subsystem[i];
        const int mark = subsystem->process;
        const bool known = mark != UNASSIGNED && made[mark] != UNASSIGNED;
        if (!known) {
            const char *own = mark == UNASSIGNED ? subsystem->name : name[mark];
            PM_TRY(add_process(scene, own, mark == UNASSIGNED ? 1 : count[mark]));
        }
        subsystem->process = known ? made[mark] : scene->nprocess - 1;
        if (mark != UNASSIGNED) {
            made[mark] = subsystem->process;
        }
        pm_scene_process *process = &scene->process[subsystem->process];
        process->subsystem[process->count++] = i;
    }
    return PM_OK;
}

pm_status pm_scene_read_processes(pm_scene_reader *r) {
    pm_scene *scene = r->scene;
    const pm_yaml section = pm_yaml_get(r->root, "processes");
    if (pm_yaml_exists(section)) {
        PM_TRY(pm_yaml_require_entries(section));
    }
    int automatic;
    PM_TRY(read_count(r, section, &automatic));
    const size_t nmark = automatic > 0 ? (size_t)automatic : (size_t)pm_yaml_count(section);
    const char **name = pm_arena_array(r->arena, nmark, sizeof *name);
    int *made = pm_arena_array(r->arena, nmark, sizeof *made);
    scene->process = pm_arena_array(r->arena, (size_t)scene->nsubsystem, sizeof *scene->process);
    int *count = pm_arena_array(r->arena, nmark, sizeof *count);
    if (name == NULL || made == NULL || count == NULL || scene->process == NULL) {
        return pm_scene_no_memory();
    }
    for (size_t i = 0; i < nmark; ++i) {
        made[i] = UNASSIGNED;
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        scene->subsystem[i].process = UNASSIGNED;
    }
    PM_TRY(automatic > 0 ? cut(r, section, automatic, name) : read_section(r, section, name));
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const int mark = scene->subsystem[i].process;
        if (mark != UNASSIGNED) {
            ++count[mark];
        }
    }
    return make_processes(scene, name, made, count);
}

pm_status pm_scene_cut_by_cost(pm_scene *scene, const int *cost) {
    const size_t n = (size_t)scene->nautomatic;
    int *mark = pm_arena_array(&scene->arena, (size_t)scene->nsubsystem, sizeof *mark);
    int *made = pm_arena_array(&scene->arena, n, sizeof *made);
    int *count = pm_arena_array(&scene->arena, n, sizeof *count);
    const char **name = pm_arena_array(&scene->arena, n, sizeof *name);
    if (mark == NULL || made == NULL || count == NULL || name == NULL) {
        return pm_scene_no_memory();
    }
    PM_TRY(pm_scene_cut(scene, scene->nautomatic, cost, mark));
    for (int i = 0; i < scene->nautomatic; ++i) {
        made[i] = UNASSIGNED;
        name[i] = pm_arena_printf(&scene->arena, "auto%d", i);
        if (name[i] == NULL) {
            return pm_scene_no_memory();
        }
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        scene->subsystem[i].process = mark[i];
        ++count[mark[i]];
    }
    scene->nprocess = 0;
    return make_processes(scene, name, made, count);
}

pm_status pm_scene_join_processes(pm_scene *scene) {
    scene->nprocess = 0;
    PM_TRY(add_process(scene, "all", scene->nsubsystem));
    for (int i = 0; i < scene->nsubsystem; ++i) {
        scene->subsystem[i].process = 0;
        scene->process[0].subsystem[i] = i;
    }
    scene->process[0].count = scene->nsubsystem;
    return PM_OK;
}
