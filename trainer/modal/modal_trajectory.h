// A body's trajectory in the coordinates of its modes.
#ifndef PM_TRAINER_MODAL_MODAL_TRAJECTORY_H
#define PM_TRAINER_MODAL_MODAL_TRAJECTORY_H

#include "body/symmetry_copies.h"
#include "modal/basis.h"
#include "store/field.h"

// Which forces on a body count as its loads: those of the world, or those of other bodies
// too.
typedef enum pm_boundary_inputs { PM_LOADS_PRESCRIBED, PM_LOADS_OF_ALL } pm_boundary_inputs;

// Arrays by time. What is called [.][n] has all modes, also those outside the state.
typedef struct pm_modal_trajectory {
    pm_arena arena; // owns all that follows
    int ntime, nmode, nbranch, nnode;
    pm_boundary_inputs loads;
    int q, sigma;   // first of the field's variables that are positions, and stress; -1: none
    double *u;      // [ntime][nnode][3] m, displacements
    double *f;      // [ntime][nnode][3] N, loads; none on clamped nodes, where u never changes
    double *stress; // [ntime][nnode][6] Pa, or NULL
    double *a;      // [ntime][nmode] J^0.5
    double *load;   // [ntime][nmode] J^0.5
    double *moved;  // [nnode][3] work space
    double *c;      // [nbranch][ntime][nmode] J^0.5
} pm_modal_trajectory;

// Room for the trajectories of a field; with `stress` also for that, where the field has it.
// PM_EDATA (no positions "qx qy qz"), PM_ENOMEM.
pm_status pm_modal_trajectory_open(pm_modal_trajectory *path, const pm_field *field, int nmode,
                                   int nbranch, pm_boundary_inputs loads, bool stress);
void pm_modal_trajectory_close(pm_modal_trajectory *path);

// Fills in displacements, loads and, where there is room, stress of a copy of a trajectory.
void pm_modal_trajectory_take(pm_modal_trajectory *path, const pm_field *field, int trajectory,
                              const pm_copy *copy);
// Then a, load and c, with the modes and relaxation times of the basis. Between times a is linear,
// for which c is exact; before the first it was as then.
void pm_modal_trajectory_project(pm_modal_trajectory *path, const pm_basis *basis, double dt);

// What is known at a time: of the first modes, as many as the basis's state has. `c` has room for
// [nbranch][nstate] and must live as long as the reading.
void pm_modal_trajectory_read(const pm_modal_trajectory *path, const pm_basis *basis, int time,
                              double *c, pm_modal_state *r);

#endif
