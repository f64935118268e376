// Reads the section `ports` of a scene: which law joins which groups of two subsystems, or of a
// subsystem and a boundary input.
#include "scene/scene_reader.h"

#include <limits.h>
#include <stdlib.h>
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

// Reads the two ends; `text` receives their names as they stand in the file.
static pm_status read_between(pm_scene_reader *r, pm_scene_port *port, pm_yaml block,
                              const char *text[2]) {
    pm_yaml between;
    int count;
    const char **name;
    PM_TRY(pm_yaml_require(block, "between", &between));
    PM_TRY(pm_yaml_texts(between, r->arena, &count, &name));
    if (count != 2) {
        return pm_yaml_fail(between, "expected two subsystems [a, b], found %d", count);
    }
    for (int end = 0; end < 2; ++end) {
        text[end] = port->between[end] = name[end];
        PM_TRY(pm_scene_expand(r, pm_yaml_item(between, end), name[end], &name[end]));
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
// in the end's whole state. `key` is the name of the end as it stands in the file.
static pm_status read_exposed(pm_scene_reader *r, pm_scene_port *port, int end, pm_yaml expose,
                              const char *key) {
    const char *owner = pm_scene_end_name(r->scene, port, end);
    const pm_layout *whole = pm_scene_end_layout(r->scene, port, end);
    pm_layout *layout = &port->layout[end];
    pm_yaml list;
    int count;
    const char **name;
    PM_TRY(pm_yaml_require(expose, key, &list));
    PM_TRY(pm_scene_read_at(r, list, &port->expose_at[end]));
    PM_TRY(pm_yaml_texts(list, r->arena, &count, &name));
    if (count == 0) {
        return pm_yaml_fail(list, "expected at least one group of %s", owner);
    }
    int *component = pm_arena_array(r->arena, (size_t)whole->nz, sizeof *component);
    *layout = (pm_layout){
        .group = pm_arena_array(r->arena, (size_t)whole->ngroup, sizeof *layout->group)};
    if (component == NULL || layout->group == NULL) {
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

// Reads the exposed groups of both ends, whose names in the file are `text`.
static pm_status read_expose(pm_scene_reader *r, pm_scene_port *port, pm_yaml block,
                             const char *const text[2]) {
    pm_yaml expose;
    PM_TRY(pm_yaml_require(block, "expose", &expose));
    const char *const ends[] = {text[0], text[1], NULL};
    PM_TRY(pm_yaml_allow(expose, ends));
    PM_TRY(read_exposed(r, port, 0, expose, text[0]));
    return read_exposed(r, port, 1, expose, text[1]);
}

// Reads a port; its name has been read.
static pm_status read_port(pm_scene_reader *r, pm_scene_port *port, pm_yaml block) {
    static const char *const keys[] = {"law",   "between",   "expose", "weights",
                                       "model", "constants", "table",  NULL};
    const char *text[2];
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(read_law(r, port, block));
    PM_TRY(read_between(r, port, block, text));
    PM_TRY(read_expose(r, port, block, text));
    return pm_scene_read_port_maker(r, block, port);
}

// Makes a port like the first one of its range. It has a name and ends of its own.
static pm_status repeat_port(pm_scene_reader *r, const pm_scene_port *first, pm_scene_port *port,
                             pm_yaml block) {
    const char *name = port->name, *text[2];
    *port = *first;
    port->name = name;
    PM_TRY(read_between(r, port, block, text));
    bool alike = true;
    for (int end = 0; end < 2; ++end) {
        alike = alike && pm_layout_equal(pm_scene_end_layout(r->scene, port, end),
                                         pm_scene_end_layout(r->scene, first, end));
    }
    if (alike) {
        return PM_OK;
    }
    return read_expose(r, port, block, text);
}

// Lists the ends of ports at each subsystem.
static pm_status list_ends(pm_scene *scene) {
    const size_t n = (size_t)scene->nsubsystem;
    scene->first_end = pm_arena_array(&scene->arena, n + 2, sizeof *scene->first_end);
    scene->end_at = pm_arena_array(&scene->arena, 2 * (size_t)scene->nport, sizeof *scene->end_at);
    if (scene->first_end == NULL || scene->end_at == NULL) {
        return pm_scene_no_memory();
    }
    // Counts first, one place further on, so that filling moves each start to where it belongs.
    int *next = scene->first_end + 1;
    for (int k = 0; k < 2 * scene->nport; ++k) {
        const int id = scene->port[k / 2].subsystem[k % 2];
        if (id >= 0) {
            ++next[id + 1];
        }
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        next[i + 1] += next[i];
    }
    for (int k = 0; k < 2 * scene->nport; ++k) {
        const int id = scene->port[k / 2].subsystem[k % 2];
        if (id >= 0) {
            scene->end_at[next[id]++] = k;
        }
    }
    return PM_OK;
}

// Finds the subsystems that ports connect with the first one, ring by ring. Twice the number of
// rings is a bound on the diameter, and so is the number of subsystems.
static pm_status measure_diameter(pm_scene *scene) {
    int *found = calloc((size_t)scene->nsubsystem + 1, sizeof *found); // in the order of finding
    int *ring = calloc((size_t)scene->nsubsystem + 1, sizeof *ring);   // from 1; 0: not found
    if (found == NULL || ring == NULL) {
        free(found);
        free(ring);
        return pm_scene_no_memory();
    }
    int count = 1, last = 1;
    ring[0] = 1;
    for (int k = 0; k < count; ++k) {
        last = ring[found[k]];
        for (int n = scene->first_end[found[k]]; n < scene->first_end[found[k] + 1]; ++n) {
            const int end = scene->end_at[n];
            const int other = scene->port[end / 2].subsystem[1 - end % 2];
            if (other >= 0 && ring[other] == 0) {
                ring[other] = last + 1;
                found[count++] = other;
            }
        }
    }
    const int twice = 2 * (last - 1), most = scene->nsubsystem - 1;
    scene->diameter = count < scene->nsubsystem ? INT_MAX : twice < most ? twice : most;
    free(found);
    free(ring);
    return PM_OK;
}

static const char *name_of(const pm_scene *scene, int id) {
    return scene->port[id].name;
}

static pm_status read_all(pm_scene_reader *r, pm_yaml ports) {
    pm_scene *scene = r->scene;
    pm_scene_entries entries;
    PM_TRY(pm_yaml_require_entries(ports));
    PM_TRY(pm_scene_read_entries(r, ports, &entries));
    scene->nport = entries.total;
    scene->port = pm_arena_array(r->arena, (size_t)scene->nport, sizeof *scene->port);
    if (scene->port == NULL) {
        return pm_scene_no_memory();
    }
    const double *table = NULL;
    for (int i = 0; i < scene->nport; ++i) {
        pm_scene_port *port = &scene->port[i];
        pm_yaml key, block;
        int first;
        r->row = NULL;
        PM_TRY(pm_scene_enter_entry(r, &entries, i, &key, &block, &port->name, &first));
        if (first == i) {
            const int count = entries.range[pm_scene_entry_of(&entries, i)].total;
            PM_TRY(pm_scene_read_table(r, block, count, &table));
        }
        r->row = table == NULL ? NULL : &table[2 * (i - first)];
        PM_TRY(first == i ? read_port(r, port, block)
                          : repeat_port(r, &scene->port[first], port, block));
        port->range = pm_scene_range_of(&entries, i);
    }
    r->naxis = 0;
    r->row = NULL;
    return pm_scene_sort_names(r, &entries, name_of, &scene->port_names);
}

pm_status pm_scene_read_ports(pm_scene_reader *r) {
    const pm_yaml ports = pm_yaml_get(r->root, "ports");
    if (pm_yaml_exists(ports)) {
        PM_TRY(read_all(r, ports));
    }
    PM_TRY(list_ends(r->scene));
    return measure_diameter(r->scene);
}
