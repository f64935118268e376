// A trajectory of a body's fields in the coordinates of its modes (basis.h).
#ifndef PM_TRAINER_MODAL_MODAL_TRAJECTORY_H
#define PM_TRAINER_MODAL_MODAL_TRAJECTORY_H

#include "body/symmetry_copies.h"
#include "modal/basis.h"
#include "store/field.h"

// Which forces on a body count as its loads: the prescribed ones alone, or the forces of contact
// with other bodies too.
typedef enum pm_load_kind { PM_LOADS_PRESCRIBED, PM_LOADS_OF_ALL } pm_load_kind;

// Arrays over time. Amplitudes and loads cover all modes, also those outside the state.
typedef struct pm_modal_trajectory {
    pm_arena arena; // owns the arrays
    int ntime, nmode, nbranch, nnode;
    pm_load_kind loads;
    int q, sigma;    // indices of the field's variables qx and sxx; -1: the field has none
    double *u;       // [ntime][nnode][3] m, displacements
    double *f;       // [ntime][nnode][3] N, loads; zero on nodes that never move
    double *stress;  // [ntime][nnode][6] Pa, or NULL
    double *a;       // [ntime][nmode] J^0.5
    double *load;    // [ntime][nmode] J^0.5
    double *moved;   // [nnode][3] work space
    double *c;       // [nbranch][ntime][nmode] J^0.5
    double *delayed; // [ntime][nretardation of the basis][nmode] J^0.5
} pm_modal_trajectory;

// Makes room for one trajectory of a field, and with `stress` also for its stress if the field has
// it. PM_EDATA (the field has no positions "qx qy qz"), PM_ENOMEM.
pm_status pm_modal_trajectory_open(pm_modal_trajectory *modal, const pm_field *field, int nmode,
                                   int nbranch, pm_load_kind loads, bool stress);
void pm_modal_trajectory_close(pm_modal_trajectory *modal);

// Reads displacements, loads and, if there is room, stress of a symmetric copy of a trajectory.
void pm_modal_trajectory_read(pm_modal_trajectory *modal, const pm_field *field, int trajectory,
                              const pm_copy *copy);
// Computes a, load, c and the delayed loads from the displacements u and the loads f of the
// trajectory that was read last, with the modes and times of the basis. `dt` is the time between
// two states, s. The internal variables c solve dc_k/dt = (a - c_k)/tau_k exactly for an amplitude
// a that is linear in time between two states. They start at c_k = a, as if a had been constant
// before the first state. The same holds for the delayed loads and the loads.
void pm_modal_trajectory_project(pm_modal_trajectory *modal, const pm_basis *basis, double dt);

// Writes the modal state at time number `time`, for the modes of the basis's state. `c`
// [nbranch][nstate] is memory of the caller, which must outlive the state.
void pm_modal_trajectory_state(const pm_modal_trajectory *modal, const pm_basis *basis, int time,
                               double *c, pm_modal_state *state);

#endif
