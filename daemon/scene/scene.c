// Answers questions about a scene: it finds subsystems, boundary inputs, ports and processes by
// name, and says which ports cross processes, what a recording keeps and what a report lists.
#include "scene/scene.h"

#include <stdlib.h>
#include <string.h>

double pm_scene_time(const pm_scene *scene, long step) {
    return (double)step * scene->physics.dt;
}

// --- by name ---

int pm_scene_find_subsystem(const pm_scene *scene, const char *name) {
    if (scene->physics.subsystem_names.count > 0) {
        return pm_names_find(&scene->physics.subsystem_names, name);
    }
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        if (strcmp(scene->physics.subsystem[i].name, name) == 0) {
            return i;
        }
    }
    return -1;
}

int pm_scene_find_boundary_input(const pm_scene *scene, const char *name) {
    for (int i = 0; i < scene->physics.nboundary_input; ++i) {
        if (strcmp(scene->physics.boundary_input[i].name, name) == 0) {
            return i;
        }
    }
    return -1;
}

int pm_scene_find_port(const pm_scene *scene, const char *name) {
    if (scene->physics.port_names.count > 0) {
        return pm_names_find(&scene->physics.port_names, name);
    }
    for (int i = 0; i < scene->physics.nport; ++i) {
        if (strcmp(scene->physics.port[i].name, name) == 0) {
            return i;
        }
    }
    return -1;
}

int pm_scene_find_process(const pm_scene *scene, const char *name) {
    for (int i = 0; i < scene->network.nprocess; ++i) {
        if (strcmp(scene->network.process[i].name, name) == 0) {
            return i;
        }
    }
    return -1;
}

int pm_scene_find_live(const pm_scene *scene, const char *name) {
    for (int i = 0; i < scene->network.nlive_input; ++i) {
        const pm_scene_live_input *input = &scene->network.live_input[i];
        for (int k = 0; k < input->count; ++k) {
            if (strcmp(input->name[k], name) == 0) {
                return input->first + k;
            }
        }
    }
    return -1;
}

// --- ports and processes ---

const char *pm_scene_end_name(const pm_scene *scene, const pm_scene_port *port, int end) {
    return port->subsystem[end] >= 0
               ? scene->physics.subsystem[port->subsystem[end]].name
               : scene->physics.boundary_input[port->boundary_input[end]].name;
}

const pm_layout *pm_scene_end_layout(const pm_scene *scene, const pm_scene_port *port, int end) {
    return port->subsystem[end] >= 0
               ? &scene->physics.subsystem[port->subsystem[end]].layout
               : &scene->physics.boundary_input[port->boundary_input[end]].layout;
}

bool pm_port_crosses_processes(const pm_scene *scene, const pm_scene_port *port) {
    const int a = port->subsystem[0], b = port->subsystem[1];
    return a >= 0 && b >= 0 &&
           scene->physics.subsystem[a].process != scene->physics.subsystem[b].process;
}

// --- recordings and reports ---

bool pm_scene_hides(const pm_scene *scene) {
    bool hidden = false;
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        for (int g = 0; g < scene->physics.subsystem[i].layout.ngroup; ++g) {
            hidden = hidden || scene->physics.subsystem[i].hidden[g];
        }
    }
    return hidden;
}

bool pm_scene_records(const pm_scene *scene, int subsystem) {
    return scene->run.recorded == NULL || scene->run.recorded[subsystem];
}

bool pm_scene_records_port(const pm_scene *scene, int port) {
    const int *end = scene->physics.port[port].subsystem;
    return scene->run.recorded == NULL || (end[0] >= 0 && scene->run.recorded[end[0]]) ||
           (end[1] >= 0 && scene->run.recorded[end[1]]);
}

bool pm_scene_may_report_sums(const pm_scene *scene) {
    return scene->physics.nsubsystem > PM_SCENE_MOST_REPORTED &&
           scene->physics.nboundary_input == 0 && scene->physics.tolerance == 0;
}

bool pm_scene_lists_subsystem(const pm_scene *scene, int id) {
    bool listed = id < PM_SCENE_LISTED;
    for (int k = scene->physics.first_end[id]; k < scene->physics.first_end[id + 1] && !listed;
         ++k) {
        listed =
            pm_port_crosses_processes(scene, &scene->physics.port[scene->physics.end_at[k] / 2]);
    }
    return listed;
}

void pm_scene_free(pm_scene *scene) {
    PM_DELETE(scene);
}
