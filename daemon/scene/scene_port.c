// Reads the section `ports` of a scene: which law joins which groups of two subsystems, or of a
// subsystem and a boundary input.
#include "scene/scene_reader.h"

#include <string.h>

#include "model/port.h"

static pm_status read_law(pm_scene_reader *r, pm_scene_port *port, pm_yaml block) {
    pm_yaml law;
    PM_TRY(pm_yaml_require(block, "law", &law));
    PM_TRY(pm_yaml_text(law, r->arena, &port->law));
    PM_TRY(pm_scene_read_at(r, law, &port->law_at));
    return pm_port_law_find(port->law) != NULL
               ? PM_OK
               : pm_yaml_fail(law, "expected one of %s, found \"%.64s\"", pm_port_law_names(),
                              port->law);
}

static pm_status read_between(pm_scene_reader *r, pm_scene_port *port, pm_yaml block) {
    pm_yaml between;
    int count;
    const char **name;
    PM_TRY(pm_yaml_require(block, "between", &between));
    PM_TRY(pm_yaml_texts(between, r->arena, &count, &name));
    if (count != 2) {
        return pm_yaml_fail(between, "expected two subsystems [a, b], found %d", count);
    }
    for (int end = 0; end < 2; ++end) {
        port->subsystem[end] = pm_scene_find_subsystem(r->scene, name[end]);
        port->boundary_input[end] = pm_scene_find_boundary_input(r->scene, name[end]);
        if (port->subsystem[end] < 0 && port->boundary_input[end] < 0) {
            char names[512];
            return pm_yaml_fail(pm_yaml_item(between, end),
                                "there is no subsystem or boundary input \"%.64s\"; there are: %s",
                                name[end], pm_scene_end_names(r->scene, names, sizeof names));
        }
    }
    if (port->boundary_input[0] >= 0 && port->boundary_input[1] >= 0) {
        return pm_yaml_fail(between, "expected a subsystem at one end, found two boundary inputs");
    }
    return port->subsystem[0] != port->subsystem[1]
               ? PM_OK
               : pm_yaml_fail(between, "expected two different subsystems, found \"%s\" twice",
                              name[0]);
}

// Reads the exposed groups of one end, in the order written, and the positions of their components
// in the end's whole state.
static pm_status read_exposed(pm_scene_reader *r, pm_scene_port *port, int end, pm_yaml expose) {
    const char *owner = pm_scene_end_name(r->scene, port, end);
    const pm_layout *whole = pm_scene_end_layout(r->scene, port, end);
    pm_layout *layout = &port->layout[end];
    pm_yaml list;
    int count;
    const char **name;
    PM_TRY(pm_yaml_require(expose, owner, &list));
    PM_TRY(pm_scene_read_at(r, list, &port->expose_at[end]));
    PM_TRY(pm_yaml_texts(list, r->arena, &count, &name));
    if (count == 0) {
        return pm_yaml_fail(list, "expected at least one group of %s", owner);
    }
    int *component = pm_arena_array(r->arena, (size_t)whole->nz, sizeof *component);
    if (component == NULL) {
        return pm_scene_no_memory();
    }
    for (int i = 0; i < count; ++i) {
        const pm_yaml at = pm_yaml_is_list(list) ? pm_yaml_item(list, i) : list;
        const pm_group *group = pm_layout_find(whole, name[i]);
        if (group == NULL) {
            char names[512];
            return pm_yaml_fail(at, "%s has no group \"%.64s\"; groups: %s", owner, name[i],
                                pm_scene_group_names(whole, names, sizeof names));
        }
        if (pm_layout_find(layout, name[i]) != NULL) {
            return pm_yaml_fail(at, "group \"%s\" occurs twice", name[i]);
        }
        pm_group *exposed = &layout->group[layout->ngroup++];
        *exposed = *group;
        exposed->first = layout->nz;
        for (int j = 0; j < group->size; ++j) {
            component[layout->nz++] = group->first + j;
        }
    }
    port->component[end] = component;
    return PM_OK;
}

static pm_status read_port(pm_scene_reader *r, pm_scene_port *port, pm_yaml key, pm_yaml block) {
    static const char *const keys[] = {"law",   "between",   "expose", "weights",
                                       "model", "constants", NULL};
    pm_yaml expose;
    PM_TRY(pm_scene_read_name(r, key, &port->name));
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(read_law(r, port, block));
    PM_TRY(read_between(r, port, block));
    PM_TRY(pm_yaml_require(block, "expose", &expose));
    const char *const ends[] = {pm_scene_end_name(r->scene, port, 0),
                                pm_scene_end_name(r->scene, port, 1), NULL};
    PM_TRY(pm_yaml_allow(expose, ends));
    PM_TRY(read_exposed(r, port, 0, expose));
    PM_TRY(read_exposed(r, port, 1, expose));
    return pm_scene_read_port_maker(r, block, port);
}

pm_status pm_scene_read_ports(pm_scene_reader *r) {
    pm_scene *scene = r->scene;
    const pm_yaml ports = pm_yaml_get(r->root, "ports");
    if (!pm_yaml_exists(ports)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_require_entries(ports));
    scene->nport = pm_yaml_count(ports);
    scene->port = pm_arena_array(r->arena, (size_t)scene->nport, sizeof *scene->port);
    if (scene->port == NULL) {
        return pm_scene_no_memory();
    }
    for (int i = 0; i < scene->nport; ++i) {
        pm_yaml key, block;
        pm_yaml_entry(ports, i, &key, &block);
        PM_TRY(read_port(r, &scene->port[i], key, block));
    }
    return PM_OK;
}
