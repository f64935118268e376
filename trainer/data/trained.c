// Weights of a system as one vector.
#include "data/trained.h"

#include <math.h>
#include <string.h>

#include "model/constants.h"

int pm_trained_count(const pm_system *system) {
    int count = 0;
    for (int i = 0; i < pm_system_components(system); ++i) {
        count += (int)pm_params_trained(pm_system_params(system, i));
    }
    return count;
}

void pm_trained_gather(const pm_system *system, double *theta) {
    for (int i = 0; i < pm_system_components(system); ++i) {
        const pm_params *params = pm_system_params(system, i);
        pm_params_gather(params, theta);
        theta += pm_params_trained(params);
    }
}

void pm_trained_scatter(const pm_system *system, const double *theta) {
    for (int i = 0; i < pm_system_components(system); ++i) {
        pm_params *params = pm_system_params(system, i);
        pm_params_scatter(params, theta);
        theta += pm_params_trained(params);
    }
}

int pm_trained_list(const pm_system *system, pm_trained *list) {
    int count = 0, first = 0;
    for (int i = 0; i < pm_system_components(system); ++i) {
        const pm_params *params = pm_system_params(system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            const int size = entry->rows * entry->cols;
            if (entry->trained && list != NULL) {
                list[count] = (pm_trained){entry, i, first, size};
            }
            count += entry->trained;
            first += entry->trained ? size : 0;
        }
    }
    return count;
}

void pm_trained_share(pm_system *system) {
    for (int i = 1; i < pm_system_components(system); ++i) {
        for (int k = 0; k < i; ++k) {
            pm_params_share(pm_system_params(system, i), pm_system_params(system, k));
        }
    }
}

const char *pm_trained_name(const pm_system *system, int component) {
    const pm_scene *scene = system->scene;
    const int n = scene->physics.nsubsystem;
    return component < n ? scene->physics.subsystem[component].name
                         : scene->physics.port[component - n].name;
}

double pm_trained_constant(const pm_system *system, int component, const pm_param_entry *entry) {
    const int n = system->scene->physics.nsubsystem;
    const pm_constants *constants = component < n ? system->part[component]->spec.constants
                                                  : system->port[component - n]->spec.constants;
    const char *name = entry->trained ? pm_constant_name(entry->name) : NULL;
    for (int i = 0; name != NULL && constants != NULL && constants->learned != NULL; ++i) {
        if (i == constants->count) {
            return entry->value[0];
        }
        if (strcmp(constants->name[i], name) == 0 &&
            constants->learned[i] == PM_CONSTANT_POSITIVE) {
            return exp(entry->value[0]);
        }
    }
    return name == NULL ? NAN : entry->value[0];
}

const char *pm_trained_place(const pm_system *system, int component) {
    const int n = system->scene->physics.nsubsystem;
    return component < n ? system->part[component]->spec.at : system->port[component - n]->spec.at;
}
