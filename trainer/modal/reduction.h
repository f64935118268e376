// The settings of a reduction, and the loop over trajectories and symmetric copies that its steps
// (reduce_modes.h, reduce_creep.h, reduce_patterns.h) and the projection (reduce.h) share.
#ifndef PM_TRAINER_MODAL_REDUCTION_H
#define PM_TRAINER_MODAL_REDUCTION_H

#include "modal/modal_trajectory.h"

typedef struct pm_reduce_settings {
    int nmode;                         // modes in all, at most PM_BASIS_MAX_MODES
    int nstate;                        // the largest number of modes that carry the energy
    int nlead;                         // the largest number of these that appear in products
    int nbranch;                       // at most PM_BASIS_MAX_BRANCHES
    double tau[PM_BASIS_MAX_BRANCHES]; // s, relaxation times
    double inertia_time;               // s
    double temperature;                // K
    int displacement_rank, stress_rank;
    int reach;   // sections on either side that the kernel of the local stress spans; 0: no kernel
    bool square; // learn from the eight symmetric copies (symmetry_copies.h)
} pm_reduce_settings;

typedef struct pm_reduction {
    const pm_field *field;
    const pm_reduce_settings *settings; // NULL in a projection
    int count;
    const int *trajectory; // [count]
    int ncopy;
    pm_copy copy[PM_SYMMETRY_COPIES_OF_SQUARE];
    pm_modal_trajectory modal; // the trajectory that is being visited
    pm_arena arena;            // work space
} pm_reduction;

// Makes the symmetric copies (`square`: all eight) and room for one trajectory. The caller sets
// `field`, `settings`, `count` and `trajectory` first. PM_EDATA, PM_ENOMEM. The caller closes the
// reduction, after a failure too.
pm_status pm_reduction_open(pm_reduction *r, int nmode, int nbranch, bool square,
                            pm_load_kind loads, bool stress);
void pm_reduction_close(pm_reduction *r);

// Reads every trajectory r->trajectory [count] once for each of its r->ncopy symmetric copies, and
// calls `visit` for each copy. Trajectories in which the body does not move are left out. During
// the call r->modal holds the displacements, loads and stresses of the copy. `weight` is one over
// the norm of its displacements, so that all trajectories count equally. If `visit` fails, the loop
// ends and returns its status.
typedef pm_status pm_reduction_visit(pm_reduction *r, double weight, void *context);
pm_status pm_reduction_for_each(pm_reduction *r, pm_reduction_visit *visit, void *context);

// Fails with PM_ENOMEM.
pm_status pm_reduction_no_memory(void);

// Returns the Euclidean norm of value [count].
double pm_reduction_norm(size_t count, const double *value);

#endif
