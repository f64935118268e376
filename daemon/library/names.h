// The names and units under which the shared library and the exported models show the variables and
// the boundary inputs of a scene.
#ifndef PM_LIBRARY_NAMES_H
#define PM_LIBRARY_NAMES_H

#include "scene/scene.h"

// The names and units of all components of a scene's state, and of all numbers that its boundary
// inputs prescribe. pm_scene_variable_names allocates the four arrays and their texts in an
// arena, with which they are freed.
typedef struct pm_scene_variables {
    const char **name, **unit;             // [scene->nz] "upper.q[0]" and "m"
    const char **input_name, **input_unit; // [scene->nprescribed] "hand.dE/df[0]" and "J/(m)"
} pm_scene_variables;

// Sets all names and units. The caller owns *variables, and the arena owns the arrays. PM_ENOMEM.
pm_status pm_scene_variable_names(pm_scene_variables *variables, const pm_scene *scene,
                                  pm_arena *arena);

#endif
