// The names under which the shared library shows the variables and boundary inputs of a scene.
#ifndef PM_LIBRARY_NAMES_H
#define PM_LIBRARY_NAMES_H

#include "scene/scene.h"

// The caller owns the storage; the texts live in the arena given to pm_scene_variable_names, or in
// the scene.
typedef struct pm_scene_variables {
    const char **name, **unit;             // [scene->nz] "upper.q[0]" and "m"
    const char **input_name, **input_unit; // [scene->nprescribed] "hand.dE/df[0]" and "J/(m)"
} pm_scene_variables;

// Makes the names. PM_ENOMEM.
pm_status pm_scene_variable_names(pm_scene_variables *variables, const pm_scene *scene,
                                  pm_arena *arena);

#endif
