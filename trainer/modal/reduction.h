// What the steps of a reduction share: inside trainer/modal/reduce*.c alone.
#ifndef PM_TRAINER_MODAL_REDUCTION_H
#define PM_TRAINER_MODAL_REDUCTION_H

#include "modal/modal_trajectory.h"
#include "modal/reduce.h"

typedef struct pm_reduction {
    const pm_field *field;
    const pm_reduce_how *how;
    int count;
    const int *trajectory; // [count]
    int ncopy;
    pm_copy copy[PM_SYMMETRY_COPIES_OF_SQUARE];
    pm_modal_trajectory path; // the one being visited
    pm_arena arena;           // work space
} pm_reduction;

// Calls visit for every trajectory and copy that moves, with its displacements, loads and stresses
// in r->path, and with what makes it count as much as any: one over the norm of the displacements.
typedef pm_status pm_visit_path(pm_reduction *r, double weight, void *context);
pm_status pm_reduction_for_each(pm_reduction *r, pm_visit_path *visit, void *context);

double pm_reduction_norm(size_t count, const double *value);

// The modes, their stiffness and the constants of a basis: reduce_modes.c.
pm_status pm_reduce_modes(pm_reduction *r, pm_basis **basis);
// Then its patterns, and what is local: reduce_patterns.c.
pm_status pm_reduce_patterns(pm_reduction *r, pm_basis *basis);

#endif
