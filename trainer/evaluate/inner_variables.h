// The inner variables of solids (sim/solid_dynamics.h) in the states of a dataset that does not
// have them. The stored energy of a solid depends on them: a body that was bent some time ago
// stores less than one that was bent just now. They follow from the displacements of all states
// before, by the learned relaxation of the material.
#ifndef PM_TRAINER_EVALUATE_INNER_VARIABLES_H
#define PM_TRAINER_EVALUATE_INNER_VARIABLES_H

#include "model/solid/solid.h"
#include "scene/columns.h"
#include "scene/system.h"

// One solid whose inner variables the dataset does not have.
typedef struct pm_inner_body {
    int u, inner; // first components in the concatenated state
    pm_solid_material material;
    pm_solid *solid;
} pm_inner_body;

typedef struct pm_inner_variables {
    int count;
    pm_inner_body *body; // [count]
} pm_inner_variables;

// Opens a body for each solid of the system whose inner variables are no columns. Memory comes from
// the arena; system is borrowed; the caller closes. PM_ENOMEM, or as pm_solid_open.
pm_status pm_inner_variables_open(pm_inner_variables *inner, pm_arena *arena,
                                  const pm_system *system, const pm_columns *columns);
void pm_inner_variables_close(pm_inner_variables *inner); // a zeroed structure is allowed

// Starts a trajectory at the concatenated state z [nz].
void pm_inner_variables_start(pm_inner_variables *inner, const double *z);
// Writes the inner variables at z [nz], a state h s after the last one, to their places in z. They
// stay as they were where the displacements turn an element inside out.
void pm_inner_variables_follow(pm_inner_variables *inner, double h, double *z);

#endif
