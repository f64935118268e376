// Finds subsystems, boundary inputs, ports and processes by name, and lists their names for
// messages.
#include <stdio.h>
#include <string.h>

#include "scene/scene_reader.h"

double pm_scene_time(const pm_scene *scene, double t0, long step) {
    return t0 + (double)step * scene->dt;
}

// --- by name ---

int pm_scene_find_subsystem(const pm_scene *scene, const char *name) {
    if (scene->subsystem_names.count > 0) {
        return pm_names_find(&scene->subsystem_names, name);
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        if (strcmp(scene->subsystem[i].name, name) == 0) {
            return i;
        }
    }
    return -1;
}

int pm_scene_find_boundary_input(const pm_scene *scene, const char *name) {
    for (int i = 0; i < scene->nboundary_input; ++i) {
        if (strcmp(scene->boundary_input[i].name, name) == 0) {
            return i;
        }
    }
    return -1;
}

int pm_scene_find_port(const pm_scene *scene, const char *name) {
    if (scene->port_names.count > 0) {
        return pm_names_find(&scene->port_names, name);
    }
    for (int i = 0; i < scene->nport; ++i) {
        if (strcmp(scene->port[i].name, name) == 0) {
            return i;
        }
    }
    return -1;
}

int pm_scene_find_process(const pm_scene *scene, const char *name) {
    for (int i = 0; i < scene->nprocess; ++i) {
        if (strcmp(scene->process[i].name, name) == 0) {
            return i;
        }
    }
    return -1;
}

int pm_scene_find_live(const pm_scene *scene, const char *name) {
    for (int i = 0; i < scene->nlive_input; ++i) {
        const pm_scene_live_input *input = &scene->live_input[i];
        for (int k = 0; k < input->count; ++k) {
            if (strcmp(input->name[k], name) == 0) {
                return input->first + k;
            }
        }
    }
    return -1;
}

// --- ends of ports ---

const char *pm_scene_end_name(const pm_scene *scene, const pm_scene_port *port, int end) {
    return port->subsystem[end] >= 0 ? scene->subsystem[port->subsystem[end]].name
                                     : scene->boundary_input[port->boundary_input[end]].name;
}

const pm_layout *pm_scene_end_layout(const pm_scene *scene, const pm_scene_port *port, int end) {
    return port->subsystem[end] >= 0 ? &scene->subsystem[port->subsystem[end]].layout
                                     : &scene->boundary_input[port->boundary_input[end]].layout;
}

bool pm_scene_records(const pm_scene *scene, int subsystem) {
    return scene->recorded == NULL || scene->recorded[subsystem];
}

bool pm_scene_records_port(const pm_scene *scene, int port) {
    const int *end = scene->port[port].subsystem;
    return scene->recorded == NULL || (end[0] >= 0 && scene->recorded[end[0]]) ||
           (end[1] >= 0 && scene->recorded[end[1]]);
}

bool pm_scene_joins_processes(const pm_scene *scene, const pm_scene_port *port) {
    const int a = port->subsystem[0], b = port->subsystem[1];
    return a >= 0 && b >= 0 && scene->subsystem[a].process != scene->subsystem[b].process;
}

// --- reports ---

bool pm_scene_may_report_sums(const pm_scene *scene) {
    return scene->nsubsystem > PM_SCENE_MOST_REPORTED && scene->nboundary_input == 0 &&
           scene->tolerance == 0;
}

bool pm_scene_lists_subsystem(const pm_scene *scene, int id) {
    bool listed = id < PM_SCENE_LISTED;
    for (int k = scene->first_end[id]; k < scene->first_end[id + 1] && !listed; ++k) {
        listed = pm_scene_joins_processes(scene, &scene->port[scene->end_at[k] / 2]);
    }
    return listed;
}

// --- lists for messages ---

const char *pm_scene_subsystem_names(const pm_scene *scene, char *buffer, size_t size) {
    size_t used = 0;
    for (int i = 0; i < scene->nsubsystem && used < size; ++i) {
        used += (size_t)snprintf(buffer + used, size - used, "%s%s", i == 0 ? "" : ", ",
                                 scene->subsystem[i].name);
    }
    return buffer;
}

const char *pm_scene_end_names(const pm_scene *scene, char *buffer, size_t size) {
    size_t used = strlen(pm_scene_subsystem_names(scene, buffer, size));
    for (int i = 0; i < scene->nboundary_input && used < size; ++i) {
        used += (size_t)snprintf(buffer + used, size - used, ", %s", scene->boundary_input[i].name);
    }
    return buffer;
}

const char *pm_scene_group_names(const pm_layout *layout, char *buffer, size_t size) {
    size_t used = 0;
    for (int i = 0; i < layout->ngroup && used < size; ++i) {
        used += (size_t)snprintf(buffer + used, size - used, "%s%s", i == 0 ? "" : ", ",
                                 layout->group[i].name);
    }
    return buffer;
}
