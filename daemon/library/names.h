// The names and units under which the shared library and the exported models show the variables and
// the boundary inputs of a scene.
#ifndef PM_LIBRARY_NAMES_H
#define PM_LIBRARY_NAMES_H

#include "scene/scene.h"

// Names and their units.
typedef struct pm_name_list {
    const char **name, **unit; // [count]
} pm_name_list;

// The names and units of all numbers that a scene shows. The co-energies of a group that is shown
// by its co-energy are those of its energy variable, which has no name of its own.
typedef struct pm_scene_variables {
    pm_name_list state;    // [nz] "upper.q[0]" and "m"
    pm_name_list rate;     // [nz] "upper.dq/dt[0]" and "m/s"
    pm_name_list slope[2]; // [nz] "upper.dE/dq[0]" and "N"; "upper.dS/ds[0]" and "1"
    pm_name_list input;    // [nprescribed] "hand.f[0]", "hand.dE/df[0]" and "hand.dS/df[0]"
    pm_name_list reaction; // [nprescribed / 3] "hand.df/dt[0]": what all ports do to the outside
} pm_scene_variables;

// Sets all names and units. The caller owns *variables, and the arena owns the arrays. PM_ENOMEM.
pm_status pm_scene_variable_names(pm_scene_variables *variables, const pm_scene *scene,
                                  pm_arena *arena);

#endif
